"""Parts of surfaces that the sensors' paths reach.

Walls of models often have two leaves nearer to each other than a cell is large. No light comes
between them, and their inner sides must not count with the area of a cell, by which the flux of the
photons in it is divided. Paths from the sensors tell the sides that matter: they end in cells of
which a fine raster is marked, in the plane of the surface half a cell wide, and across it `LAYER`.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import add_at
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.gather.paths import gather

PATHS = 1 << 20
"""Number of paths."""
ENOUGH = 256
"""Number of vertices in a cell from which on its unmarked parts do not count."""
LAYER = 0.01
"""Step of the raster across a surface [m]; leaves three steps apart are distinguished."""
_TABLE = 1 << 24
"""Number of marks: a raster's field has the mark of its hash, so few fields share one."""


@dataclass(frozen=True)
class ReachedSurfaces:
    """Marks of the fields of surfaces that paths met."""

    grid: CellGrid
    marks: mi.UInt32
    vertices: mi.UInt32
    """Number of vertices by the key of the cell."""

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, grid: CellGrid, seed: int
    ) -> ReachedSurfaces:
        """Mark what paths from points (sensor, 3) meet."""
        paths = -(-PATHS // len(points))
        met = gather(scene, points, normals, replicates=1, paths=paths, grid=grid, seed=seed)
        marks, vertices = dr.zeros(mi.UInt32, _TABLE), dr.zeros(mi.UInt32, len(grid))
        if not len(met):  # black surfaces
            return cls(grid, marks, vertices)
        lane = dr.arange(mi.UInt32, len(met))
        p, n = (dr.gather(mi.Vector3f, column, lane) for column in (met.p, met.n))
        add_at(vertices, mi.UInt32(1), met.key)
        for step in (-1, 0, 1):  # rounding may move a point across a border
            dr.scatter(marks, mi.UInt32(1), _field(grid, mi.Point3f(p), n, step))
        dr.eval(marks, vertices)
        return cls(grid, marks, vertices)

    def counts(self, p: mi.Point3f, n: mi.Vector3f) -> mi.Bool:
        """Whether points on a surface count with the area of their cell on the side of `n`."""
        marked = dr.gather(mi.UInt32, self.marks, _field(self.grid, p, n, 0)) > 0
        few = dr.gather(mi.UInt32, self.vertices, self.grid.key(p, mi.Normal3f(n))) < ENOUGH
        return marked | few


def _field(grid: CellGrid, p: mi.Point3f, n: mi.Vector3f, step: int) -> mi.UInt32:
    """Hash of the field of points on a surface that faces `n`, some steps further across it."""
    layer = dr.floor(dr.dot(n, mi.Vector3f(p)) / LAYER) + step
    p, a = grid.along_walls(p), dr.abs(grid.along_walls(n))
    axis = dr.select((a.x >= a.y) & (a.x >= a.z), 0, dr.select(a.y >= a.z, 1, mi.UInt32(2)))
    q = dr.floor(2 * grid.steps(p))
    numbers = [
        dr.select(axis == 0, 0, q.x), dr.select(axis == 1, 0, q.y), dr.select(axis == 2, 0, q.z),
        layer,
    ]  # fmt: skip
    value = axis * mi.UInt32(0x9E3779B1)
    for number in numbers:
        value = (value ^ mi.UInt32(mi.Int32(number))) * mi.UInt32(0x85EBCA6B)
        value ^= value >> 13
    return value & mi.UInt32(_TABLE - 1)
