"""From illuminance to the numbers, settings and pictures that a user reads."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from drcmitsuba import metrics, plots
from drcmitsuba.case import Case
from drcmitsuba.scene import boxes
from drcmitsuba.schema import luminance
from drcmitsuba.uncertainty import Bounds, Draws, Rules, values


def _monthly(
    name: str, values: np.ndarray, spread: Draws | Bounds
) -> list[dict[str, float] | None]:
    """Twelve intervals, January first; None for a month without hours."""
    return [
        None if np.isnan(v) else spread.interval(name, float(v), month).as_dict()
        for month, v in enumerate(values)
    ]


def _undecided(illuminance: xr.Dataset, draws: Draws) -> list[dict[str, Any]]:
    """Sensors whose passing is too close to call, with their probability of it."""
    x, y, z = (illuminance[axis].values for axis in "xyz")
    return [
        {
            "sensor": int(i), "x": float(x[i]), "y": float(y[i]), "z": float(z[i]),
            "metric": metric, "probability": round(float(p[i]), 4),
        }
        for metric, p in draws.passing.items()
        for i in draws.undecided(metric)
    ]  # fmt: skip


def summarise(illuminance: xr.Dataset, rules: Rules, draws: Draws | None = None) -> dict[str, Any]:
    """Compute all metrics with their 95 % intervals.

    Parameters
    ----------
    illuminance : xr.Dataset
        As from `result.illuminance`.
    rules : Rules
        What the metrics ask for.
    draws : Draws, optional
        From `uncertainty.draw`. Without replicates there are none, and the intervals are those of
        `uncertainty.Bounds`: wider than 95 % calls for.

    Returns
    -------
    dict
        `sDA`, `ASE`, `shade_closed`: {"value", "low", "high"} [%]; `msDA`, `MSE`,
        `shade_closed_monthly`: 12 of these or None; with draws `undecided`: the sensors that pass
        in more than 2.5 and less than 97.5 % of them.
    """
    spread = Bounds.of(illuminance, rules) if draws is None else draws
    annual, monthly = values(illuminance, rules)
    numbers: dict[str, Any] = {
        **{name: spread.interval(name, value).as_dict() for name, value in annual.items()},
        **{name: _monthly(name, months, spread) for name, months in monthly.items()},
    }
    if draws is not None:
        numbers["undecided"] = _undecided(illuminance, draws)
    return numbers


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


def _too_close(
    case: Case, illuminance: xr.Dataset, numbers: dict[str, Any], outlines: dict[str, Any]
) -> dict[str, Figure]:
    """Plans of the probability to pass, for metrics with sensors that are too close to call."""
    t, hours = case.metrics, illuminance.sizes["time"]
    step_hours = float(illuminance.attrs.get("step_hours", 1.0))
    asked = {
        "sDA": ("total", t.sda_threshold, metrics.autonomous(t.sda_fraction, hours)),
        "ASE": ("direct_sun", t.ase_threshold, metrics.exposed(t.ase_hours, step_hours)),
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
        **_too_close(case, illuminance, numbers, outlines),
    }  # fmt: skip
