"""Cells that paths of the gather will meet: how many, and a point on some of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.plan.forecast.scout import Scout
from drcmitsuba.plan.forecast.walks import Walked
from drcmitsuba.scene.geometry import boxes, rotation
from drcmitsuba.scene.materials import is_diffuse

CELL_POINTS = 10
"""Points on a face of a cell, to count the cells."""
MOST_POINTS = 1 << 16
MOST = 128
"""Cells that are looked from, and pieces of furniture that cells are told to lie in."""
NEAR = 1e-3
"""Distance in front of a surface that tells where it lies [m]."""
MARGIN = NEAR / 2


@dataclass(frozen=True)
class CellCount:
    """Cells of a scene.

    Parameters
    ----------
    case : Case
    scout : Scout
    walked : Walked
        Paths of the gather that the scout tried.
    low : np.ndarray, shape (3,)
        Where the grid of cells begins [m].
    met : float
        Vertices of all paths that will be traced.
    rng : np.random.Generator
    """

    case: Case
    scout: Scout
    walked: Walked
    low: np.ndarray
    met: float
    rng: np.random.Generator

    def points(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Points and normals of some cells, one each, and how many cells there are.

        In the room, all cells that enough vertices fall on; outside of it, where few are met, as
        many as Chao's estimator makes of the cells that the scout's paths met.
        """
        p, n = self._on_surfaces()
        first = self._first_of_cells(p, n)[0]
        count = len(first) * (1 - np.exp(-self.met / max(1, len(first))))
        walked = self.walked
        outside = ~self._within(walked.p)
        beyond, times = self._first_of_cells(walked.p[outside], walked.n[outside])
        once, twice = (int((times == k).sum()) for k in (1, 2))
        count += len(beyond) + once * (once - 1) / (2 * (twice + 1))
        p = np.concatenate([walked.p[outside][beyond], p[first]])
        n = np.concatenate([walked.n[outside][beyond], n[first]])
        some = self.rng.permutation(len(p))[:MOST]
        if len(beyond) and 0 not in some:  # with one outside, no opening spares rays
            some[0] = 0
        return p[some] + NEAR * n[some], n[some], round(count)

    def _on_surfaces(self) -> tuple[np.ndarray, np.ndarray]:
        """Points spread over both sides of the diffuse surfaces that lie in the room."""
        scout, rng, size = self.scout, self.rng, self.case.accuracy.cell_size
        diffuse = np.array([is_diffuse(m) for m in scout.materials] or [False])
        mine = diffuse[scout.owner] if len(scout.owner) else np.zeros(0, bool)
        corner, u, v, n = (a[mine] for a in (scout.corner, scout.u, scout.v, scout.normal))
        area = np.linalg.norm(np.cross(u, v), axis=1) / 2
        if not self.met or not area.sum():
            return np.zeros((0, 3)), np.zeros((0, 3))
        count = int(np.clip(CELL_POINTS * area.sum() / size**2, 1024, MOST_POINTS))
        at = rng.choice(len(area), count, p=area / area.sum())
        a, b = rng.random((2, count, 1))
        a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
        p = corner[at] + a * u[at] + b * v[at]
        p, n = np.concatenate([p, p]), np.concatenate([n[at], -n[at]])
        there = self._within(p + NEAR * n)
        return p[there], n[there]

    def _first_of_cells(self, p: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First point of every cell that points with normals lie in, and how many there are."""
        axis = abs(n).argmax(axis=1)
        side = 2 * axis + (n[np.arange(len(n)), axis] > 0)
        cubes = np.floor((p - self.low) / self.case.accuracy.cell_size + 0.37).astype(np.int64)
        keys = np.column_stack([cubes, side])
        return np.unique(keys, axis=0, return_index=True, return_counts=True)[1:]

    def _within(self, p: np.ndarray) -> np.ndarray:
        """Which points lie in the room, and in no furniture; all of them without a room."""
        case, local = self.case, p @ rotation(self.case)
        if case.room is None:
            return np.ones(len(p), bool)
        there = ((local > -MARGIN) & (local < np.array(case.room.size) + MARGIN)).all(axis=1)
        pieces = sum(piece.count[0] * piece.count[1] for piece in case.furniture)
        for piece in case.furniture if pieces < MOST else ():
            if piece.size[2] > 0:
                for corner, size in boxes(piece):
                    inside = (local > corner + MARGIN) & (local < corner + size - MARGIN)
                    there &= ~inside.all(axis=1)
        return there
