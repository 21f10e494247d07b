"""From illuminance and numbers to the pictures that a user sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.spaces import SensorsOfSpace, sensors_by_space
from drcmitsuba.report import plots
from drcmitsuba.report.captions import (
    caption,
    is_rated,
    period_name,
    place_and_period,
    turned_text,
)
from drcmitsuba.report.colour_scale import round_levels, scale
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.sheets import MOST_SHEETS, Sheet, sheets
from drcmitsuba.runtime.errors import on_a_line
from drcmitsuba.schema import luminance


def pictures(
    case: Case, illuminance: xr.Dataset, numbers: dict[str, Any],
    spectral: xr.Dataset | None = None,
) -> dict[str, Figure]:  # fmt: skip
    """Draw all pictures of an evaluation, by file name.

    E is as on disk, `total` and `direct_sun` (time, sensor) [lx]; numbers as in `metrics.json`;
    `spectral` holds `melanopic` (time, sensor) [lx].
    There is a plan for each of the `sheets`; several have a number in their names.
    """
    enough, in_sun = stamps_above(case, illuminance)
    mean = luminance(illuminance["total"]).mean("time", dtype=float)
    sums = xr.Dataset({"mean_illuminance": mean, "enough": enough, "in_sun": in_sun})
    if spectral is not None:
        enough = spectral["melanopic"] >= numbers["melanopic"]["threshold"]
        sums["melanopic"] = 100 * enough.mean("time")
    return pictures_of_sums(case, illuminance, sums, numbers)


def stamps_above(case: Case, illuminance: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray]:
    """Count the time stamps with enough light, and those in direct sun, (sensor,) each.

    E is `total` and `direct_sun` (time, sensor) [lx], the thresholds are those of the case.
    """
    t = case.metrics
    enough = luminance(illuminance["total"]) >= t.sda_threshold
    in_sun = luminance(illuminance["direct_sun"]) >= t.ase_threshold
    return enough.sum("time"), in_sun.sum("time")


def pictures_of_sums(
    case: Case, illuminance: xr.Dataset, sums: xr.Dataset, numbers: dict[str, Any]
) -> dict[str, Figure]:
    """Draw all pictures of an evaluation from sums over its hours, by file name.

    Of `illuminance` only the attributes, the coordinate `time` and those of the sensors are used;
    `sums` are `mean_illuminance` [lx], `enough` and `in_sun`, numbers of time stamps (sensor,), and
    `melanopic`, share of the hours [%], where it is known.
    """
    t = case.metrics
    stamps, step_hours = illuminance.sizes["time"], float(illuminance.attrs.get("step_hours", 1.0))
    mean = sums["mean_illuminance"].assign_attrs(units="lx", long_name="mean illuminance")
    enough, in_sun = sums["enough"], sums["in_sun"]
    autonomy_stamps = metrics.autonomy_stamps(t.sda_fraction, stamps)
    exposure_stamps = metrics.exposure_stamps(t.ase_hours, step_hours)
    passing = {"sDA": enough >= autonomy_stamps, "ASE": in_sun >= exposure_stamps}
    shade = ", shade applied" if has_shade(case, illuminance) else ""
    shares = {name: _written(numbers, name) for name in passing}
    averages = {
        name: f"{name}\n{float(mean[sensors].mean()):.0f} lx"
        for name, sensors in sensors_by_grid(mean).items()
    }
    plans: dict[str, tuple[xr.DataArray, dict[str, Any]]] = {
        "illuminance": (mean, {
            "title": f"mean illuminance{shade}", "texts": averages,
            "contours": round_levels(np.ma.masked_invalid(mean.values)),
        }),
        "autonomy": (
            100 * enough / stamps,
            {
                "title": f"hours with {t.sda_threshold:g} lx{shade}", "texts": shares["sDA"],
                "label": "share of hours [%]", "norm": Normalize(0, 100),
                "limit": 100 * autonomy_stamps / stamps,
                "limit_label": f"{100 * t.sda_fraction:g} % (sDA)",
            },
        ),
        "sun": (
            in_sun * step_hours,
            {
                "title": f"hours with {t.ase_threshold:g} lx of direct sun", "texts": shares["ASE"],
                "label": "hours [h]", "limit": exposure_stamps * step_hours,
                "limit_label": f"{t.ase_hours:g} h (ASE)",
            },
        ),
        **_too_close(passing, numbers),
    }  # fmt: skip
    if "melanopic" in sums:
        title = f"hours with {numbers['melanopic']['threshold']:g} lx melanopic EDI{shade}"
        where = place_and_period(case, illuminance, numbers)
        settings = {
            "title": title, "label": "share of hours [%]", "norm": Normalize(0, 100),
            "caption": where,
        }  # fmt: skip
        plans["melanopic"] = sums["melanopic"], settings
    return {
        **_plans(case, illuminance, numbers, plans),
        "monthly.png": monthly(case, illuminance, numbers),
    }


def _written(numbers: dict[str, Any], metric: str) -> dict[str, str]:
    """Text that a plan writes on each grid: its name and its share [%] by a metric."""
    return {
        name: f"{name}\n{metric} {grid[metric]['value']:.0f} %"
        for name, grid in numbers.get("grids", {}).items()
    }


def _too_close(
    passing: dict[str, xr.DataArray], numbers: dict[str, Any]
) -> dict[str, tuple[xr.DataArray, dict[str, Any]]]:
    """Plans of the probability to pass, for metrics with sensors too close to a limit."""
    plans = {}
    for metric, passes in passing.items():
        undecided = [u for u in numbers.get("undecided", []) if u["metric"] == metric]
        if undecided:
            share = passes * 100.0
            share[[u["sensor"] for u in undecided]] = [100 * u["probability"] for u in undecided]
            title = f"probability that a point counts for {metric}"
            settings = {"title": title, "label": "probability [%]", "norm": Normalize(0, 100)}
            plans[f"undecided_{metric.lower()}"] = share, settings
    return plans


def _plans(
    case: Case, illuminance: xr.Dataset, numbers: dict[str, Any],
    plans: dict[str, tuple[xr.DataArray, dict[str, Any]]],
) -> dict[str, Figure]:  # fmt: skip
    """Draw plans, values (sensor,) and settings of each by its name, on every sheet."""
    every, spaces, drawn = sheets(illuminance), sensors_by_space(illuminance), {}
    at = np.column_stack([illuminance[axis].values for axis in "xy"])
    of, turned = f" of all {len(every)} plans" if len(every) > 1 else "", turned_text(case)
    words = caption(case, illuminance, numbers, of)
    for values, settings in plans.values():  # all sheets have the same colours
        known = np.ma.masked_invalid(values.values.astype(float))
        settings["norm"] = scale(known, settings.get("norm"), settings.get("limit"))
    for k, sheet in enumerate(every[:MOST_SHEETS], start=1):
        number = f"_{k}" if len(every) > 1 else ""
        lines = outlines_in_plan(case, at[sheet.sensors], sheet)
        where = _where(spaces, sheet, k, len(every))
        for name, (values, settings) in plans.items():
            here = values[sheet.sensors]
            if name.startswith("undecided") and not ((here > 0) & (here < 100)).any():
                continue
            title = f"{case.name}: {settings['title']}{where}"
            stated = settings.get("caption", words)
            drawn[f"{name}{number}_plan.png"] = plots.plan(
                here,
                **settings | lines | {"title": title, "caption": stated + turned},
            )
    return drawn


def _where(spaces: Sequence[SensorsOfSpace], sheet: Sheet, number: int, count: int) -> str:
    """Words for a sheet of several, by its storey if it is one, and for sensors not facing up."""
    heights = f"{sheet.low:.2f} m"
    if sheet.high > sheet.low + 0.005:
        heights = f"{sheet.low:.2f} to {sheet.high:.2f} m"
    parts = [] if sheet.faces_up else ["on planes across the arrows"]
    storeys = {space.storey for space in spaces if np.isin(space.sensors, sheet.sensors).any()}
    parts += [on_a_line(name) for name in storeys if name and len(storeys) == 1]
    if count > 1:
        parts.append(f"plan {number} of {count}, points at {heights}")
    return "".join(f"; {part}" for part in parts)


def monthly(case: Case, illuminance: xr.Dataset, numbers: dict[str, Any]) -> Figure:
    """Draw the metrics of an evaluation and of its months; arguments as for `pictures`."""
    return plots.monthly(
        numbers, title=case.name, caption=caption(case, illuminance, numbers),
        period=period_name(case.period), rated=is_rated(case), shade=has_shade(case, illuminance),
    )  # fmt: skip


def has_shade(case: Case, illuminance: xr.Dataset) -> bool:
    """True if a shade was simulated, by the attribute of E or, without it, by the case."""
    return bool(illuminance.attrs.get("has_shade", case.shading is not None))
