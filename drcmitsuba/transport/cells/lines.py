"""Where cells end: at the faces of furniture and partitions, between them at most a cell apart.

Light on a floor changes where a screen or a shelf stands on it. A cell that lies on both sides of
one would lend the bright side's light to the dark one, however thin the screen is. So the cuts of a
grid along each axis follow the planes of the flat surfaces within a room that face this axis, the
largest ones first; no two cuts are nearer to each other than a quarter of a cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drcmitsuba.model.model import areas
from drcmitsuba.scene.geometry import normals

THIN = 0.1
"""Distance up to which parallel planes share a cut [m]: both faces of a plate."""
ASIDE = 1e-3
"""Distance along the facing normal at which a surface looks up its cell [m]: a sheet may lie in a
cut."""
NEAREST = 0.25
"""Least distance of two cuts, in cells."""
WIDER = 0.05
"""Part of a cell by which all cells between two cuts may be larger together."""
STEPS = 64
"""Number of steps of a table in a cell."""
MOST_STEPS = 1 << 17
"""Largest number of steps of a table; longer scenes have no cuts of their own."""
FLAT = 1e-3
"""Largest slope of a plane that counts as facing an axis."""
AT_BOUNDS = 0.05
"""Distance from the bounds of a room within which a plane is one of its walls [m]."""
WALL = 0.25
"""Share of a room's section that a plane covers from which on no block of cells lies on both of
its sides."""


class Cuts(NamedTuple):
    """Cells along one axis."""

    of_step: np.ndarray
    """Cell in which each step from the grid's low end begins."""
    ends: np.ndarray
    """Upper end of every cell, in regular cells from the grid's low end."""
    behind_walls: np.ndarray
    """Cells that begin at a wall."""

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.ends)

    def blocks(self, edge: int) -> np.ndarray:
        """Block of every cell: `edge` cells after another, anew behind every wall."""
        first = np.zeros(self.cells, int)
        first[self.behind_walls] = self.behind_walls
        place = np.arange(self.cells) - np.maximum.accumulate(first)
        return np.asarray(np.cumsum(place % edge == 0) - 1, np.uint32)


def standing(quads: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Quads (quad, 4, 3) that stand within bounds (3,) [m], not on them."""
    first, last = quads.min(axis=1), quads.max(axis=1)
    inside = ((first > low - AT_BOUNDS) & (last < high + AT_BOUNDS)).all(axis=1)
    on_bounds = (last < low + AT_BOUNDS) | (first > high - AT_BOUNDS)
    return np.asarray(quads[inside & ~on_bounds.any(axis=1)])


def planes(quads: np.ndarray) -> list[np.ndarray]:
    """Planes of quads (quad, 4, 3) that face an axis, by axis.

    Returns
    -------
    list of np.ndarray, shape (plane, 2)
        Coordinate [m] and area [m²] of every quad that faces the axis.
    """
    slope, area, centre = np.abs(normals(quads)), areas(quads), quads.mean(axis=1)
    out = []
    for axis in range(3):
        here = np.delete(slope, axis, axis=1).max(axis=1) <= FLAT
        out.append(np.stack([centre[here, axis], area[here]], axis=1))
    return out


def adjoined(quads: np.ndarray, bounds: np.ndarray, near: float) -> list[np.ndarray]:
    """Planes of a room's bounds (2, 3) [m] that quads (quad, 4, 3) outside adjoin, as `planes`.

    The soffit of a balcony goes on where a ceiling ends: no cell may lie on both. Quads adjoin a
    wall that they stand beyond, less than `near` [m] away.
    """
    first, last, extent = quads.min(axis=1), quads.max(axis=1), np.ptp(bounds, axis=0)
    out = []
    for axis in range(3):
        across = np.arange(3) != axis
        beside = (first < bounds[1] + near) & (last > bounds[0] - near)
        beside = beside[:, across].all(axis=1)
        (low, high), section = bounds[:, axis], extent.prod() / extent[axis]
        below = (first[:, axis] < low - AT_BOUNDS) & (last[:, axis] > low - near)
        above = (last[:, axis] > high + AT_BOUNDS) & (first[:, axis] < high + near)
        ends = [end for end, some in ((low, below), (high, above)) if (some & beside).any()]
        out.append(np.array([(end, section) for end in ends]).reshape(-1, 2))
    return out


def cuts(
    plane: np.ndarray, start: float, count: int, size: float, section: float = np.inf,
    bounds: np.ndarray | None = None,
) -> Cuts | None:  # fmt: skip
    """Cut an axis at planes (plane, 2) of a coordinate [m] and an area, else cell by cell.

    `count` cells of `size` [m] begin at `start`; the room has a `section` [m²] across the axis.
    Cuts lie exactly at `bounds`, planes as well. None where no plane asks for a cut.
    """
    bounds = np.zeros((0, 2)) if bounds is None else bounds
    if not len(plane) + len(bounds) or count * STEPS > MOST_STEPS:
        return None
    at, area = _chosen(plane, size, bounds).T
    at = at - start
    within = (at > NEAREST * size) & (at < (count - NEAREST) * size)
    at, area = at[within], area[within]
    if not len(at):
        return None
    ends = np.concatenate([[0.0], at, [count * size]])
    parts = np.maximum(1, np.ceil(np.diff(ends) / size - WIDER)).astype(int)
    inner = [a + (b - a) * np.arange(n) / n for a, b, n in zip(ends, ends[1:], parts, strict=False)]
    every = np.append(np.concatenate(inner)[1:], count * size) / size
    of_step = np.searchsorted(every, np.arange(count * STEPS) / STEPS, side="right")
    behind = np.cumsum(parts)[:-1][area >= WALL * section]
    return Cuts(of_step.astype(np.uint32), every.astype(np.float32), behind)


def _chosen(plane: np.ndarray, size: float, bounds: np.ndarray) -> np.ndarray:
    """Coordinates of cuts, sorted [m], and areas of their planes [m²], shape (cut, 2)."""
    kept: list[tuple[float, float]] = [(float(at), float(area)) for at, area in bounds]
    for least, at in sorted((-area, (low + high) / 2) for low, high, area in _plates(plane)):
        if all(abs(at - other) >= NEAREST * size for other, _ in kept):
            kept.append((at, -least))
    return np.array(sorted(kept))


def _plates(plane: np.ndarray) -> Sequence[tuple[float, float, float]]:
    """Join planes that are at most `THIN` apart: the bounds and the area of each plate."""
    out: list[tuple[float, float, float]] = []
    for at, area in plane[np.argsort(plane[:, 0], kind="stable")]:
        if out and at - out[-1][0] <= THIN:
            low, _, before = out[-1]
            out[-1] = (low, at, before + area)
        else:
            out.append((at, at, area))
    return out
