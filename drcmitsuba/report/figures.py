"""From illuminance to the numbers, settings and pictures that a user reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import shapely
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from pydantic import AfterValidator, BaseModel, Field, ValidationError

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.metrics import Interval
from drcmitsuba.report import plots
from drcmitsuba.report.captions import caption, is_rated, period_name
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import boxes, origin, rotation
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.sensors_of_model import floor_below
from drcmitsuba.schema import luminance

MAX_BYTES = 1 << 26
MOST_HULLS = 20_000
"""Largest number of polygons of the context in a plan, the largest first."""


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


class Numbers(BaseModel):
    """Numbers of `metrics.json` that the pictures need; the file holds more."""

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


def _outlines_of_model(case: Case) -> dict[str, Any]:
    """Level surfaces below the sensors, outer panes and context in plan, world frame [m]."""
    turn, start = rotation(case)[:2, :2].T, origin(case)[:2]
    height = float((sensor_points(case)[0][:, 2] + origin(case)[2]).min())

    def rings(shape: Any) -> list[np.ndarray]:
        shapes = [s for s in getattr(shape, "geoms", [shape]) if s.geom_type == "Polygon"]
        every = (ring for s in shapes for ring in (s.exterior, *s.interiors))
        return [(np.array(ring.coords)[:, :2] - start) @ turn + start for ring in every]

    layers, panes = case.building.layers, panes_of_model(case.building)
    edges = panes.frame[panes.outside][:, :2, :2]
    context = [layer.quads[:, :, :2] for layer in layers if layer.role == "context"]
    quads = np.concatenate([np.zeros((0, 4, 2)), *context])
    across, down = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    size = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
    largest = quads[np.argsort(-size, kind="stable")[:MOST_HULLS]]
    hulls = shapely.union_all(shapely.convex_hull(shapely.multipoints(largest)))
    return {
        "room": rings(floor_below(case.building, height)),
        "glazing": [(edge - start) @ turn + start for edge in edges],
        "surroundings": rings(hulls),
    }


def _outlines(case: Case) -> dict[str, Any]:
    """Room, glazing, furniture and surroundings in plan, in the world's frame [m].

    A piece entirely outside the room's walls belongs to the surroundings. A case without a room or
    a model has no outlines.
    """
    if case.building.layers:
        return _outlines_of_model(case)
    if case.room is None:
        return {}
    width, depth, _ = case.room.size
    corners = np.array([[0, 0], [width, 0], [width, depth], [0, depth]], float)
    turn = rotation(case)[:2, :2].T
    at = [("south", "east", "north", "west").index(side) for side in case.glazed]
    glazed = [corners[[i, (i + 1) % 4]] @ turn for i in at]
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    pieces: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for corner, size in (box for piece in case.furniture for box in boxes(piece)):
        low, high = corner[:2], corner[:2] + size[:2]
        is_inside = bool(((low < corners[2]) & (high > 0)).all())
        pieces[is_inside].append((low + unit * size[:2]) @ turn)
    return {
        "room": [corners @ turn], "glazing": glazed,
        "furniture": pieces[True], "surroundings": pieces[False],
    }  # fmt: skip


def _too_close(
    case: Case, passing: dict[str, xr.DataArray], numbers: dict[str, Any], drawn: dict[str, Any]
) -> dict[str, Figure]:
    """Plans of the probability to pass, for metrics with sensors too close to a limit."""
    figures = {}
    for metric, passes in passing.items():
        undecided = [u for u in numbers.get("undecided", []) if u["metric"] == metric]
        if undecided:
            share = passes * 100.0
            share[[u["sensor"] for u in undecided]] = [100 * u["probability"] for u in undecided]
            figures[f"undecided_{metric.lower()}_plan.png"] = plots.plan(
                share, title=f"{case.name}: probability that a point counts for {metric}",
                label="probability [%]", norm=Normalize(0, 100), **drawn,
            )  # fmt: skip
    return figures


def pictures(case: Case, illuminance: xr.Dataset, numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw all pictures of an evaluation, by file name.

    E is as on disk, `total` and `direct_sun` (time, sensor) [lx]; numbers as in `metrics.json`.
    """
    drawn: dict[str, Any] = {**_outlines(case), "caption": caption(case, illuminance, numbers)}
    total, direct = luminance(illuminance["total"]), luminance(illuminance["direct_sun"])
    mean = total.mean("time", dtype=float).assign_attrs(units="lx", long_name="mean illuminance")
    t, stamps = case.metrics, total.sizes["time"]
    step_hours = float(illuminance.attrs.get("step_hours", 1.0))
    enough = (total >= t.sda_threshold).sum("time")
    in_sun = (direct >= t.ase_threshold).sum("time")
    autonomy_stamps = metrics.autonomy_stamps(t.sda_fraction, stamps)
    exposure_stamps = metrics.exposure_stamps(t.ase_hours, step_hours)
    passing = {"sDA": enough >= autonomy_stamps, "ASE": in_sun >= exposure_stamps}
    shade = ", shade applied" if has_shade(case, illuminance) else ""
    return {
        "illuminance_plan.png": plots.plan(
            mean, title=f"{case.name}: mean illuminance{shade}", **drawn
        ),
        "autonomy_plan.png": plots.plan(
            100 * enough / stamps, title=f"{case.name}: hours with {t.sda_threshold:g} lx{shade}",
            label="share of hours [%]", norm=Normalize(0, 100),
            limit=100 * autonomy_stamps / stamps,
            limit_label=f"{100 * t.sda_fraction:g} % (sDA)", **drawn,
        ),
        "sun_plan.png": plots.plan(
            in_sun * step_hours, label="hours [h]",
            title=f"{case.name}: hours with {t.ase_threshold:g} lx of direct sun", **drawn,
            limit=exposure_stamps * step_hours, limit_label=f"{t.ase_hours:g} h (ASE)",
        ),
        "monthly.png": monthly(case, illuminance, numbers),
        **_too_close(case, passing, numbers, drawn),
    }  # fmt: skip


def monthly(case: Case, illuminance: xr.Dataset, numbers: dict[str, Any]) -> Figure:
    """Draw the metrics of an evaluation and of its months; arguments as for `pictures`."""
    return plots.monthly(
        numbers, title=case.name, caption=caption(case, illuminance, numbers),
        period=period_name(case.period), rated=is_rated(case), shade=has_shade(case, illuminance),
    )  # fmt: skip


def has_shade(case: Case, illuminance: xr.Dataset) -> bool:
    """True if a shade was simulated, by the attribute of E or, without it, by the case."""
    return bool(illuminance.attrs.get("has_shade", case.shading is not None))
