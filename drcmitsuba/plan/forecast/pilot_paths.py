"""Paths of a pilot's sensors: how long they are, and how many cells those of all sensors meet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.coefficients import groups_of
from drcmitsuba.transport.gather.paths import USUAL, expected_bounces, gather

REPLICATES = 2
"""Number of replicates of a pilot: the smallest that has a standard error."""
SENSORS, RAYS, VERTICES = 48, 1 << 20, 1 << 16
"""Largest numbers of sensors and of their rays to the sky; approximate number of vertices."""
MET = 1 << 20
"""Approximate number of vertices from which the number of cells of a model follows: around it, more
vertices meet ever more cells."""


class PilotPaths(NamedTuple):
    """Paths of the gather."""

    rays: float = 0.0
    """Mean number of rays of one path."""
    vertices: float = 0.0
    """Mean number of diffuse vertices of one path."""
    before: int = 0
    """Number of rays that measure the length of paths first, where surfaces are white."""
    bounces: float = USUAL
    """Number of vertices of one path for which memory is reserved."""
    times: np.ndarray = np.zeros(0, int)
    """Number of vertices in each cell that the pilot met, shape (cell,). A cell that sensors of
    several `groups_of` rooms meet is lit for each of them, and counts as often."""
    met: int = 0
    """Number of cells that `REPLICATES` of the pilot met."""

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, a: Accuracy,
        rooms: np.ndarray | None,
    ) -> PilotPaths:  # fmt: skip
        """Trace the paths of the pilot's sensors, as `compute` does."""
        if scene.effects.depth == 0:
            return cls()
        grid, counted, bounces = CellGrid.of(scene, a.cell_size), scene.ray_counter.counted, 1.0
        once = scene.effects.solved_cells
        if not once:
            seed = launch_seed(a.seed, Stream.PATH_LENGTHS)
            bounces = expected_bounces(scene, points, normals, a.paths, grid, seed)
        before = counted()["path"]
        some = pilot_sensors(len(points), a, bounces)
        replicates = REPLICATES
        if rooms is not None:
            replicates = max(REPLICATES, int(MET / (len(some) * a.paths * bounces)))
        vertices = gather(
            scene, points[some], normals[some], replicates=replicates, paths=a.paths, grid=grid,
            seed=launch_seed(a.seed, Stream.PATHS), bounces=bounces, once=once,
        )  # fmt: skip
        traced, rays = replicates * len(some) * a.paths, counted()["path"] - before
        ends = [group.stop for group in groups_of(rooms, len(points))]
        row, (cells, cell) = vertices.row.numpy(), np.unique(vertices.key, return_inverse=True)
        group = np.searchsorted(ends, some, side="right")[row % len(some)]
        times = np.unique(group * len(cells) + cell, return_counts=True)[1]
        met = len(np.unique(cell[row < REPLICATES * len(some)]))
        return cls(rays / traced, len(vertices) / traced, before, bounces, times, met)

    def cells(self, vertices: float) -> float:
        """Number of cells that this number of vertices meets, by Chao's estimator [1]_.

        References
        ----------
        .. [1] A. Chao et al., "Rarefaction and extrapolation with Hill numbers", 2014, eq. (9).
        """
        n, once, twice = self.times.sum(), (self.times == 1).sum(), (self.times == 2).sum()
        unseen = once * once / (2 * twice) if twice else once * (once - 1) / 2
        share = once / max(1, n * unseen + once)
        return float(len(self.times) + unseen * (1 - (1 - share) ** max(0.0, vertices - n)))


def spread(count: int, most: int) -> np.ndarray:
    """Evenly spread indices below `count`: at most `most`, and at least one."""
    return np.linspace(0, count - 1, min(count, max(1, most))).round().astype(int)


def pilot_sensors(count: int, a: Accuracy, bounces: float) -> np.ndarray:
    """Indices of the pilot's sensors among all `count` sensors."""
    by_paths = int(VERTICES / (REPLICATES * a.paths * bounces))
    return spread(count, min(SENSORS, RAYS // a.sensor_sky_rays, by_paths))
