"""Gather paths of any number of sensors, in blocks that fit in memory.

The points that stand for a cell are drawn from the vertices of all sensors, so that all paths are
traced before any light is deposited. Up to `KEPT` vertices are stored; the paths of further blocks
are traced again, with the same random numbers, when their turn comes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import add_at, row_and_column
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid, Cells
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.gather.paths import USUAL, Crossings, Marks, expected_bounces, gather
from drcmitsuba.transport.rays.openings import in_rooms

KEPT = 1 << 24
"""Largest number of vertices that are stored, 200 MB."""


class Met(NamedTuple):
    """Diffuse vertices: the row (replicate · sensors + sensor) of each, its cell and its weight.

    `mark` is the mark of its path, where paths have marks.
    """

    row: mi.UInt32
    cell: mi.UInt32
    weight: mi.Float
    mark: mi.UInt32 = None

    def __len__(self) -> int:
        """Count the vertices."""
        return dr.width(self.weight)

    def of_replicates(self, numbers: range, sensors: int, paths: int) -> Met:
        """Vertices of some replicates, of paths with one entry each; rows begin at 0."""
        size = sensors * paths
        first = dr.opaque(mi.UInt32, numbers.start * size)
        at = dr.arange(mi.UInt32, len(numbers) * size) + first
        cell, weight = dr.gather(mi.UInt32, self.cell, at), dr.gather(mi.Float, self.weight, at)
        row, _ = row_and_column(dr.arange(mi.UInt32, dr.width(at)), paths)
        return Met(row, cell, weight)


@dataclass(frozen=True)
class Gathered:
    """Gather paths of sensors."""

    trace: Callable[[slice], Vertices]
    """Traces the paths of a block of sensors."""
    blocks: tuple[slice, ...]
    """Sensors of each launch."""
    cells: Cells
    """Cells that the paths of all sensors meet."""
    drawn: CellPoints
    """Points that stand for the cells in every replicate."""
    kept: dict[int, Met]
    """Vertices of some blocks, by their first sensor."""
    within: np.ndarray | None = None
    """Number of the room of a model in which each sensor lies, from 1 on, and 0 outside, shape
    (sensor,); None for other scenes."""
    seen: mi.Float64 | None = None
    """Weight of every cell in sum over the sensors, of paths that end at once."""

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy, *,
        block: int, lanes: int, marks: Marks | None = None, once: bool = False,
        crossings: Crossings | None = None, rooms: np.ndarray | None = None,
    ) -> Gathered:  # fmt: skip
        """Trace all paths, at most `block` sensors and about `lanes` paths in one launch.

        With `once`, paths end at their first diffuse vertex. `rooms` are the sensors' numbers of
        rooms from 1 on; by default all have the same one.
        """
        grid = CellGrid.of(scene, accuracy.cell_size)
        seed = launch_seed(accuracy.seed, Stream.PATH_LENGTHS)
        bounces = 1.0
        if not once:
            bounces = expected_bounces(scene, points, normals, accuracy.paths, grid, seed)
        within = in_rooms(scene, points)
        if within is not None:
            within = np.where(within, 1 if rooms is None else rooms, 0)

        def trace(here: slice) -> Vertices:
            return gather(
                scene, points[here], normals[here], replicates=accuracy.replicates,
                paths=accuracy.paths, grid=grid, seed=launch_seed(accuracy.seed, Stream.PATHS),
                bounces=bounces, first=here.start, among=len(points), marks=marks,
                within=None if within is None else within[here], once=once, crossings=crossings,
            )  # fmt: skip

        paths = accuracy.replicates * accuracy.paths
        most = int(lanes * USUAL / bounces) // paths  # in white rooms paths are long
        n, step = len(points), max(1, min(block, most))
        blocks = tuple(slice(i, min(i + step, n)) for i in range(0, n, step))
        cells, drawn, seen = Cells.none(grid), CellPoints.none(accuracy.replicates), mi.Float64()
        kept, room = dict[int, Met](), KEPT
        for here in blocks:
            vertices = trace(here)
            if len(vertices) == 0:
                number = vertices.row
                kept[here.start] = Met(number, number, vertices.weight, number)
                continue
            cells = cells.extended(vertices)
            cell = cells.of(vertices)
            if once:
                seen = with_weights(seen, cells.count, cell, vertices.weight)
            own = vertices.row // dr.opaque(mi.UInt32, here.stop - here.start)
            drawn = drawn.extended(vertices, cell, cells.count, own=own)
            if len(vertices) <= room:
                dr.eval(cell)
                kept[here.start] = Met(vertices.row, cell, vertices.weight, vertices.mark)
                room -= len(vertices)
        return cls(trace, blocks, cells, drawn, kept, within, seen)

    @property
    def is_stored(self) -> bool:
        """Whether no path has to be traced again."""
        return len(self.kept) == len(self.blocks)

    def met(self, here: slice) -> Met:
        """Vertices of a block of sensors."""
        if here.start in self.kept:
            return self.kept[here.start]
        vertices = self.trace(here)
        return Met(vertices.row, self.cells.of(vertices), vertices.weight, vertices.mark)


def with_weights(before: mi.Float64, cells: int, cell: mi.UInt32, weight: mi.Float) -> mi.Float64:
    """Sums of cells so far, with weights that are added to some of `cells`."""
    out = dr.zeros(mi.Float64, cells)
    if cells == 0:
        return out
    dr.scatter(out, before, dr.arange(mi.UInt32, dr.width(before)))
    dr.eval(out)  # Dr.Jit 1.5 ignores a pending scatter when it reduces
    add_at(out, mi.Float64(weight), cell)
    dr.eval(out)
    return out
