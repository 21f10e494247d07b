"""From coefficients to illuminance, metrics and their intervals."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import SHADED, GroupStates
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.schedule import Schedule
from drcmitsuba.case.shading import AREA, THRESHOLD
from drcmitsuba.case.sun import Adaptive, ThreePhase
from drcmitsuba.metrics import intervals
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import FacadeStates, shares_of_states
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.illuminance import direct_sun, illuminance
from drcmitsuba.metrics.intervals import Bounds, DrawnShares, Draws, Rules, ShadeDraws, values
from drcmitsuba.metrics.metrics_of_spaces import by_space
from drcmitsuba.metrics.sensor_counts import undecided
from drcmitsuba.metrics.space_years import SpaceYears
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.schema import by_luminance
from drcmitsuba.sky.daylight import Daylight


@dataclass(frozen=True)
class EvaluatedMetrics:
    """Illuminance and metrics."""

    illuminance: xr.Dataset
    """E from `illuminance.illuminance` [lx]."""
    draws: Draws
    """Draws of the metrics, from which the intervals follow."""
    years: SpaceYears
    """Daylight of the spaces."""
    metrics: dict[str, Any]
    """Values and intervals from `summarise` [%]."""

    def half_width(self, unit: str) -> float:
        """Half the width of the intervals, in the unit of an `accuracy.Target`."""
        return self.draws.half_width(self.metrics, unit)


def rules(
    case: Case, step_hours: float, attributes: Mapping[str, Any] | None = None
) -> intervals.Rules:
    """Rules of the metrics of a case; those of the shade have no effect where there is none.

    `attributes` are those of C, which hold the groups of panes; by default there is one shade.
    """
    (threshold, area), closes = case.shade_rule, case.shading is not None or bool(case.groups)
    groups = GroupStates.of_attributes(attributes or {})
    return intervals.Rules(
        metrics=case.metrics,
        shade_threshold=threshold,
        shade_area=area if closes else 1.0,
        step_hours=step_hours,
        groups=groups,
        schedule=Schedule.of_attributes(attributes or {}, groups),
    )


def rules_of(
    attributes: Mapping[str, Any], source: str | Path, thresholds: Mapping[str, float | None]
) -> intervals.Rules:
    """Rules of an illuminance file: those of its case, LM-83's where the file names none.

    `attributes` and `source` are the file's; `thresholds` of `[metrics]` take the place of the
    file's where they are not None, and raise InputError where they are out of their range.
    """
    chosen = {name: value for name, value in thresholds.items() if value is not None}
    checked(Metrics, chosen, "command line")
    known = {name: attributes[name] for name in Metrics.model_fields if name in attributes}
    groups = GroupStates.of_attributes(attributes)
    return intervals.Rules(
        metrics=checked(Metrics, known | chosen, source),
        shade_threshold=attributes.get("shade_threshold", THRESHOLD),
        shade_area=attributes.get("shade_area", AREA),
        step_hours=float(attributes.get("step_hours", 1.0)),
        groups=groups,
        schedule=Schedule.of_attributes(attributes, groups),
    )


def settings_of(
    attributes: Mapping[str, Any], source: str | Path, metrics: Metrics
) -> dict[str, Any]:
    """Settings for `metrics.json` from an illuminance file; empty where it names no case.

    `settings` in the `attributes` of the file is the case as JSON; `metrics` are the thresholds
    that were applied. Settings that are no JSON object raise InputError.
    """
    if "settings" not in attributes:
        return {}

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    try:
        settings = json.loads(str(attributes["settings"]), parse_constant=refuse)
        if not isinstance(settings, dict):
            raise ValueError("no JSON object")
    except (ValueError, RecursionError) as error:
        remedy = "compute the illuminance anew"
        raise InputError(source, "settings", str(error)[:120], remedy) from None
    return {**settings, "metrics": metrics.model_dump(), "notes": []}


def drawing(case: Case) -> dict[str, Any]:
    """Arguments of the draws: number of `rays` to suns in all replicates, and the `seed`.

    As many rays are drawn where a shadow's edge crosses a disk. Where none was found, the eight
    directions around its rim would miss a straight edge that leaves up to 1.2 % of the disk, less
    than so many random rays by default.
    `rays` is None where the rims of suns were searched, or where patches stand for the sun. Rounds
    of adaptive sampling are not counted, which widens the intervals a little.
    """
    a = case.accuracy
    without = isinstance(case.sun, Adaptive | ThreePhase)
    rays = None if without else a.replicates * a.sensor_sun_samples
    return {"rays": rays, "seed": a.seed}


def draw_shade(
    case: Case, step_hours: float, direct: xr.Dataset, attributes: Mapping[str, Any] | None = None
) -> ShadeDraws:
    """Draw the states that the façade may take within the errors of the direct sun.

    `direct` is from `illuminance.direct_sun` [lx]; `step_hours` is the length of an interval [h];
    `attributes` are those of C.
    """
    asked = rules(case, step_hours, attributes)
    return ShadeDraws.of(by_luminance(direct), asked, **drawing(case))


def may_close(case: Case, step_hours: float, direct: xr.Dataset) -> np.ndarray:
    """Time stamps at which the one shade may close, bool (time,), as `draw_shade` says."""
    others = draw_shade(case, step_hours, direct).closures.others
    return others.get(SHADED, np.zeros(direct.sizes["time"], bool))


def evaluate_metrics(
    case: Case, daylight: Daylight, coefficients: Coefficients, direct: xr.Dataset | None = None,
    shade: ShadeDraws | None = None,
) -> EvaluatedMetrics:  # fmt: skip
    """Accumulate E from coefficients and draw its metrics.

    `direct` is from `illuminance.direct_sun` [lx], `shade` from `draw_shade` of the same direct
    sun; both are computed by default. Errors are those of `illuminance.illuminance`.
    """
    sky = daylight.sky
    direct = direct_sun(coefficients, sky) if direct is None else direct
    taken = FacadeStates.of(coefficients.attrs, direct)
    E = illuminance(coefficients, sky, direct, taken)
    E.attrs["step_hours"] = daylight.step_hours
    asked = rules(case, daylight.step_hours, coefficients.attrs)
    draws = intervals.draw(coefficients, sky, E, asked, **drawing(case), shade=shade)
    years = SpaceYears.of(coefficients, sky, E, taken, sensors_by_space(E), asked)
    return EvaluatedMetrics(E, draws, years, summarise(E, asked, draws, years))


def _monthly(
    name: str, values: np.ndarray, spread: DrawnShares | Bounds
) -> list[dict[str, float] | None]:
    """Twelve intervals, January first; None for a month without hours."""
    return [
        None if np.isnan(v) else spread.interval(name, float(v), month).to_dict()
        for month, v in enumerate(values)
    ]


def summarise(
    illuminance: xr.Dataset, rules: Rules, draws: Draws | None = None,
    years: SpaceYears | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Compute all metrics with their 95 % intervals.

    Parameters
    ----------
    illuminance : xr.Dataset
        E from `illuminance.illuminance` [lx].
    rules : Rules
        Thresholds of the metrics and of the shade.
    draws : Draws, optional
        Draws from `intervals.draw`. Without them, as where E has no replicates, the intervals are
        those of `intervals.Bounds`, wider than 95 % requires.
    years : SpaceYears, optional
        Daylight of the spaces of E; by default from E alone, `SpaceYears.of_errors`.

    Returns
    -------
    dict
        `sDA`, `ASE`, `shade_closed`: {"value", "low", "high"} [%]; `msDA`, `MSE`,
        `shade_closed_monthly`: 12 of these or None; with draws `undecided`: the sensors that pass
        in more than 2.5 and less than 97.5 % of them; `grids`, where E has a coordinate `grid`:
        `sDA`, `ASE`, `msDA`, `MSE` and the number of `sensors` of each grid, by its name; `spaces`,
        `storeys` and `building` from `metrics_of_spaces.by_space`, where E tells spaces. The shade
        closes where the sun on any grid asks for it. `groups`, where panes close one by one: the
        share of the time stamps in each state [%], by group and state; `shade_closed` is the mean
        of the groups.
    """
    spread = Bounds.of(illuminance, rules) if draws is None else draws
    annual, monthly = values(illuminance, rules)
    numbers: dict[str, Any] = {
        **{name: spread.interval(name, value).to_dict() for name, value in annual.items()},
        **{name: _monthly(name, months, spread) for name, months in monthly.items()},
    }
    if draws is not None:
        numbers["undecided"] = undecided(illuminance, draws)
    if "facade_state" in illuminance.coords:
        numbers["groups"] = _shares_of_states(illuminance, rules)

    def of(sensors: np.ndarray, drawn: DrawnShares | None) -> dict[str, Any]:
        return _of_sensors(illuminance.isel(sensor=sensors), rules, drawn)

    if grids := sensors_by_grid(illuminance):
        numbers["grids"] = {
            name: of(sensors, None if draws is None else draws.grids[name])
            for name, sensors in grids.items()
        }
    spaces = sensors_by_space(illuminance)
    if years is None:
        years = SpaceYears.of_errors(illuminance, spaces, rules)
    return numbers | by_space(numbers, illuminance, draws, spaces, years, rules)


def _shares_of_states(illuminance: xr.Dataset, rules: Rules) -> dict[str, dict[str, float]]:
    """Share of the time stamps in each state of every group that has several [%]."""
    taken, groups = illuminance["facade_state"].transpose("time", "group").values, rules.groups
    if taken.shape[1] != len(groups):
        got = f"{taken.shape[1]} of {len(groups)} groups"
        raise InputError("illuminance", "facade_state", got, "compute the illuminance anew")
    return shares_of_states(taken, groups)


def _of_sensors(illuminance: xr.Dataset, rules: Rules, drawn: DrawnShares | None) -> dict[str, Any]:
    """Metrics of some sensors, whose E has the shade applied, with their intervals."""
    spread = Bounds.of(illuminance, rules) if drawn is None else drawn
    annual, monthly = values(illuminance, rules)
    return {
        "sensors": illuminance.sizes["sensor"],
        **{name: spread.interval(name, annual[name]).to_dict() for name in ("sDA", "ASE")},
        **{name: _monthly(name, monthly[name], spread) for name in ("msDA", "MSE")},
    }
