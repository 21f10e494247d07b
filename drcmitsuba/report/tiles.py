"""Sensors in plan: tiles of a grid of any direction, and distances between sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.runtime import lazy

spatial = lazy.module("scipy.spatial")

FEW = 1 << 10
"""Largest number of points between which all distances take less time than SciPy's import."""


def spacing(x: np.ndarray, y: np.ndarray) -> float:
    """Typical distance between neighbours [m], for sensors that form no grid."""
    width, depth = np.ptp(x), np.ptp(y)
    return float(np.sqrt(width * depth / len(x)) or max(width, depth) / len(x) or 1.0)


def closest(x: np.ndarray, y: np.ndarray) -> float:
    """Distance of the closest two sensors [m]; 0 if there are too many for written values."""
    if len(x) > 200:
        return 0.0
    distance = np.hypot(x[:, None] - x, y[:, None] - y)
    return float(distance[~np.eye(len(x), dtype=bool)].min(initial=np.inf))


def around(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Points half a spacing away from all sensors, shape (2·sensor, 2)."""
    centres, half = np.column_stack([x, y]), spacing(x, y) / 2
    return np.concatenate([centres - half, centres + half])


def neighbour_distance(at: np.ndarray) -> float:
    """Distance from a point to its nearest neighbour in plan, the median of all (sensor, 2) [m]."""
    unique = np.unique(np.round(at, 6), axis=0)
    if len(unique) == 1:
        return 0.1
    if len(unique) <= FEW:
        x, y = unique.T
        distance = np.hypot(x[:, None] - x, y[:, None] - y)
        np.fill_diagonal(distance, np.inf)
        return float(np.median(distance.min(axis=1)))
    distance, _ = spatial.cKDTree(unique).query(unique, k=2)
    return float(np.median(distance[:, 1]))


@dataclass(frozen=True)
class SensorTiles:
    """Tiles of a rectangular grid of sensors, turned or with gaps.

    Parameters
    ----------
    corners : np.ndarray, shape (row + 1, column + 1, 2)
        Corners of the tiles x, y [m].
    centres : np.ndarray, shape (row, column, 2)
        Places x, y of the grid, in which its sensors stand [m].
    row, column : np.ndarray of int, shape (sensor,)
        Row and column of each sensor in the grid.
    """

    corners: np.ndarray
    centres: np.ndarray
    row: np.ndarray
    column: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray) -> SensorTiles | None:
        """Tiles that end half way to the next sensor; None if the sensors form no grid.

        A grid's axis is the direction from one sensor to its nearest neighbour.
        """
        if len(x) == 1:
            return None
        distance = np.hypot(x - x[0], y - y[0])
        distance[0] = np.inf
        near = int(distance.argmin())
        if distance[near] == 0:
            return None
        c, s = (x[near] - x[0]) / distance[near], (y[near] - y[0]) / distance[near]
        if abs(c) < abs(s):  # keep rows east-west, so that an upright grid is not turned at all
            c, s = s, -c
        turn = np.array([[c, s], [-s, c]])
        u, v = turn @ [x, y]
        (at_u, column), (at_v, row) = _levels(u, distance[near]), _levels(v, distance[near])
        places = len(at_u) * len(at_v)
        if places > 2 * len(x) or len(np.unique(row * len(at_u) + column)) < len(x):
            return None
        edge_u, edge_v = _edges(at_u, distance[near]), _edges(at_v, distance[near])
        corners, centres = (
            np.stack(np.meshgrid(*along), axis=-1) @ turn
            for along in ((edge_u, edge_v), (at_u, at_v))
        )
        return cls(corners, centres, row, column)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.corners.shape[0] - 1, self.corners.shape[1] - 1

    def grid(self, values: np.ndarray) -> np.ma.MaskedArray:
        """Values of the sensors in the grid, shape (row, column); gaps are masked."""
        grid = np.ma.masked_array(np.zeros(self.shape, values.dtype), mask=True)
        grid[self.row, self.column] = values
        return grid

    def boundary(self, passed: np.ma.MaskedArray) -> np.ndarray:
        """Edges between sensors that `passed` (sensor,) and others: both ends [m], (edge, 2, 2)."""
        grid = self.grid(passed)
        differ = [np.ma.filled(grid[1:] != grid[:-1], False)]
        differ.append(np.ma.filled(grid[:, 1:] != grid[:, :-1], False))
        lying = np.stack([self.corners[1:-1, :-1], self.corners[1:-1, 1:]], axis=2)
        upright = np.stack([self.corners[:-1, 1:-1], self.corners[1:, 1:-1]], axis=2)
        return np.concatenate([lying[differ[0]], upright[differ[1]]])


def _levels(u: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Distinct coordinates, equal within a tenth of the spacing, and the index of each sensor's."""
    order = np.argsort(u)
    level = np.empty(len(u), dtype=int)
    level[order] = np.cumsum(np.diff(u[order], prepend=u[order[0]]) > 0.1 * spacing)
    return np.bincount(level, u) / np.bincount(level), level


def _edges(centres: np.ndarray, spacing: float) -> np.ndarray:
    """Edges half way between centres; a single row is as wide as `spacing`."""
    if len(centres) == 1:
        return centres[0] + np.array([-0.5, 0.5]) * spacing
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - between[0]], between, [2 * centres[-1] - between[-1]]])
