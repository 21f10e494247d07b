"""Gather paths of any number of sensors, in blocks that fit in memory.

The points that stand for a cell are drawn from the vertices of all sensors, so that all paths are
traced before any light is deposited. Up to `KEPT` vertices are stored; the paths of further blocks
are traced again, with the same random numbers, when their turn comes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells import Cells, Drawn, Grid, Vertices, draw_points
from drcmitsuba.transport.gather import USUAL, expected_bounces, gather

KEPT = 1 << 24
"""Largest number of vertices that are stored, 200 MB."""


class Met(NamedTuple):
    """Diffuse vertices: the row (replicate · sensors + sensor) of each, its cell and its weight."""

    row: mi.UInt32
    cell: mi.UInt32
    weight: mi.Float

    def __len__(self) -> int:
        """Count the vertices."""
        return dr.width(self.weight)


@dataclass(frozen=True)
class Gathered:
    """Gather paths of sensors.

    Parameters
    ----------
    scene : Scene
    points, normals : np.ndarray, shape (sensor, 3)
    accuracy : Accuracy
    blocks : tuple of slice
        Sensors of each launch.
    cells : Cells
        Cells that the paths of all sensors meet.
    drawn : tuple of Drawn
        Points that stand for the cells, for each replicate.
    bounces : float
        Expected vertices per path.
    kept : dict of int to Met
        Vertices of some blocks, by their first sensor.
    """

    scene: Scene
    points: np.ndarray
    normals: np.ndarray
    accuracy: Accuracy
    blocks: tuple[slice, ...]
    cells: Cells
    drawn: tuple[Drawn, ...]
    bounces: float
    kept: dict[int, Met]

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy, *,
        block: int, lanes: int,
    ) -> Gathered:  # fmt: skip
        """Trace all paths, at most `block` sensors and about `lanes` paths in one launch."""
        cells = Cells.none(Grid.of(scene, accuracy.cell_size))
        seed = launch_seed(accuracy.seed, Stream.PATH_LENGTHS)
        bounces = expected_bounces(scene, points, normals, accuracy.paths, cells.grid, seed)
        paths = accuracy.replicates * accuracy.paths
        most = int(lanes * USUAL / bounces) // paths  # in white rooms paths are long
        n, step = len(points), max(1, min(block, most))
        blocks = tuple(slice(i, min(i + step, n)) for i in range(0, n, step))
        drawn: list[Drawn | None] = [None] * accuracy.replicates
        kept: dict[int, Met] = {}
        room = KEPT
        for here in blocks:
            vertices = _gather(scene, points, normals, accuracy, cells.grid, bounces, here)
            if len(vertices) == 0:
                kept[here.start] = Met(vertices.row, vertices.row, vertices.weight)
                continue
            cells = cells.extended(vertices)
            cell = cells.of(vertices)
            drawn = [
                draw_points(vertices, cell, cells.count, r, before)
                for r, before in enumerate(drawn)
            ]
            if len(vertices) <= room:
                dr.eval(cell)
                kept[here.start] = Met(vertices.row, cell, vertices.weight)
                room -= len(vertices)
        points_of_cells = tuple(one for one in drawn if one is not None)
        return cls(scene, points, normals, accuracy, blocks, cells, points_of_cells, bounces, kept)

    def met(self, here: slice) -> Met:
        """Vertices of a block of sensors."""
        if here.start in self.kept:
            return self.kept[here.start]
        vertices = _gather(
            self.scene, self.points, self.normals, self.accuracy, self.cells.grid, self.bounces,
            here,
        )  # fmt: skip
        return Met(vertices.row, self.cells.of(vertices), vertices.weight)


def _gather(
    scene: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy, grid: Grid,
    bounces: float, here: slice,
) -> Vertices:  # fmt: skip
    """Trace the paths of some of the sensors."""
    return gather(
        scene, points[here], normals[here], replicates=accuracy.replicates, paths=accuracy.paths,
        grid=grid, seed=launch_seed(accuracy.seed, Stream.PATHS), bounces=bounces, first=here.start,
        among=len(points),
    )  # fmt: skip
