"""From illuminance to the numbers, settings and pictures that a user reads."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from drcmitsuba import metrics, plots
from drcmitsuba.case import Case, Metrics
from drcmitsuba.metrics import Interval
from drcmitsuba.scene import boxes
from drcmitsuba.schema import luminance

Z95 = 1.96


def _interval(values: list[float]) -> Interval:
    """Value and bounds from a metric of E, E − 1.96 s and E + 1.96 s."""
    value, low, high = values
    return Interval(value, min(value, low), max(value, high))


def _monthly(values: list[xr.DataArray]) -> list[dict[str, float] | None]:
    """Twelve intervals, January first; None for a month without hours."""
    rows = np.stack([v.values for v in values], axis=-1)
    return [None if np.isnan(r[0]) else _interval(list(map(float, r))).as_dict() for r in rows]


def _shares_by_month(closed: xr.DataArray) -> xr.DataArray:
    """Share of the hours of each month with the shade closed [%], NaN without hours."""
    month = closed["clock" if "clock" in closed.coords else "time"].dt.month
    shares = closed.astype(float).groupby(month.rename("month")).mean() * 100
    return shares.reindex(month=np.arange(1, 13))


def summarise(
    illuminance: xr.Dataset, thresholds: Metrics, *,
    shade_threshold: float, shade_area: float, step_hours: float,
) -> dict[str, Any]:  # fmt: skip
    """Compute all metrics with their 95 % intervals.

    The interval of a metric is its value with every illuminance 1.96 standard errors lower and
    higher. It takes the errors of all sensors and hours to go the same way, which they only partly
    do (cells are shared, first bounces are not), so it is wider than 95 % calls for.

    Parameters
    ----------
    illuminance : xr.Dataset
        As from `accumulate.illuminance`.
    thresholds : Metrics
    shade_threshold, shade_area : float
        When the shade closes: share of the sensors with at least so much direct sun [lx].
    step_hours : float
        Length of the intervals [h].

    Returns
    -------
    dict
        `sDA`, `ASE`, `shade_closed`: {"value", "low", "high"} [%]; `msDA`, `MSE`,
        `shade_closed_monthly`: 12 of these or None.
    """
    t = thresholds
    total, direct = (
        [
            luminance(illuminance[name]) + z * luminance(illuminance[f"{name}_se"])
            for z in (0, -Z95, Z95)
        ]
        for name in ("total", "direct_sun")
    )
    has_shade = bool(illuminance.attrs.get("has_shade", 1))
    shut = [metrics.shade_closed(d, shade_threshold, shade_area) & has_shade for d in direct]
    hours = {"hours": t.ase_hours, "step_hours": step_hours}
    return {
        "sDA": _interval(
            [metrics.sda(e, t.sda_threshold, t.sda_fraction) for e in total]
        ).as_dict(),
        "ASE": _interval([metrics.ase(e, t.ase_threshold, **hours) for e in direct]).as_dict(),
        "shade_closed": _interval([100 * float(c.mean()) for c in shut]).as_dict(),
        "msDA": _monthly([metrics.msda(e, t.sda_threshold, t.sda_fraction) for e in total]),
        "MSE": _monthly([metrics.mse(e, t.ase_threshold, **hours) for e in direct]),
        "shade_closed_monthly": _monthly([_shares_by_month(c) for c in shut]),
    }


def _outlines(case: Case) -> dict[str, Any]:
    """Room, furniture and glazing in plan; empty without a room, or where the room is turned."""
    if case.room is None or case.room.rotation:
        return {}
    width, depth, _ = case.room.size
    corners = np.array([[0, 0], [width, 0], [width, depth], [0, depth]], float)
    sides = dict(zip(("south", "east", "north", "west"), range(4), strict=True))
    glazed = [
        corners[[sides[side], (sides[side] + 1) % 4]]
        for side, facade in case.facade.items()
        if any(strip.material != "wall" for strip in facade.strips)
    ]
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    desks = [c[:2] + unit * s[:2] for piece in case.furniture for c, s in boxes(piece)]
    return {"room": [corners], "desks": desks, "facade": glazed}


def pictures(case: Case, illuminance: xr.Dataset, numbers: dict[str, Any]) -> dict[str, Figure]:
    """Draw the plots of an evaluation, by file name."""
    outlines = _outlines(case)
    total, direct = luminance(illuminance["total"]), luminance(illuminance["direct_sun"])
    mean = total.mean("time").assign_attrs(units="lx", long_name="mean illuminance")
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
    }  # fmt: skip
