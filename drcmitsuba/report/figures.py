"""From illuminance to the numbers, settings and pictures that a user reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from pydantic import AfterValidator, BaseModel, Field, ValidationError

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.metrics import Interval
from drcmitsuba.report import plots
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import boxes
from drcmitsuba.schema import luminance

MAX_BYTES = 1 << 26


def _of_shares(interval: Interval) -> Interval:
    if not 0 <= interval.low <= interval.value <= interval.high <= 100:
        raise ValueError("not 0 ≤ low ≤ value ≤ high ≤ 100")
    return interval


Share = Annotated[Interval, AfterValidator(_of_shares)]


class Undecided(BaseModel):
    """A sensor that is too close to call."""

    sensor: Annotated[int, Field(ge=0)]
    metric: str
    probability: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


Months = Annotated[list[Share | None], Field(min_length=12, max_length=12)]


class Numbers(BaseModel):
    """What the pictures need of `metrics.json`; it holds more."""

    sDA: Share  # noqa: N815
    ASE: Share
    shade_closed: Share
    msDA: Months  # noqa: N815
    MSE: Months
    shade_closed_monthly: Months
    undecided: list[Undecided] = []
    settings: dict[str, Any]


def read_numbers(file: Path, sensors: int) -> dict[str, Any]:
    """Read `metrics.json`.

    Raises
    ------
    InputError
        It is not there, is no JSON, lacks a number, or is that of another number of sensors.
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


def _outlines(case: Case) -> dict[str, Any]:
    """Room, furniture and glazing in plan; empty without a room, or where the room is turned."""
    if case.room is None or case.room.rotation:
        return {}
    width, depth, _ = case.room.size
    corners = np.array([[0, 0], [width, 0], [width, depth], [0, depth]], float)
    sides = dict(zip(("south", "east", "north", "west"), range(4), strict=True))
    glazed = [corners[[sides[side], (sides[side] + 1) % 4]] for side in case.glazed]
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    desks = [c[:2] + unit * s[:2] for piece in case.furniture for c, s in boxes(piece)]
    return {"room": [corners], "desks": desks, "facade": glazed}


def _too_close(
    case: Case, illuminance: xr.Dataset, numbers: dict[str, Any], outlines: dict[str, Any]
) -> dict[str, Figure]:
    """Plans of the probability to pass, for metrics with sensors that are too close to call."""
    t, hours = case.metrics, illuminance.sizes["time"]
    step_hours = float(illuminance.attrs.get("step_hours", 1.0))
    asked = {
        "sDA": ("total", t.sda_threshold, metrics.autonomy_stamps(t.sda_fraction, hours)),
        "ASE": ("direct_sun", t.ase_threshold, metrics.exposure_stamps(t.ase_hours, step_hours)),
    }
    figures = {}
    for metric, (name, threshold, least) in asked.items():
        undecided = [u for u in numbers.get("undecided", []) if u["metric"] == metric]
        if undecided:
            count = (luminance(illuminance[name]) >= threshold).sum("time")
            passing = (count >= least) * 100.0
            passing[[u["sensor"] for u in undecided]] = [100 * u["probability"] for u in undecided]
            figures[f"undecided_{metric.lower()}_plan.png"] = plots.plan(
                passing, title=f"{case.name}: probability that a point counts for {metric}",
                label="probability [%]", **outlines,
            )  # fmt: skip
    return figures


def pictures(case: Case, illuminance: xr.Dataset, numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw the plots of an evaluation, by file name."""
    outlines = _outlines(case)
    total, direct = luminance(illuminance["total"]), luminance(illuminance["direct_sun"])
    mean = total.mean("time", dtype=float).assign_attrs(units="lx", long_name="mean illuminance")
    limit, sun_limit = case.metrics.sda_threshold, case.metrics.ase_threshold
    reached = (total >= limit).mean("time") * 100
    exposed = (direct >= sun_limit).mean("time") * 100
    return {
        "illuminance_plan.png": plots.plan(
            mean, title=f"{case.name}: mean illuminance, shade applied", **outlines
        ),
        "autonomy_plan.png": plots.plan(
            reached, title=f"{case.name}: hours with {limit:g} lx", label="share of hours [%]",
            **outlines,
        ),
        "sun_plan.png": plots.plan(
            exposed, title=f"{case.name}: hours with {sun_limit:g} lx of direct sun",
            label="share of hours [%]", **outlines,
        ),
        "monthly.png": plots.monthly(numbers, title=case.name),
        **_too_close(case, illuminance, numbers, outlines),
    }  # fmt: skip
