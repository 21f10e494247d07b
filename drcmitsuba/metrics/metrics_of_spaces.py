"""Metrics of the spaces of a building, of its storeys, and of the whole by area."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.intervals import DrawnShares, Draws, Rules
from drcmitsuba.metrics.space_years import SpaceYears
from drcmitsuba.metrics.spaces import SensorsOfSpace

ANNUAL, MONTHLY = ("sDA", "ASE"), ("msDA", "MSE")
ENDS = ("value", "low", "high")


def darkest_first(spaces: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Sort spaces of `by_space` by their sDA, those with the same one by their DA."""
    return sorted(spaces, key=lambda s: (s["sDA"]["value"], s.get("DA", s["sDA"])["value"]))


def by_space(
    numbers: Mapping[str, Any], illuminance: xr.Dataset, draws: Draws | None,
    spaces: Sequence[SensorsOfSpace], years: SpaceYears, rules: Rules,
) -> dict[str, Any]:  # fmt: skip
    """Metrics of every space, storey, and of the building.

    Parameters
    ----------
    numbers : mapping
        Metrics of all sensors, and those of the `grids`, where there are several.
    illuminance : xr.Dataset
        Array with the sensors.
    draws : Draws, optional
        Draws of the metrics.
    spaces : sequence of SensorsOfSpace
        Its spaces, from `sensors_by_space`.
    years : SpaceYears
        Their daylight, of which the autonomy is told.
    rules : Rules
        Rules with the threshold of spaces without a target.

    Returns
    -------
    dict
        `spaces`: `name`, `use`, `storey`, `floor_area` [m²], `sensors` and the metrics of each, its
        `target` [lx], its `hours` [h] (None: all time stamps) and `DA` [%]; `storeys` where there
        are several, and `building`: means by floor area. The metrics of a space of several grids
        are means by the floor that their sensors stand for. All spaces share the draws and the
        variants of E, so that the intervals know how their errors go together. Empty where there
        are no spaces, or several without a grid of their own.
    """
    grids = sensors_by_grid(illuminance)
    if not spaces or (len(spaces) > 1 and not grids):
        return {}
    of_sensor = np.full(illuminance.sizes["sensor"], -1)
    share = np.zeros(len(of_sensor))
    for k, space in enumerate(spaces):
        of_sensor[space.sensors], share[space.sensors] = k, space.shares
    own: list[dict[str, float]] = [{} for _ in spaces]
    for name, sensors in grids.items():  # which no space cuts
        if (k := of_sensor[sensors[0]]) >= 0:
            own[k][name] = float(share[sensors].sum())
    every = {name: numbers[name] for name in (*ANNUAL, *MONTHLY)}
    rows, drawn = [], []
    for k, (space, of_grids) in enumerate(zip(spaces, own, strict=True)):
        parts = [numbers["grids"][name] for name in of_grids] or [every]
        weights = [*of_grids.values()]
        joint: DrawnShares | None = draws
        if draws is not None and of_grids:
            joint = DrawnShares.mean([draws.grids[name] for name in of_grids], weights)
        words = {"name": space.name, "use": space.use, "storey": space.storey}
        told = {**words, "floor_area": round(space.floor_area, 3), "sensors": len(space.sensors)}
        known = parts[0] if len(parts) == 1 else _mean(parts, joint, weights)
        task = {
            "target": space.target or rules.metrics.sda_threshold,
            "hours": None if space.hours is None else list(space.hours),
            "DA": _autonomy(years, [k], [1.0]),
        }
        rows.append({**told, **{n: known[n] for n in every}, **task})
        drawn.append(joint)
    storeys = dict.fromkeys(space.storey for space in spaces)
    out: dict[str, Any] = {"spaces": rows}
    if len(storeys) > 1:
        out["storeys"] = [
            {"name": storey, **_by_area(rows, drawn, years, [s.storey == storey for s in spaces])}
            for storey in storeys
        ]
    return out | {"building": _by_area(rows, drawn, years, [True] * len(spaces))}


def _by_area(
    rows: Sequence[dict[str, Any]], drawn: Sequence[DrawnShares | None], years: SpaceYears,
    chosen: Sequence[bool],
) -> dict[str, Any]:  # fmt: skip
    """Mean of some spaces by floor area, with its interval."""
    some = [(row, its) for row, its, take in zip(rows, drawn, chosen, strict=True) if take]
    areas = [row["floor_area"] for row, _ in some]
    known = [its for _, its in some if its is not None]
    joint = DrawnShares.mean(known, areas) if known else None
    return {
        "spaces": len(some),
        "floor_area": round(sum(areas), 3),
        "sensors": sum(row["sensors"] for row, _ in some),
        **_mean([row for row, _ in some], joint, areas),
        "DA": _autonomy(years, np.flatnonzero(chosen), areas),
    }


def _autonomy(
    years: SpaceYears, spaces: Sequence[int] | np.ndarray, areas: Sequence[float]
) -> dict[str, float]:
    """Mean autonomy of some spaces by floor area [%], with its interval."""
    values = np.average(years.autonomy[:, spaces], axis=1, weights=areas)
    return years.interval(values).within(0.0, 100.0).to_dict()


def _mean(
    rows: Sequence[Mapping[str, Any]], joint: DrawnShares | None, weights: Sequence[float]
) -> dict[str, Any]:
    """Means of metrics by weights, with their intervals from joint draws where there are any."""

    def interval(parts: list[dict[str, float]], name: str, month: int | None) -> dict[str, float]:
        ends = _ends(parts, weights)
        return ends if joint is None else joint.interval(name, ends["value"], month).to_dict()

    def monthly(name: str) -> list[dict[str, float] | None]:
        months = ([row[name][month] for row in rows] for month in range(12))
        return [
            None if None in parts else interval(parts, name, month)
            for month, parts in enumerate(months)
        ]

    return {
        **{name: interval([row[name] for row in rows], name, None) for name in ANNUAL},
        **{name: monthly(name) for name in MONTHLY},
    }


def _ends(parts: Sequence[Mapping[str, float]], weights: Sequence[float]) -> dict[str, float]:
    """Mean of values and of the ends of their intervals, by weights."""
    return {end: float(np.average([part[end] for part in parts], weights=weights)) for end in ENDS}
