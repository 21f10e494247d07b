"""Cells: the small patches of diffuse surface between gather and deposit.

A cell is all diffuse surface within one cube of a regular grid that faces the same of six axis
directions. Any geometry works without a parametrisation. Only cells that gather paths met exist;
each is represented by points that were drawn from those very paths, so that the deposit is
estimated where the sensors look.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.scene import Scene

MAX_KEYS = 1 << 26
"""Largest number of possible cells: they take 0.6 GiB."""
_UNKNOWN = 0xFFFFFFFF
# Odd numbers make multiplication a bijection of 32-bit integers: a random order that can be undone.
_SCRAMBLE = 0x9E3779B1


@dataclass(frozen=True)
class Grid:
    """Regular grid over a scene; `key` numbers its cubes and six facings.

    Parameters
    ----------
    low : tuple of float
        Corner of the grid [m].
    count : tuple of int
        Cubes along x, y, z.
    size : float
        Edge of a cube [m].
    """

    low: tuple[float, float, float]
    count: tuple[int, int, int]
    size: float

    @classmethod
    def of(cls, scene: Scene, size: float) -> Grid:
        """Grid over the bounds of a scene.

        Raises
        ------
        InputError
            The scene is so large that the cells would not fit in memory.
        """
        # Laid from the room's corner, the origin, so that what stands outside moves no cell.
        low = scene.low
        if scene.enclosure is not None:
            low = size * np.floor(low / size + 1e-6)
        # Surfaces on a border of the grid must not flip between two cubes by rounding.
        low = low - 0.37 * size
        count = np.ceil((scene.high - low) / size + 0.01).astype(int) + 1
        if 6 * int(np.prod(count.astype(float))) > MAX_KEYS:
            extent = " × ".join(f"{v:.4g}" for v in scene.high - scene.low)
            raise InputError(
                "case", "accuracy.cell_size", f"{size:g} m in a scene of {extent} m",
                "take larger cells or a smaller scene",
            )  # fmt: skip
        x, y, z = (float(v) for v in low)
        return cls((x, y, z), (int(count[0]), int(count[1]), int(count[2])), size)

    def __len__(self) -> int:
        """Count the possible cells."""
        return 6 * self.count[0] * self.count[1] * self.count[2]

    def key(self, p: mi.Point3f, n: mi.Normal3f) -> mi.UInt32:
        """Key of the cell at points `p` with facing normals `n`."""
        q = dr.floor((p - mi.Point3f(*self.low)) * (1 / self.size))
        nx, ny, nz = self.count
        i = mi.UInt32(dr.clip(q.x, 0, nx - 1))
        j = mi.UInt32(dr.clip(q.y, 0, ny - 1))
        k = mi.UInt32(dr.clip(q.z, 0, nz - 1))
        a = dr.abs(n)
        axis = dr.select((a.x >= a.y) & (a.x >= a.z), 0, dr.select(a.y >= a.z, 1, mi.UInt32(2)))
        along = dr.select(axis == 0, n.x, dr.select(axis == 1, n.y, n.z))
        facing = 2 * axis + dr.select(along > 0, mi.UInt32(1), 0)
        return ((k * ny + j) * nx + i) * 6 + facing


@dataclass(frozen=True)
class Vertices:
    """Diffuse vertices of gather paths, one entry each.

    Parameters
    ----------
    row : mi.UInt32
        Sensor that the path began at, counted through the replicates.
    weight : mi.Float
        Throughput: irradiance on the vertex times this is its share of the sensor's illuminance.
    key : mi.UInt32
        Key of the cell.
    tag : mi.UInt32
        Number of the vertex in an order that does not depend on threads.
    p, n : mi.Float
        Position [m] and facing normal, three numbers a vertex.
    mark : mi.UInt32 or None
        Mark of the path, see `gather.Marks`.
    """

    row: mi.UInt32
    weight: mi.Float
    key: mi.UInt32
    tag: mi.UInt32
    p: mi.Float
    n: mi.Float
    mark: mi.UInt32 | None = None

    @classmethod
    def none(cls) -> Vertices:
        """No vertex at all."""
        number, value = mi.UInt32, mi.Float
        return cls(number(), value(), number(), number(), value(), value())

    def __len__(self) -> int:
        """Count the vertices."""
        return dr.width(self.weight)


@dataclass(frozen=True)
class Cells:
    """The cells known so far.

    Parameters
    ----------
    grid : Grid
    index : mi.UInt32
        Cell of every key of the grid, or a mark for none.
    count : int
    """

    grid: Grid
    index: mi.UInt32
    count: int

    @classmethod
    def none(cls, grid: Grid) -> Cells:
        """Begin without cells."""
        return cls(grid, dr.full(mi.UInt32, _UNKNOWN, len(grid)), 0)

    def of(self, vertices: Vertices) -> mi.UInt32:
        """Cell of every vertex."""
        return dr.gather(mi.UInt32, self.index, vertices.key)

    @property
    def keys(self) -> mi.UInt32:
        """Key of every cell."""
        keys = dr.zeros(mi.UInt32, self.count)
        known = dr.compress(self.index != _UNKNOWN)
        if dr.width(known):
            dr.scatter(keys, known, dr.gather(mi.UInt32, self.index, known))
        dr.eval(keys)
        return keys

    def extended(self, vertices: Vertices) -> Cells:
        """Add the cells that the vertices met first, in the order of their keys."""
        if len(vertices) == 0:
            return self
        met = dr.zeros(mi.UInt32, len(self.grid))
        dr.scatter(met, mi.UInt32(1), vertices.key)
        new = dr.compress((met == 1) & (self.index == _UNKNOWN))
        if dr.width(new) == 0:
            return self
        index = mi.UInt32(self.index)
        dr.scatter(index, self.count + dr.arange(mi.UInt32, dr.width(new)), new)
        dr.eval(index)
        return replace(self, index=index, count=self.count + dr.width(new))


class Drawn(NamedTuple):
    """Vertices that stand for the cells.

    Parameters
    ----------
    rank : mi.UInt32
        Rank of each vertex among all that it was drawn from; the highest is taken.
    p, n : mi.Float
        Positions and normals, three numbers a cell.
    """

    rank: mi.UInt32
    p: mi.Float
    n: mi.Float


def draw_points(
    vertices: Vertices, cell: mi.UInt32, count: int, salt: int, before: Drawn | None = None
) -> Drawn:
    """Draw one vertex at random from each cell.

    Parameters
    ----------
    vertices : Vertices
    cell : mi.UInt32
        Cell of every vertex.
    count : int
        Number of cells.
    salt : int
        Another salt, another draw.
    before : Drawn, optional
        Vertices drawn before, from others: the draw goes on among all of them.

    Returns
    -------
    Drawn
    """
    # The vertex whose scrambled tag is largest wins: an atomic draw, the same for any threads.
    scrambled = (vertices.tag ^ mi.UInt32(salt * 0x85EBCA6B & 0xFFFFFFFF)) * _SCRAMBLE
    rank = dr.zeros(mi.UInt32, count)
    p, n = dr.zeros(mi.Float, 3 * count), dr.zeros(mi.Float, 3 * count)
    if before is not None and dr.width(before.rank):
        for new, old in zip((rank, p, n), before, strict=True):
            dr.scatter(new, old, dr.arange(mi.UInt32, dr.width(old)))
        dr.eval(rank, p, n)  # Dr.Jit 1.5 reduces onto what was there before a pending scatter
    dr.scatter_reduce(dr.ReduceOp.Max, rank, scrambled, cell)
    wins = dr.gather(mi.UInt32, rank, cell) == scrambled
    for new, values in ((p, vertices.p), (n, vertices.n)):
        dr.scatter(
            new, dr.gather(mi.Point3f, values, dr.arange(mi.UInt32, len(vertices))), cell, wins
        )
    dr.eval(rank, p, n)
    return Drawn(rank, p, n)
