"""From illuminance to the numbers, settings and pictures that a user reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from pydantic import AfterValidator, BaseModel, Field, ValidationError

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.metrics import Interval
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report import plots
from drcmitsuba.report.captions import caption, is_rated, period_name
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.plan_view import scale
from drcmitsuba.report.sheets import Sheet, sheets
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import luminance

MAX_BYTES = 1 << 26
MOST_SHEETS = 20
"""Largest number of sheets that are drawn, from the lowest storey."""


def _of_shares(interval: Interval) -> Interval:
    if not 0 <= interval.low <= interval.value <= interval.high <= 100:
        raise ValueError("not 0 ≤ low ≤ value ≤ high ≤ 100")
    return interval


Share = Annotated[Interval, AfterValidator(_of_shares)]


class Undecided(BaseModel):
    """A sensor whose count is too close to a metric's limit to be decided."""

    sensor: Annotated[int, Field(ge=0)]
    metric: str
    probability: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


Months = Annotated[list[Share | None], Field(min_length=12, max_length=12)]


class GridNumbers(BaseModel):
    """Numbers of a grid that the pictures need."""

    sDA: Share  # noqa: N815
    ASE: Share


class Numbers(BaseModel):
    """Numbers of `metrics.json` that the pictures need; the file holds more."""

    sDA: Share  # noqa: N815
    ASE: Share
    shade_closed: Share
    msDA: Months  # noqa: N815
    MSE: Months
    shade_closed_monthly: Months
    undecided: list[Undecided] = []
    grids: dict[str, GridNumbers] = {}
    settings: dict[str, Any]


def read_numbers(file: Path, sensors: int) -> dict[str, Any]:
    """Read `metrics.json`.

    Raises
    ------
    InputError
        The file is missing, is no JSON, lacks a number, or has another number of sensors.
    """
    remedy = "run evaluate again"
    try:
        if file.exists() and not (file.is_file() and file.stat().st_size <= MAX_BYTES):
            raise InputError(file, "metrics", "no plain file, or too large a one", remedy)
        numbers = json.loads(file.read_text(encoding="utf-8"))
        read = Numbers.model_validate(numbers)
    except InputError:
        raise
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        got = f"{'.'.join(map(str, first['loc']))}, {first['msg'][:120]}"
        raise InputError(file, "metrics", got, remedy) from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(file, "metrics", str(error)[:120], remedy) from None
    if any(u.sensor >= sensors for u in read.undecided):
        got = f"there are {sensors} sensors in illuminance.nc"
        raise InputError(file, "undecided", got, remedy)
    return {**numbers, **read.model_dump()}


def pictures(case: Case, illuminance: xr.Dataset, numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw all pictures of an evaluation, by file name.

    E is as on disk, `total` and `direct_sun` (time, sensor) [lx]; numbers as in `metrics.json`.
    There is a plan for each of the `sheets`; several have a number in their names.
    """
    t = case.metrics
    stamps, step_hours = illuminance.sizes["time"], float(illuminance.attrs.get("step_hours", 1.0))
    total, direct = luminance(illuminance["total"]), luminance(illuminance["direct_sun"])
    mean = total.mean("time", dtype=float).assign_attrs(units="lx", long_name="mean illuminance")
    enough = (total >= t.sda_threshold).sum("time")
    in_sun = (direct >= t.ase_threshold).sum("time")
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
        "illuminance": (mean, {"title": f"mean illuminance{shade}", "texts": averages}),
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
    every, drawn = sheets(illuminance), {}
    at = np.column_stack([illuminance[axis].values for axis in "xy"])
    words = caption(case, illuminance, numbers)
    for values, settings in plans.values():  # all sheets have the same colours
        known = np.ma.masked_invalid(values.values.astype(float))
        settings["norm"] = scale(known, settings.get("norm"), settings.get("limit"))
    for k, sheet in enumerate(every[:MOST_SHEETS], start=1):
        number = f"_{k}" if len(every) > 1 else ""
        lines = outlines_in_plan(case, at[sheet.sensors], sheet)
        for name, (values, settings) in plans.items():
            here = values[sheet.sensors]
            if name.startswith("undecided") and not ((here > 0) & (here < 100)).any():
                continue
            title = f"{case.name}: {settings['title']}{_where(sheet, k, len(every))}"
            drawn[f"{name}{number}_plan.png"] = plots.plan(
                here, **{**settings, **lines, "title": title, "caption": words}
            )
    return drawn


def _where(sheet: Sheet, number: int, count: int) -> str:
    """Words for a sheet of several, and for sensors that do not face up."""
    heights = f"{sheet.low:.2f} m"
    if sheet.high > sheet.low + 0.005:
        heights = f"{sheet.low:.2f} to {sheet.high:.2f} m"
    parts = [] if sheet.faces_up else ["on planes across the arrows"]
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
