"""Metrics of the spaces of a building, of its storeys, and of the whole by area."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_grid, sensors_by_name
from drcmitsuba.metrics.intervals import DrawnShares, Draws
from drcmitsuba.runtime.errors import InputError

ANNUAL, MONTHLY = ("sDA", "ASE"), ("msDA", "MSE")
NumbersOf = Callable[[np.ndarray, "DrawnShares | None"], dict[str, Any]]
"""Metrics with their intervals of some sensors, from their indices and draws."""


@dataclass(frozen=True)
class SensorsOfSpace:
    """Space with the sensors that lie in it."""

    name: str
    use: str
    storey: str
    floor_area: float
    """[m²]."""
    sensors: np.ndarray
    """Indices of its sensors, int, shape (own sensor,)."""


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
    try:
        table = json.loads(str(illuminance.attrs.get("spaces", "[]")))
        told = [(str(s["name"]), s["use"], s["storey"], float(s["floor_area"])) for s in table]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        remedy = "compute the illuminance anew"
        raise InputError("illuminance", "spaces", f"{error}"[:120], remedy) from None
    if len(told) == 1:
        return (SensorsOfSpace(*told[0], np.arange(illuminance.sizes["sensor"])),)
    known = sensors_by_name(illuminance, "space")
    return tuple(SensorsOfSpace(*each, known[each[0]]) for each in told if each[0] in known)


def by_space(
    numbers: Mapping[str, Any], illuminance: xr.Dataset, draws: Draws | None, numbers_of: NumbersOf
) -> dict[str, Any]:
    """Metrics of every space, storey, and of the building.

    Parameters
    ----------
    numbers : mapping
        Metrics of all sensors, and those of the `grids`, where there are several.
    illuminance : xr.Dataset
        Array that `sensors_by_space` knows.
    draws : Draws, optional
        Draws of the metrics.
    numbers_of : callable
        Metrics of some sensors.

    Returns
    -------
    dict
        `spaces`: `name`, `use`, `storey`, `floor_area` [m²], `sensors` and the metrics of each;
        `storeys` where there are several, and `building`: means by floor area. All spaces share
        the draws, so that the intervals know how their errors go together. Empty where there are no
        spaces.
    """
    spaces, grids = sensors_by_space(illuminance), sensors_by_grid(illuminance)
    if not spaces:
        return {}
    of_sensor = np.full(illuminance.sizes["sensor"], -1)
    for k, space in enumerate(spaces):
        of_sensor[space.sensors] = k
    own: list[list[str]] = [[] for _ in spaces]
    for name, sensors in grids.items():  # which no space cuts
        if (k := of_sensor[sensors[0]]) >= 0:
            own[k].append(name)
    drawn = [_drawn(draws, {name: len(grids[name]) for name in names}) for names in own]
    rows = []
    for space, names, its in zip(spaces, own, drawn, strict=True):
        if len(names) == 1:
            known = numbers["grids"][names[0]]
        elif len(space.sensors) == len(of_sensor):
            every = {name: numbers[name] for name in (*ANNUAL, *MONTHLY)}
            known = {"sensors": len(of_sensor), **every}
        else:
            known = numbers_of(space.sensors, its)
        words = {"name": space.name, "use": space.use, "storey": space.storey}
        rows.append({**words, "floor_area": round(space.floor_area, 3), **known})
    storeys = dict.fromkeys(space.storey for space in spaces)
    out: dict[str, Any] = {"spaces": rows}
    if len(storeys) > 1:
        out["storeys"] = [
            {"name": storey, **_mean(rows, drawn, [s.storey == storey for s in spaces])}
            for storey in storeys
        ]
    return out | {"building": _mean(rows, drawn, [True] * len(spaces))}


def _drawn(draws: Draws | None, grids: Mapping[str, int]) -> DrawnShares | None:
    """Draws of grids with so many sensors each; those of all sensors where there is no grid."""
    if draws is None or not grids:
        return draws
    return DrawnShares.mean([draws.grids[name] for name in grids], [*grids.values()])


def _mean(
    rows: Sequence[dict[str, Any]], drawn: Sequence[DrawnShares | None], chosen: Sequence[bool]
) -> dict[str, Any]:
    """Mean of some spaces by area, with its interval."""
    some = [(row, its) for row, its, take in zip(rows, drawn, chosen, strict=True) if take]
    areas = [row["floor_area"] for row, _ in some]
    known = [its for _, its in some if its is not None]
    joint = DrawnShares.mean(known, areas) if known else None

    def interval(parts: list[dict[str, float]], name: str, month: int | None) -> dict[str, float]:
        ends = {
            end: float(np.average([part[end] for part in parts], weights=areas))
            for end in ("value", "low", "high")
        }
        return ends if joint is None else joint.interval(name, ends["value"], month).to_dict()

    def monthly(name: str) -> list[dict[str, float] | None]:
        months = ([row[name][month] for row, _ in some] for month in range(12))
        return [
            None if None in parts else interval(parts, name, month)
            for month, parts in enumerate(months)
        ]

    return {
        "spaces": len(some),
        "floor_area": round(sum(areas), 3),
        "sensors": sum(row["sensors"] for row, _ in some),
        **{name: interval([row[name] for row, _ in some], name, None) for name in ANNUAL},
        **{name: monthly(name) for name in MONTHLY},
    }
