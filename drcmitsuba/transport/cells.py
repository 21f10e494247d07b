"""Cells: the small patches of diffuse surface between gather and deposit.

A cell is all diffuse surface within one cube of a regular grid that faces the same of six axis
directions. Only cells that gather paths met exist; points drawn from the vertices of these paths
represent them, so that the deposit is estimated where the sensors look.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene.scene import Scene

MAX_KEYS = 1 << 26
"""Largest number of possible cells, which take 0.6 GiB."""
GROWTH = 8.0
"""Distance beyond the near bounds, in cubes, at which cubes are twice as large."""
_UNKNOWN = 0xFFFFFFFF
# Multiplication by an odd number permutes the 32-bit integers.
_SCRAMBLE = 0x9E3779B1


@dataclass(frozen=True)
class Grid:
    """Regular grid over a scene; `key` numbers its cubes and six facings."""

    low: tuple[float, float, float]
    """Corner of the grid [m]."""
    count: tuple[int, int, int]
    """Cubes along x, y, z."""
    size: float
    """Edge of a cube [m]."""
    near: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Bounds beyond which cubes grow with the distance [m]; None where none do."""

    @classmethod
    def of(cls, scene: Scene, size: float) -> Grid:
        """Grid over the bounds of a scene.

        Raises
        ------
        InputError
            The scene is so large that the cells would not fit in memory.
        """
        if scene.near is not None:
            return cls._around(scene, size)
        # The grid starts at the room's corner, the origin: objects outside move no cell.
        low = scene.low
        if scene.enclosure is not None:
            low = size * np.floor(low / size + 1e-6)
        # Surfaces must not lie on borders of cubes, where rounding decides.
        low = low - 0.37 * size
        return cls._checked(scene, low, scene.high - low, size)

    @classmethod
    def _around(cls, scene: Scene, size: float) -> Grid:
        """Grid over a model: cubes of terrain and towers are as large as an eighth of their way."""
        assert scene.near is not None
        # As for a box: the model's corner, the origin, decides where cubes begin.
        inner = (size * np.floor(scene.near[0] / size + 1e-6) - 0.37 * size).tolist()
        outer = (scene.near[1] + 0.37 * size).tolist()
        x, y, z = (float(v) for v in inner)
        grid = cls((x, y, z), (1, 1, 1), size, (tuple(inner), tuple(outer)))
        ends = (scene.low - 0.37 * size, scene.high)
        steps = (grid.steps(mi.Point3f(*map(float, end))) for end in ends)
        low, high = (np.array([float(v[0]) for v in at]) for at in steps)
        start = np.floor(low)
        count = cls._checked(scene, start * size, (high - start) * size, size).count
        x, y, z = (float(v) for v in start)
        return replace(grid, low=(x, y, z), count=count)

    @classmethod
    def _checked(cls, scene: Scene, low: np.ndarray, extent: np.ndarray, size: float) -> Grid:
        """Grid of cubes from a corner, over an extent [m]; refuses too many."""
        count = np.ceil(extent / size + 0.01).astype(int) + 1
        if 6 * int(np.prod(count.astype(float))) > MAX_KEYS:
            whole = " × ".join(f"{v:.4g}" for v in scene.high - scene.low)
            raise InputError(
                "case", "accuracy.cell_size", f"{size:g} m in a scene of {whole} m",
                "take larger cells or a smaller scene",
            )  # fmt: skip
        x, y, z = (float(v) for v in low)
        return cls((x, y, z), (int(count[0]), int(count[1]), int(count[2])), size)

    def __len__(self) -> int:
        """Count the possible cells."""
        return 6 * self.count[0] * self.count[1] * self.count[2]

    def key(self, p: mi.Point3f, n: mi.Normal3f) -> mi.UInt32:
        """Key of the cell at points `p` with facing normals `n`."""
        if self.near is None:
            q = dr.floor((p - mi.Point3f(*self.low)) * (1 / self.size))
        else:
            q = dr.floor(self.steps(p) - mi.Point3f(*self.low))
        nx, ny, nz = self.count
        i = mi.UInt32(dr.clip(q.x, 0, nx - 1))
        j = mi.UInt32(dr.clip(q.y, 0, ny - 1))
        k = mi.UInt32(dr.clip(q.z, 0, nz - 1))
        a = dr.abs(n)
        axis = dr.select((a.x >= a.y) & (a.x >= a.z), 0, dr.select(a.y >= a.z, 1, mi.UInt32(2)))
        along = dr.select(axis == 0, n.x, dr.select(axis == 1, n.y, n.z))
        facing = 2 * axis + dr.select(along > 0, mi.UInt32(1), 0)
        return ((k * ny + j) * nx + i) * 6 + facing

    def steps(self, p: mi.Point3f) -> mi.Point3f:
        """Coordinates in cubes from the near bounds' corner; the steps grow beyond the bounds."""
        assert self.near is not None
        low, high = (mi.Point3f(*corner) for corner in self.near)
        scale = 1 / (GROWTH * self.size)
        within = dr.clip(p, low, high)
        beyond = GROWTH * dr.log(1 + dr.abs(p - within) * scale)
        return (within - low) * (1 / self.size) + dr.copysign(beyond, p - within)


@dataclass(frozen=True)
class Vertices:
    """Diffuse vertices of gather paths, one entry each; one of weight 0 is none."""

    row: mi.UInt32
    """Row of the path: replicate · sensors + sensor."""
    weight: mi.Float
    """Throughput: contribution to the sensor's illuminance per irradiance on the vertex."""
    key: mi.UInt32
    """Key of the cell."""
    tag: mi.UInt32
    """Number of the vertex, independent of the order of threads."""
    p: mi.Float
    n: mi.Float
    """Position [m] and facing normal, three numbers a vertex."""
    mark: mi.UInt32 | None = None
    """Mark of the path, see `gather.Marks`."""
    within: mi.Bool | None = None
    """Whether the path began in a room of a model and has passed no pane."""

    def __len__(self) -> int:
        """Count the vertices."""
        return dr.width(self.weight)


@dataclass(frozen=True)
class Cells:
    """The cells known so far."""

    grid: Grid
    index: mi.UInt32
    """Cell of every key of the grid; `_UNKNOWN` for none."""
    count: int
    """Number of cells."""

    @classmethod
    def none(cls, grid: Grid) -> Cells:
        """Begin without cells."""
        return cls(grid, dr.full(mi.UInt32, _UNKNOWN, len(grid)), 0)

    def of(self, vertices: Vertices) -> mi.UInt32:
        """Cell of every vertex, 0 for none."""
        return dr.gather(mi.UInt32, self.index, vertices.key, vertices.weight > 0)

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
        """Add the new cells that vertices lie in, in the order of their keys."""
        if len(vertices) == 0:
            return self
        met = dr.zeros(mi.UInt32, len(self.grid))
        dr.scatter(met, mi.UInt32(1), vertices.key, vertices.weight > 0)
        new = dr.compress((met == 1) & (self.index == _UNKNOWN))
        if dr.width(new) == 0:
            return self
        index = mi.UInt32(self.index)
        dr.scatter(
            index, dr.opaque(mi.UInt32, self.count) + dr.arange(mi.UInt32, dr.width(new)), new
        )
        dr.eval(index)
        return replace(self, index=index, count=self.count + dr.width(new))

    def blocks(self, edge: int) -> tuple[mi.UInt32, int]:
        """Block of every cell, `edge` cells along each edge, and the number of blocks."""
        return self._in_cubes(edge, layers=False)

    def flat_blocks(self, edge: int) -> tuple[mi.UInt32, int]:
        """Blocks of one layer of cells: a table and the floor under it are in two blocks."""
        return self._in_cubes(edge, layers=True)

    def _in_cubes(self, edge: int, *, layers: bool) -> tuple[mi.UInt32, int]:
        if self.count == 0:
            return mi.UInt32(), 0
        key = dr.compress(self.index != _UNKNOWN)
        nx, ny, _ = self.grid.count
        facing, cube = key % 6, key // 6
        axis = facing // 2 if layers else mi.UInt32(3)  # 3: none
        places = (cube % nx, cube // nx % ny, cube // (nx * ny))
        i, j, k = (dr.select(axis == a, place, place // edge) for a, place in enumerate(places))
        coarse = (((k * ny) + j) * nx + i) * 6 + facing
        kinds, number = np.unique(coarse.numpy(), return_inverse=True)
        block = dr.zeros(mi.UInt32, self.count)
        at = dr.gather(mi.UInt32, self.index, key)
        dr.scatter(block, flat_indices(number), at)
        dr.eval(block)
        return block, len(kinds)


class Drawn(NamedTuple):
    """Vertices that stand for the cells."""

    rank: mi.UInt32
    """Rank of the drawn vertex, the largest in its cell."""
    p: mi.Float
    n: mi.Float
    """Positions and normals, three numbers a cell."""
    within: mi.Bool | None = None
    """Whether the points lie in the rooms of a model; None where nothing tells."""


def draw_points(
    vertices: Vertices, cell: mi.UInt32, count: int, salt: int, before: Drawn | None = None
) -> Drawn:
    """Draw one vertex at random from each of `count` cells; each `salt` gives another draw.

    `cell` holds the cell of every vertex. The draw extends `before`, a draw among earlier vertices.
    """
    return _draws(vertices, cell, count, [before], salt, weighted=False)[0]


def draw_all(
    vertices: Vertices, cell: mi.UInt32, count: int, before: Sequence[Drawn | None], *,
    weighted: bool = False,
) -> tuple[Drawn, ...]:  # fmt: skip
    """Extend the draws `before` of all replicates, as `draw_points` does.

    A `weighted` draw takes vertices in proportion to their weights.
    """
    return _draws(vertices, cell, count, before, 0, weighted=weighted)


def _draws(
    vertices: Vertices, cell: mi.UInt32, count: int, before: Sequence[Drawn | None], salt: int, *,
    weighted: bool,
) -> tuple[Drawn, ...]:  # fmt: skip
    """Extend draws of the salts from `salt` on: all in one launch, whatever their number."""
    told = vertices.within is not None
    if count == 0:  # no path met a surface
        none = mi.UInt32(), mi.Float(), mi.Float(), mi.Bool() if told else None
        return tuple(Drawn(*none) for _ in before)
    every = _joined(before, count, told)
    draws, stride, first = (dr.opaque(mi.UInt32, n) for n in (len(before), count, salt))
    _rank(vertices, cell, every, draws, stride, first, weighted)
    dr.eval(every.rank)
    tag = dr.zeros(mi.UInt32, dr.width(every.rank))
    dr.make_opaque(tag)
    _break_ties(vertices, cell, every, tag, draws, stride, first, weighted)
    dr.eval(tag)
    _place(vertices, cell, every, tag, draws, stride, first, weighted)
    dr.eval(every)
    at = dr.arange(mi.UInt32, count)
    parts = []
    for i in range(len(before)):
        entry = at + dr.opaque(mi.UInt32, i * count)
        rank, p, n = (
            dr.gather(mi.UInt32, every.rank, entry),
            *(dr.ravel(dr.gather(mi.Point3f, values, entry)) for values in (every.p, every.n)),
        )
        within = dr.gather(mi.Bool, every.within, entry) if told else None
        parts.append(Drawn(rank, p, n, within))
    dr.eval(parts)
    return tuple(parts)


def _ranks(vertices: Vertices, salt: mi.UInt32, weighted: bool) -> mi.UInt32:
    """Rank of every vertex in a draw; the largest in a cell wins, whatever the order of threads."""
    rank = (vertices.tag ^ (salt * mi.UInt32(0x85EBCA6B))) * _SCRAMBLE
    if not weighted:
        return rank
    # w / −ln(1 − v) is the largest with probability w / Σw; positive floats sort as integers. The
    # last steps of MurmurHash3 make the v of neighbouring tags independent.
    rank = (rank ^ (rank >> 16)) * mi.UInt32(0x85EBCA6B)
    rank = (rank ^ (rank >> 13)) * mi.UInt32(0xC2B2AE35)
    v = (mi.Float(rank ^ (rank >> 16)) + 0.5) * 2.0**-32
    time = dr.select(v < 1e-3, v + 0.5 * dr.square(v), -dr.log(dr.maximum(1 - v, 2.0**-24)))
    return dr.reinterpret_array(mi.UInt32, vertices.weight / time)


@dr.syntax
def _rank(
    vertices: Vertices, cell: mi.UInt32, every: Drawn, draws: mi.UInt32, stride: mi.UInt32,
    first: mi.UInt32, weighted: bool,
) -> None:  # fmt: skip
    """Find the largest ranks."""
    met, draw = vertices.weight > 0, mi.UInt32(0)
    while dr.hint(
        draw < draws, exclude=[vertices, cell, every, draws, stride, first, met, weighted]
    ):
        rank = _ranks(vertices, first + draw, weighted)
        dr.scatter_reduce(dr.ReduceOp.Max, every.rank, rank, draw * stride + cell, met)
        draw += 1


@dr.syntax
def _break_ties(
    vertices: Vertices, cell: mi.UInt32, every: Drawn, tag: mi.UInt32, draws: mi.UInt32,
    stride: mi.UInt32, first: mi.UInt32, weighted: bool,
) -> None:  # fmt: skip
    """Find the largest tag among the vertices of the largest rank."""
    met, draw = vertices.weight > 0, mi.UInt32(0)
    while dr.hint(
        draw < draws, exclude=[vertices, cell, every, tag, draws, stride, first, met, weighted]
    ):
        at = draw * stride + cell
        rank = _ranks(vertices, first + draw, weighted)
        wins = met & (dr.gather(mi.UInt32, every.rank, at, met) == rank)
        dr.scatter_reduce(dr.ReduceOp.Max, tag, vertices.tag, at, wins)
        draw += 1


@dr.syntax
def _place(
    vertices: Vertices, cell: mi.UInt32, every: Drawn, tag: mi.UInt32, draws: mi.UInt32,
    stride: mi.UInt32, first: mi.UInt32, weighted: bool,
) -> None:  # fmt: skip
    """Keep the points of the vertices that have won."""
    each = dr.arange(mi.UInt32, len(vertices))
    p, n = (dr.gather(mi.Point3f, values, each) for values in (vertices.p, vertices.n))
    met, draw = vertices.weight > 0, mi.UInt32(0)
    while dr.hint(
        draw < draws,
        exclude=[vertices, cell, every, tag, draws, stride, first, met, p, n, weighted],
    ):
        at = draw * stride + cell
        rank = _ranks(vertices, first + draw, weighted)
        wins = met & (dr.gather(mi.UInt32, every.rank, at, met) == rank)
        wins &= dr.gather(mi.UInt32, tag, at, met) == vertices.tag
        dr.scatter(every.p, p, at, wins)
        dr.scatter(every.n, n, at, wins)
        if dr.hint(every.within is not None, mode="scalar"):
            dr.scatter(every.within, vertices.within, at, wins)
        draw += 1


def _joined(before: Sequence[Drawn | None], count: int, told: bool) -> Drawn:
    """Copies of draws one after another, each with room for `count` cells."""
    whole = len(before) * count
    p, n = (dr.zeros(mi.Float, 3 * whole) for _ in range(2))
    within = dr.zeros(mi.Bool, whole) if told else None
    every = Drawn(dr.zeros(mi.UInt32, whole), p, n, within)
    for name, column in every._asdict().items():
        if column is None:
            continue
        step = dr.width(column) // len(before)
        for i, old in enumerate(before):
            values = None if old is None else getattr(old, name)
            if values is not None and dr.width(values):
                to = dr.arange(mi.UInt32, dr.width(values)) + dr.opaque(mi.UInt32, i * step)
                dr.scatter(column, values, to)
        dr.eval(column)  # Dr.Jit 1.5 ignores a pending scatter when it reduces
    return every
