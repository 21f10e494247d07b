"""Tables of the report: what was asked, metrics, months, groups of panes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.schedule import Schedule
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.model.materials import Lambertian, Reflectance
from drcmitsuba.report.captions import month_names, period_text
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.table import (
    NONE,
    Cell,
    Number,
    PageTable,
    in_columns,
    interval,
    plain,
    text,
)

MOST_GROUPS = 40
"""Largest number of groups of a façade in the table."""
MOST_VIEWS = 40
"""Largest number of views in the table of melanopic light."""
MOST_NAMES = 12
"""Largest number of materials or states that are listed."""
MONTHLY = ("msDA", "MSE", "shade_closed_monthly")


def asked(facades: list[EvaluatedFacade], names: list[str]) -> PageTable:
    """Table of what was asked: place, period, façade, points, thresholds."""
    t = labels()
    of = {
        t["case"]: lambda f: text(f.settings.get("case") or f.case.name),
        t["weather"]: lambda f: text(Path(str(f.settings.get("weather_source", ""))).name or NONE),
        t["place"]: _place,
        t["period"]: lambda f: period_text(f.case, f.illuminance),
        t["building"]: _building,
        t["materials"]: _materials,
        t["reflectances"]: _reflectances,
        t["shading"]: _shading,
        t["points"]: _points,
        t["asked_sda"]: lambda f: t["asked_sda_text"].format(
            threshold=f"{f.case.metrics.sda_threshold:g}",
            share=f"{100 * f.case.metrics.sda_fraction:g}",
        ),
        t["asked_ase"]: lambda f: t["asked_ase_text"].format(
            threshold=f"{f.case.metrics.ase_threshold:g}", hours=f"{f.case.metrics.ase_hours:g}"
        ),
    }
    for name in ("choice", "drawn"):
        if any(name in f.settings for f in facades):
            of[t[name]] = partial(_chosen, name)
    rows = {name: [plain(say(f)) for f in facades] for name, say in of.items()}
    return in_columns(t["asked"], t["what"], names, rows)


def _chosen(name: str, facade: EvaluatedFacade) -> str:
    return text(str(facade.settings.get(name, NONE)))


def _place(facade: EvaluatedFacade) -> str:
    at = [facade.illuminance.attrs.get(name) for name in ("latitude", "longitude")]
    if None in at:
        return NONE
    return "{:.2f}°, {:.2f}°".format(*(float(v) for v in at if v is not None))


def _building(facade: EvaluatedFacade) -> str:
    case = facade.case
    if case.room is not None:
        return " × ".join(f"{length:g}" for length in case.room.size) + " m"
    if case.model is not None:
        return ", ".join(text(Path(file).name) for file in case.model.files[:MOST_NAMES])
    return NONE


def _materials(facade: EvaluatedFacade) -> str:
    words = {name: [getattr(m, "type", "")] for name, m in facade.case.materials.items()}
    for name, material in facade.case.materials.items():
        tau = getattr(material, "transmittance", None)
        if isinstance(tau, float | int):
            words[name].append(labels()["transmittance"].format(value=f"{tau:.2g}"))
    return _listed([f"{text(name)} ({text(', '.join(of))})" for name, of in words.items()])


def _reflectances(facade: EvaluatedFacade) -> str:
    """Reflectances of the surfaces of a room or a model, by their names."""
    case, every = facade.case, dict[str, Reflectance]()
    if case.room is not None:
        every = {name: getattr(case.room, name) for name in ("floor", "walls", "ceiling")}
    for layer in case.building.layers:
        if isinstance(layer.material, Lambertian):
            every |= zip(layer.names, layer.material.sides, strict=False)
    return _listed([f"{text(name)} {_reflectance(rho)}" for name, rho in every.items()])


def _reflectance(rho: Reflectance) -> str:
    """Reflectance, or that of each channel."""
    return f"{rho:.2g}" if isinstance(rho, float | int) else " / ".join(f"{v:.2g}" for v in rho)


def _listed(every: list[str]) -> str:
    """Some of the entries, and the number of the others."""
    more = [f"+ {len(every) - MOST_NAMES}"] if len(every) > MOST_NAMES else []
    return ", ".join(every[:MOST_NAMES] + more) or NONE


def _shading(facade: EvaluatedFacade) -> str:
    t, E = labels(), facade.illuminance.attrs
    if not E.get("has_shade", 0):
        return t["no_shade"]
    groups = GroupStates.of_attributes(E)
    scheduled = Schedule.of_attributes(E, groups).given
    if scheduled.all():
        return t["shade_schedule"]
    threshold, area = (float(E.get(f"shade_{n}", 0)) for n in ("threshold", "area"))
    rule = t["shade_rule"].format(threshold=f"{threshold:g}", area=f"{100 * area:g}")
    names = [text(name) for name, given in zip(groups.names, scheduled, strict=True) if given]
    return f"{rule}; {_listed(names)}: {t['shade_schedule']}" if names else rule


def _points(facade: EvaluatedFacade) -> str:
    t, E = labels(), facade.illuminance
    grids = len(sensors_by_grid(E))
    low, high = (float(f(E["z"].values)) for f in (min, max))
    heights = f"{low:.2f} m" if high - low < 0.005 else f"{low:.2f} … {high:.2f} m"
    words = t["points_text"].format(count=E.sizes["sensor"], heights=heights)
    return words + (t["points_grids"].format(count=grids) if grids else "")


def metrics(facades: list[EvaluatedFacade], names: list[str]) -> PageTable:
    """Table of the metrics of the period."""
    t = labels()
    of = ["sDA", "ASE"] + ["shade_closed"] * any(has_shade(f) for f in facades)
    rows = {t[name]: [interval(f.numbers[name]) for f in facades] for name in of}
    thresholds = {float(f.case.metrics.sda_threshold) for f in facades}
    if len(thresholds) == 1:  # standards have thresholds of their own
        at = t["sDA_at"].format(threshold=f"{thresholds.pop():g}")
        rows = {at if name == t["sDA"] else name: row for name, row in rows.items()}
    return in_columns(t["metrics"], t["metric"], names, rows, t["metrics_note"])


def differences(facades: list[EvaluatedFacade], names: list[str]) -> PageTable | None:
    """Table of the differences of the metrics from the first façade; None for a single one."""
    if len(facades) == 1:
        return None
    t, (first, *others) = labels(), facades
    of = ["sDA", "ASE"] + ["shade_closed"] * any(has_shade(f) for f in facades)
    rows = {t[name]: [_difference(f.numbers[name], first.numbers[name]) for f in others]
            for name in of}  # fmt: skip
    title = t["difference"].format(facade=names[0])
    return in_columns(title, t["metric"], names[1:], rows, t["difference_note"])


def _difference(one: Mapping[str, float], other: Mapping[str, float]) -> Cell:
    """Cell of one value less another, with the least and the most that their intervals allow."""
    ends = {"value": "value", "low": "high", "high": "low"}
    value, low, high = (Number(one[k] - other[of], signed=True) for k, of in ends.items())
    return value, " (", low, " … ", high, f") {labels()['percentage_points']}"


def has_shade(facade: EvaluatedFacade) -> bool:
    """Whether a shade may close."""
    return bool(facade.illuminance.attrs.get("has_shade", 0))


def months(facade: EvaluatedFacade, name: str) -> PageTable:
    """Table of the metrics of one façade by month."""
    t, shown = labels(), MONTHLY if has_shade(facade) else MONTHLY[:2]
    rows = tuple(
        (plain(month_names((month,))), *(interval(facade.numbers[n][month - 1]) for n in shown))
        for month in range(1, 13)
    )
    return PageTable(name, (t["month"], *(t[n] for n in shown)), rows)


def melanopic(facade: EvaluatedFacade, name: str) -> PageTable | None:
    """Table of melanopic light at the sensors and views; None without bands."""
    t, told = labels(), facade.numbers.get("melanopic")
    if not told:
        return None
    rules = {rule: None for view in told["views"].values() for rule in view["rules"]}
    rows = [_melanopic_row(t["sensors"], told, rules)]
    views = list(told["views"].items())[:MOST_VIEWS]
    rows += [_melanopic_row(view, light, rules) for view, light in views]
    limit = f"{told['threshold']:g}"
    head = (t["receiver"], t["melanopic_hours"].format(limit=limit), t["melanopic_mornings"],
            t["melanopic_ratio"], t["melanopic_cct"], *map(text, rules))  # fmt: skip
    left = len(told["views"]) - len(views)
    note = t["more_melanopic"].format(count=left) if left else ""
    return PageTable(name, head, tuple(rows), note)


def _melanopic_row(
    name: str, light: Mapping[str, Any], rules: Mapping[str, None]
) -> tuple[Cell, ...]:
    t, none = labels(), plain(NONE)
    told = [(light[key], digits) for key, digits in (("ratio", 2), ("cct", 0))]
    colour = [none if value is None else (Number(value, digits),) for value, digits in told]
    known, verdicts = light.get("rules", {}), []
    for rule in rules:
        one = known.get(rule)
        verdicts.append(none if one is None else (
            t[f"met_{one['met']}"] + ", ", *interval(one["mornings"])
        ))  # fmt: skip
    mornings = interval(light["mornings"]) if "mornings" in light else none
    return plain(name), interval(light["autonomy"]), mornings, *colour, *verdicts


def groups(facade: EvaluatedFacade, name: str) -> PageTable | None:
    """Table of the hours that groups of panes are in each state; None without such groups."""
    t, told = labels(), facade.numbers.get("groups")
    if not isinstance(told, dict) or not told:
        return None
    rows: list[tuple[Cell, ...]] = []
    for group, shares in list(told.items())[:MOST_GROUPS]:
        states = shares.items() if isinstance(shares, dict) else ()
        known = (f"{text(s)} {v:.1f} %" for s, v in states if isinstance(v, int | float))
        rows.append((plain(group), plain(", ".join(known))))
    return PageTable(name, (t["group"], t["states"]), tuple(rows))
