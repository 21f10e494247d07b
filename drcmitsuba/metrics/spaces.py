"""Metrics of the spaces of a building, of its storeys, and of the whole by area."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_grid, sensors_by_name
from drcmitsuba.metrics.intervals import DrawnShares, Draws
from drcmitsuba.metrics.sensor_areas import area_shares
from drcmitsuba.metrics.space_rows import read_rows

ANNUAL, MONTHLY = ("sDA", "ASE"), ("msDA", "MSE")
ENDS = ("value", "low", "high")


@dataclass(frozen=True)
class SensorsOfSpace:
    """Space with the sensors that lie in it."""

    name: str
    use: str
    storey: str
    floor_area: float
    """[m²]."""
    target: float | None
    """Mean illuminance that its task wants [lx]; None where its use is not known."""
    hours: tuple[int, int] | None
    """First hour of use on the clock, and the end of the last one [h]; None for all."""
    power: float | None
    """Installed power of its lamps [W/m²]; None where it is not known."""
    sensors: np.ndarray
    """Indices of its sensors, int, shape (own sensor,)."""
    shares: np.ndarray
    """Share of its floor that each of them stands for [–], of the sum 1, shape (own sensor,)."""

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> SensorsOfSpace:
        """Space of a row of the attribute `spaces`, without sensors.

        Anything else raises one of `space_rows.DAMAGED`.
        """
        target, hours, power = (row.get(key) for key in ("target", "hours", "power"))
        first, last = (None, None) if hours is None else map(int, hours)
        return cls(
            str(row["name"]), row["use"], row["storey"], float(row["floor_area"]),
            None if target is None else float(target),
            None if first is None or last is None else (first, last),
            None if power is None else float(power), np.empty(0, np.int64), np.empty(0),
        )  # fmt: skip


def sensors_by_space(illuminance: xr.Dataset | xr.DataArray) -> tuple[SensorsOfSpace, ...]:
    """Spaces that have sensors, in the order of the model.

    Parameters
    ----------
    illuminance : xr.Dataset or DataArray
        Array with the dim `sensor`, the attribute `spaces`, and where there are several the
        coordinate `space` (sensor,).

    Returns
    -------
    tuple of SensorsOfSpace
        Empty where the array tells no spaces.

    Raises
    ------
    InputError
        The attribute is no list of spaces.
    """
    told = read_rows(illuminance.attrs, SensorsOfSpace.of_row)
    if len(told) == 1:
        known = {told[0].name: np.arange(illuminance.sizes["sensor"])}
    else:
        known = sensors_by_name(illuminance, "space")
    some = [space for space in told if space.name in known]
    shares = area_shares(illuminance, (known[space.name] for space in some))
    return tuple(
        replace(space, sensors=known[space.name], shares=own)
        for space, own in zip(some, shares, strict=True)
    )


def by_space(
    numbers: Mapping[str, Any], illuminance: xr.Dataset, draws: Draws | None,
    spaces: Sequence[SensorsOfSpace], tasks: Mapping[str, dict[str, Any]],
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
    tasks : mapping of str to dict
        `target` [lx], `hours` [h] and `DA` [%] of every space, from `space_tasks`.

    Returns
    -------
    dict
        `spaces`: `name`, `use`, `storey`, `floor_area` [m²], `sensors`, the metrics and the task of
        each; `storeys` where there are several, and `building`: means by floor area. The metrics of
        a space of several grids are means by the floor that their sensors stand for. All spaces
        share the draws, so that the intervals know how their errors go together. Empty where there
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
    for space, of_grids in zip(spaces, own, strict=True):
        parts = [numbers["grids"][name] for name in of_grids] or [every]
        weights = [*of_grids.values()]
        joint: DrawnShares | None = draws
        if draws is not None and of_grids:
            joint = DrawnShares.mean([draws.grids[name] for name in of_grids], weights)
        words = {"name": space.name, "use": space.use, "storey": space.storey}
        told = {**words, "floor_area": round(space.floor_area, 3), "sensors": len(space.sensors)}
        known = parts[0] if len(parts) == 1 else _mean(parts, joint, weights)
        rows.append({**told, **{n: known[n] for n in every}, **tasks[space.name]})
        drawn.append(joint)
    storeys = dict.fromkeys(space.storey for space in spaces)
    out: dict[str, Any] = {"spaces": rows}
    if len(storeys) > 1:
        out["storeys"] = [
            {"name": storey, **_by_area(rows, drawn, [s.storey == storey for s in spaces])}
            for storey in storeys
        ]
    return out | {"building": _by_area(rows, drawn, [True] * len(spaces))}


def _by_area(
    rows: Sequence[dict[str, Any]], drawn: Sequence[DrawnShares | None], chosen: Sequence[bool]
) -> dict[str, Any]:
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
        "DA": _ends([row["DA"] for row, _ in some], areas),
    }


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
