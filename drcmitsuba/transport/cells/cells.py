"""Cells: the small patches of diffuse surface between gather and deposit.

A cell is all diffuse surface within one cube of a grid that faces the same of six axis directions.
The grid is regular but where furniture or partitions stand, at which cells end (`lines`). Only
cells that paths met exist; points drawn from the vertices of these paths (`points`) represent
them, so that the deposit is estimated where the sensors look.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, marked
from drcmitsuba.scene.materials import is_diffuse
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.lines import ASIDE, STEPS, Cuts, adjoined, cuts, planes, standing
from drcmitsuba.transport.cells.vertices import Vertices

MAX_KEYS = 1 << 26
"""Largest number of possible cells, which take 0.6 GiB."""
GROWTH = 8.0
"""Distance beyond the near bounds, in cubes, at which cubes are twice as large."""
_UNKNOWN = 0xFFFFFFFF


def _bounds_of_rooms(scene: Scene) -> np.ndarray | None:
    """Bounds of the rooms along most walls [m], shape (2, 3); None without box and model."""
    room = scene.enclosure
    if scene.near is not None or room is None or not room.is_box:
        return scene.near
    ends = np.stack([np.zeros(3), room.size]) @ room.turn.T
    return np.sort(scene.along_walls(ends), axis=0)


def furniture(scene: Scene) -> np.ndarray:
    """Quads (quad, 4, 3) that stand in the rooms, apart from their bounds [m]: also panes.

    They are in the frame along most walls; there are none where nothing bounds the rooms.
    """
    bounds = _bounds_of_rooms(scene)
    if bounds is None:
        return np.zeros((0, 4, 3))
    return standing(_surfaces(scene), *bounds)


def _surfaces(scene: Scene) -> np.ndarray:
    """Quads (quad, 4, 3) of diffuse surfaces and panes along most walls [m]."""
    quads = [p.quads for p in scene.parts if is_diffuse(p.material) or not p.component]
    return scene.along_walls(np.concatenate([*quads, np.zeros((0, 4, 3))]))


@dataclass(frozen=True)
class CellGrid:
    """Regular grid over a scene, along most walls; `key` numbers its cubes and six facings."""

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
    heading: float = 0.0
    """Angle of the grid, clockwise from the world's axes [deg]."""

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
        low, high = scene.bounds
        if scene.enclosure is not None:
            low = size * np.floor(low / size + 1e-6)
        # Surfaces must not lie on borders of cubes, where rounding decides.
        low = low - 0.37 * size
        return cls._checked(scene, low, high - low, size)._cut(scene)

    @classmethod
    def _around(cls, scene: Scene, size: float) -> CellGrid:
        """Grid over a model: cubes of terrain and towers are as large as an eighth of their way."""
        assert scene.near is not None
        # As for a box: the model's corner, the origin, decides where cubes begin.
        inner = (size * np.floor(scene.near[0] / size + 1e-6) - 0.37 * size).tolist()
        outer = (scene.near[1] + 0.37 * size).tolist()
        x, y, z = (float(v) for v in inner)
        grid = cls((x, y, z), (1, 1, 1), size, (tuple(inner), tuple(outer)))
        first, last = scene.bounds
        ends = (first - 0.37 * size, last)
        steps = (grid.steps(mi.Point3f(*map(float, end))) for end in ends)
        low, high = (np.array([float(v[0]) for v in at]) for at in steps)
        start = np.floor(low)
        count = cls._checked(scene, start * size, (high - start) * size, size).count
        x, y, z = (float(v) for v in start)
        return replace(grid, low=(x, y, z), count=count, heading=scene.heading)._cut(scene)

    def _cut(self, scene: Scene) -> CellGrid:
        """Grid whose cubes end where surfaces stand in rooms, and at bounds that others adjoin."""
        bounds = _bounds_of_rooms(scene)
        if bounds is None:
            return self
        surfaces = _surfaces(scene)
        of_axes = planes(standing(surfaces, *bounds))
        walls = adjoined(surfaces, bounds, self.size)
        if not any(map(len, (*of_axes, *walls))):
            return self
        low, extent = np.array(self.low), np.ptp(bounds, axis=0)
        if self.near is not None:
            low = np.array(self.near[0]) + self.size * low
        sections = extent.prod() / extent
        x, y, z = (
            cuts(plane, float(start), count, self.size, float(section), wall)
            for plane, wall, start, count, section in zip(
                of_axes, walls, low, self.count, sections, strict=True
            )
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
            first, last = scene.bounds
            whole = " × ".join(f"{v:.4g}" for v in last - first)
            raise InputError(
                "case", "accuracy.cell_size", f"{size:g} m in a scene of {whole} m",
                "take larger cells or a smaller scene",
            )  # fmt: skip
        x, y, z = (float(v) for v in low)
        counts = int(count[0]), int(count[1]), int(count[2])
        return cls((x, y, z), counts, size, heading=scene.heading)

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
        _ = self._numbers, self._tables, self._turn

    @cached_property
    def _turn(self) -> tuple[mi.Float, mi.Float]:
        """Sine and cosine of the heading, as `_numbers`."""
        angle = math.radians(self.heading)
        return dr.opaque(mi.Float, math.sin(angle)), dr.opaque(mi.Float, math.cos(angle))

    def along_walls(self, v: Any) -> Any:
        """Points or directions of the world in the frame of the grid."""
        if not self.heading:
            return v
        sine, cosine = self._turn
        return type(v)(cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z)

    def key(self, p: mi.Point3f, n: mi.Normal3f) -> mi.UInt32:
        """Key of the cell at points `p` with facing normals `n`."""
        low, scale, nx, ny, last = self._numbers
        p, n = self.along_walls(p), self.along_walls(n)
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
        """Coordinates in cubes from the near bounds' corner; the steps grow beyond the bounds.

        `p` are points in the frame of the grid.
        """
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
        of_axes = zip(places, self.grid.cuts, strict=True)
        joined = (_blocks(place, cut, edge) for place, cut in of_axes)
        both = enumerate(zip(places, joined, strict=True))
        i, j, k = (dr.select(axis == a, place, block) for a, (place, block) in both)
        coarse = (((k * ny) + j) * nx + i) * 6 + facing
        at, told = dr.gather(mi.UInt32, self.index, key), coarse.numpy().astype(np.uint64)
        if rooms is not None:
            told += dr.gather(mi.UInt32, rooms, at).numpy().astype(np.uint64) << np.uint64(32)
        kinds, number = np.unique(told, return_inverse=True)
        block = dr.zeros(mi.UInt32, self.count)
        dr.scatter(block, flat_indices(number), at)
        dr.eval(block)
        return block, len(kinds)


def _blocks(place: mi.UInt32, cut: Cuts | None, edge: int) -> mi.UInt32:
    """Block along an axis in which cells lie by their places on it."""
    if cut is None:
        return place // edge
    return dr.gather(mi.UInt32, flat_indices(cut.blocks(edge)), place)
