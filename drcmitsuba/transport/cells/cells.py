"""Cells: the small patches of diffuse surface between gather and deposit.

A cell is all diffuse surface within one cube of a grid that faces the same of six axis directions.
The grid is regular but where furniture or partitions stand, at which cells end (`lines`). Only
cells that paths met exist; points drawn from the vertices of these paths (`points`) represent
them, so that the deposit is estimated where the sensors look.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, marked
from drcmitsuba.scene.materials import is_diffuse
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.lines import ASIDE, STEPS, Cuts, cuts, planes, standing
from drcmitsuba.transport.cells.vertices import Vertices

MAX_KEYS = 1 << 26
"""Largest number of possible cells, which take 0.6 GiB."""
GROWTH = 8.0
"""Distance beyond the near bounds, in cubes, at which cubes are twice as large."""
_UNKNOWN = 0xFFFFFFFF


def furniture(scene: Scene) -> np.ndarray:
    """Diffuse quads (quad, 4, 3) that stand in the rooms, apart from their bounds [m].

    There are none where no box and no model bounds the rooms, nor in a box that no axis faces.
    """
    room, bounds = scene.enclosure, scene.near
    if bounds is None and room is not None and room.is_box and room.is_along_axes:
        bounds = np.sort(np.stack([np.zeros(3), room.size]) @ room.turn.T, axis=0)
    quads = [part.quads for part in scene.parts if is_diffuse(part.material)]
    if bounds is None or not quads:
        return np.zeros((0, 4, 3))
    return standing(np.concatenate(quads), *bounds)


@dataclass(frozen=True)
class CellGrid:
    """Regular grid over a scene; `key` numbers its cubes and six facings."""

    low: tuple[float, float, float]
    """Corner of the grid [m]."""
    count: tuple[int, int, int]
    """Cubes along x, y, z."""
    size: float
    """Edge of a cube [m]."""
    near: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Bounds beyond which cubes grow with the distance [m]; None where none do."""
    cuts: tuple[Cuts | None, Cuts | None, Cuts | None] = (None, None, None)
    """Cubes along the axes that furniture cuts; None where they are regular."""

    @classmethod
    def of(cls, scene: Scene, size: float) -> CellGrid:
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
        return cls._checked(scene, low, scene.high - low, size)._cut(scene)

    @classmethod
    def _around(cls, scene: Scene, size: float) -> CellGrid:
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
        return replace(grid, low=(x, y, z), count=count)._cut(scene)

    def _cut(self, scene: Scene) -> CellGrid:
        """Grid whose cubes end where surfaces stand in the rooms."""
        quads = furniture(scene)
        if not len(quads):
            return self
        low = np.array(self.low)
        if self.near is not None:
            low = np.array(self.near[0]) + self.size * low
        x, y, z = (
            cuts(plane, float(start), count, self.size)
            for plane, start, count in zip(planes(quads), low, self.count, strict=True)
        )
        finer = replace(self, cuts=(x, y, z))
        nx, ny, nz = (
            n if cut is None else cut.cells for n, cut in zip(self.count, finer.cuts, strict=True)
        )
        return self if 6 * nx * ny * nz > MAX_KEYS else replace(finer, count=(nx, ny, nz))

    @classmethod
    def _checked(cls, scene: Scene, low: np.ndarray, extent: np.ndarray, size: float) -> CellGrid:
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

    @cached_property
    def _numbers(self) -> tuple[mi.Point3f, mi.Float, mi.UInt32, mi.UInt32, mi.Point3f]:
        """Corner, cubes to a metre, numbers of cubes along x and y, and the last cube.

        A kernel reads them: as literals they would have it compiled anew for every room.
        """
        scale = dr.opaque(mi.Float, 1 / self.size)
        nx, ny = (dr.opaque(mi.UInt32, n) for n in self.count[:2])
        low = mi.Point3f(*(dr.opaque(mi.Float, v) for v in self.low))
        of_cuts = zip(self.count, self.cuts, strict=True)
        counts = (n if cut is None else len(cut.of_step) / STEPS for n, cut in of_cuts)
        last = mi.Point3f(*(dr.opaque(mi.Float, n - 0.5 / STEPS) for n in counts))
        return low, scale, nx, ny, last

    @cached_property
    def _tables(self) -> list[tuple[mi.UInt32, mi.Float] | None]:
        """Cube in which every step begins, and the ends of cubes, where these are not regular."""
        return [cut and (flat_indices(cut.of_step), flat(cut.ends)) for cut in self.cuts]

    def prepare(self) -> None:
        """Make the numbers of `key` outside of a loop that is being recorded."""
        _ = self._numbers, self._tables

    def key(self, p: mi.Point3f, n: mi.Normal3f) -> mi.UInt32:
        """Key of the cell at points `p` with facing normals `n`."""
        low, scale, nx, ny, last = self._numbers
        if any(self._tables):
            p = p + ASIDE * n
        q = (p - low) * scale if self.near is None else self.steps(p) - low
        q = dr.select(q > 0, dr.minimum(q, last), 0)  # points of missed rays may be no numbers
        i, j, k = (_cube(*axis) for axis in zip(q, self._tables, strict=True))
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


def _cube(q: mi.Float, tables: tuple[mi.UInt32, mi.Float] | None) -> mi.UInt32:
    """Cube at a place, in regular cubes from the grid's low end; steps are shorter than cubes."""
    if tables is None:
        return mi.UInt32(q)
    of_step, ends = tables
    cube = dr.gather(mi.UInt32, of_step, mi.UInt32(q * STEPS))
    return cube + dr.select(q >= dr.gather(mi.Float, ends, cube), mi.UInt32(1), 0)


@dataclass(frozen=True)
class Cells:
    """The cells known so far."""

    grid: CellGrid
    index: mi.UInt32
    """Cell of every key of the grid; `_UNKNOWN` for none."""
    count: int
    """Number of cells."""

    @classmethod
    def none(cls, grid: CellGrid) -> Cells:
        """Begin without cells."""
        return cls(grid, dr.full(mi.UInt32, _UNKNOWN, len(grid)), 0)

    def of(self, vertices: Vertices) -> mi.UInt32:
        """Cell of every vertex, 0 for none."""
        return dr.gather(mi.UInt32, self.index, vertices.key, vertices.weight > 0)

    @property
    def keys(self) -> mi.UInt32:
        """Key of every cell."""
        if not self.count:
            return mi.UInt32()
        keys, every = dr.zeros(mi.UInt32, self.count), dr.arange(mi.UInt32, len(self.grid))
        dr.scatter(keys, every, self.index, self.index != _UNKNOWN)
        dr.eval(keys)
        return keys

    def extended(self, vertices: Vertices) -> Cells:
        """Add the new cells that vertices lie in, in the order of their keys."""
        if len(vertices) == 0:
            return self
        is_new = dr.gather(mi.UInt32, self.index, vertices.key, vertices.weight > 0) == _UNKNOWN
        new = marked(len(self.grid), vertices.key, is_new)
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
        return self._in_cubes(edge, layers=False, rooms=None)

    def flat_blocks(self, edge: int, rooms: mi.UInt32 | None = None) -> tuple[mi.UInt32, int]:
        """Blocks of one layer of cells: a table and the floor under it are in two blocks.

        No block lies in two `rooms`, shape (cell,), where these are known.
        """
        return self._in_cubes(edge, layers=True, rooms=rooms)

    def _in_cubes(
        self, edge: int, *, layers: bool, rooms: mi.UInt32 | None
    ) -> tuple[mi.UInt32, int]:
        if self.count == 0:
            return mi.UInt32(), 0
        key = dr.compress(self.index != _UNKNOWN)
        nx, ny, _ = self.grid.count
        facing, cube = key % 6, key // 6
        axis = facing // 2 if layers else mi.UInt32(3)  # 3: none
        places = (cube % nx, cube // nx % ny, cube // (nx * ny))
        i, j, k = (dr.select(axis == a, place, place // edge) for a, place in enumerate(places))
        coarse = (((k * ny) + j) * nx + i) * 6 + facing
        at, told = dr.gather(mi.UInt32, self.index, key), coarse.numpy().astype(np.uint64)
        if rooms is not None:
            told += dr.gather(mi.UInt32, rooms, at).numpy().astype(np.uint64) << np.uint64(32)
        kinds, number = np.unique(told, return_inverse=True)
        block = dr.zeros(mi.UInt32, self.count)
        dr.scatter(block, flat_indices(number), at)
        dr.eval(block)
        return block, len(kinds)
