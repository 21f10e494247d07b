"""Metrics of the spaces of a building, of its storeys, and of the whole by area."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_grid
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
        known = json.loads(str(illuminance.attrs.get("spaces", "[]")))
        told = [(s["name"], s["use"], s["storey"], float(s["floor_area"])) for s in known]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        remedy = "compute the illuminance anew"
        raise InputError("illuminance", "spaces", f"{error}"[:120], remedy) from None
    if len(told) == 1:
        return (SensorsOfSpace(*told[0], np.arange(illuminance.sizes["sensor"])),)
    if not told or "space" not in illuminance.coords:
        return ()
    names = illuminance["space"].values.astype(str)
    spaces = (SensorsOfSpace(*each, np.flatnonzero(names == str(each[0]))) for each in told)
    return tuple(space for space in spaces if len(space.sensors))


def by_space(illuminance: xr.Dataset, draws: Draws | None, numbers_of: NumbersOf) -> dict[str, Any]:
    """Metrics of every space, storey, and of the building.

    Parameters
    ----------
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
    spaces = sensors_by_space(illuminance)
    if not spaces:
        return {}
    drawn = [None if draws is None else _drawn(draws, illuminance, s.sensors) for s in spaces]
    rows = [
        {
            "name": s.name, "use": s.use, "storey": s.storey, "floor_area": round(s.floor_area, 3),
            **numbers_of(s.sensors, its),
        }
        for s, its in zip(spaces, drawn, strict=True)
    ]  # fmt: skip
    storeys = dict.fromkeys(space.storey for space in spaces)
    out: dict[str, Any] = {"spaces": rows}
    if len(storeys) > 1:
        out["storeys"] = [
            {"name": storey, **_mean(rows, drawn, [s.storey == storey for s in spaces])}
            for storey in storeys
        ]
    return out | {"building": _mean(rows, drawn, [True] * len(spaces))}


def _drawn(draws: Draws, illuminance: xr.Dataset, sensors: np.ndarray) -> DrawnShares:
    """Draws of the sensors of a space, which grids do not leave."""
    grids = sensors_by_grid(illuminance)
    if not grids:
        return draws
    mine = set(sensors.tolist())
    own = {name: len(each) for name, each in grids.items() if int(each[0]) in mine}
    return DrawnShares.mean([draws.grids[name] for name in own], list(own.values()))


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
