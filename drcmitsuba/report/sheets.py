"""Sheets of plans: sensors that one plan can show side by side.

Sensors of different storeys, of grids that lie above each other, and those that do not face up
are on sheets of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report.tiles import neighbour_distance
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError

spatial = lazy.module("scipy.spatial")

MOST_SHEETS = 20
"""Largest number of sheets that are drawn, from the lowest storey."""
STOREY = 1.0
"""Least distance between the heights of sensors of two storeys [m]."""
ABOVE = 0.1
"""Share of a grid's sensors that may stand above those of another on one sheet [–]."""
MOST_PILES = 21
"""Largest number of sheets of one storey: the last one takes all other grids."""
FACES_UP = 1 - 1e-3
"""Least vertical part of the normal of a sensor that counts as horizontal [–]."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """Sensors of one plan."""

    sensors: np.ndarray
    """Indices of the sensors, in increasing order, shape (sensor,)."""
    low: float
    high: float
    """Lowest and highest of them [m]."""
    below: float
    """Height of the highest sensor of the storeys below; −∞ for the lowest storey [m]."""
    above: float
    """Height of the lowest sensor of the storeys above; ∞ for the highest storey [m]."""
    faces_up: bool
    """Whether the sensors face up."""


def sheets(illuminance: xr.Dataset) -> list[Sheet]:
    """Sheets of the sensors of E, from the lowest storey; those that face up first.

    E has the coordinates `x`, `y` [m], and `z` [m], `grid`, `nx`, `ny`, `nz` where there are such.

    Raises
    ------
    InputError
        `x` or `y` is missing, or a position is not finite.
    """
    at = np.column_stack([_finite(illuminance, axis) for axis in "xy"])
    z = _finite(illuminance, "z") if "z" in illuminance.coords else np.zeros(len(at))
    up, grid = facing_up(illuminance), np.zeros(len(at), int)
    for i, sensors in enumerate(sensors_by_grid(illuminance).values()):
        grid[sensors] = i
    storey = _storeys(z)
    # One key for each storey, direction and grid, in this order.
    key = (2 * storey + ~up) * (grid.max() + 1) + grid
    order = np.argsort(key, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
    by_sheet: dict[tuple[int, bool], list[np.ndarray]] = {}
    for part in parts:
        by_sheet.setdefault((int(storey[part[0]]), bool(up[part[0]])), []).append(part)
    low, high = np.full(storey.max() + 2, np.inf), np.full(storey.max() + 2, -np.inf)
    np.minimum.at(low, storey, z)
    np.maximum.at(high, storey, z)
    out = []
    for (k, faces_up), grids in by_sheet.items():
        below, above = float(high[k - 1]), float(low[k + 1])  # the last entries are infinite
        for sensors in _side_by_side(grids, at):
            ends = float(z[sensors].min()), float(z[sensors].max())
            out.append(Sheet(sensors, *ends, below, above, faces_up))
    return out


def facing_up(values: xr.Dataset | xr.DataArray) -> np.ndarray:
    """Whether sensors face up, by the coordinates `nx`, `ny`, `nz`, bool (sensor,)."""
    if {"nx", "ny", "nz"} <= set(values.coords):
        return np.asarray(values["nz"].values >= FACES_UP)
    return np.ones(values.sizes["sensor"], bool)


def _finite(illuminance: xr.Dataset, axis: str) -> np.ndarray:
    """Coordinate of the sensors [m], shape (sensor,)."""
    if axis not in illuminance.coords or illuminance[axis].dims != ("sensor",):
        raise InputError("plan", axis, "no such coordinate of sensor", "give x and y in metres")
    values = illuminance[axis].values.astype(float)
    if not np.isfinite(values).all():
        raise InputError("plan", axis, "a sensor without a place", "give x and y in metres")
    return np.asarray(values)


def _storeys(z: np.ndarray) -> np.ndarray:
    """Storey of every sensor, from 0, by heights [m] between which none stands."""
    order = np.argsort(z, kind="stable")
    storey = np.empty(len(z), int)
    storey[order] = np.cumsum(np.diff(z[order], prepend=z[order[0]]) > STOREY)
    return storey


@dataclass(eq=False)
class _Pile:
    """Grids of one sheet while others are laid beside them."""

    grids: list[np.ndarray] = field(default_factory=list)
    boxes: list[np.ndarray] = field(default_factory=list)
    """Lowest and highest x, y of each grid [m], shape (2, 2)."""

    def has_room(self, at: np.ndarray, grid: np.ndarray, near: float) -> bool:
        """Whether few of a grid's sensors stand within a distance [m] of those of the sheet."""
        low, high = at[grid].min(axis=0) - near, at[grid].max(axis=0) + near
        boxes = np.array(self.boxes)
        meet = ((boxes[:, 0] < high) & (boxes[:, 1] > low)).all(axis=1)
        if not meet.any():
            return True
        beside = np.concatenate([self.grids[i] for i in np.flatnonzero(meet)])
        distance, _ = spatial.cKDTree(at[beside]).query(at[grid])
        return bool((distance < near).mean() <= ABOVE)

    def add(self, at: np.ndarray, grid: np.ndarray) -> None:
        self.grids.append(grid)
        self.boxes.append(np.array([at[grid].min(axis=0), at[grid].max(axis=0)]))


def _side_by_side(grids: list[np.ndarray], at: np.ndarray) -> list[np.ndarray]:
    """Join grids (index arrays) in plan, each with the first ones that it does not stand above.

    `at` (sensor, 2) are the positions of all sensors [m].
    """
    piles: list[_Pile] = []
    for grid in grids:
        near = neighbour_distance(at[grid]) / 2
        free = (pile for pile in piles if pile.has_room(at, grid, near))
        pile = next(free, None)
        if pile is None and len(piles) == MOST_PILES:
            pile = piles[-1]
        if pile is None:
            pile = _Pile()
            piles.append(pile)
        pile.add(at, grid)
    return [np.sort(np.concatenate(pile.grids)) for pile in piles]
