"""Rays from cells to other cells, and the importance of every cell for the sensors.

Points stand for cells in proportion to importance: to the light that all sensors together get by
way of the point, I = G₁ + I·T with G₁ of one bounce from the sensors and T from cell to cell. If
points were drawn anew at every bounce, and I were exact, the mean of C over the sensors would have
no bias from the size of cells, however light varies in them. (Light that photons bring is a mean
over the area of a cell.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import add_at, flat, row_and_column
from drcmitsuba.runtime.launch_size import PATHS
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import Cells
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.gather.paths import Marks, gather

EDGE = 2
"""Cells along an edge of the blocks on which light between cells is solved, at least: in a corridor
of 2 m light varies within blocks of three."""
MOST_BLOCKS = 400
"""Number of blocks above which their edges grow."""
MOST_IN_MODELS = 1000
"""The same in a model, in whose larger blocks rooms might be joined."""
MOST_RETURNED = 1 - 1e-6
"""Largest share of light that a reflection returns: light in a closed white room has a sum."""
LONG = 16
"""Number of vertices of a path of all bounces for which memory is kept free, in white rooms."""
ROUNDS = ("exploring", "transfer")
"""Names of both rounds, among the purposes of rays."""
_TAGS = (0x5BD1E995, 0x2545F491)
"""Marks on the numbers of vertices in the two rounds: draws differ from those of other paths."""


class CellRays(NamedTuple):
    """Rays from cells."""

    source: mi.UInt32
    """Cell that the ray of each vertex starts from."""
    met: Vertices
    """Diffuse vertices. A ray that ends at its first one has one always, maybe of weight 0."""
    replicate: mi.UInt32
    """Replicate of every vertex."""

    def weighed(self, importance: mi.Float, replicates: int) -> Vertices:
        """Vertices weighed by the light that all sensors get by way of them."""
        here = dr.gather(mi.Float, importance, self.source) / dr.opaque(mi.Float, replicates)
        return replace(self.met, weight=self.met.weight * here)


@dataclass(frozen=True)
class Blocks:
    """Blocks of cells."""

    of: mi.UInt32
    """Block of every cell."""
    count: int
    share: mi.Float
    """Share of every cell in the mean over its block."""

    @classmethod
    def weighed(cls, cells: Cells, weight: mi.Float, rooms: mi.UInt32 | None = None) -> Blocks:
        """Join cells to blocks, each with its weight.

        In a model cells are not joined as long as they are few: a block might lie in two rooms, but
        for those `rooms`, shape (cell,), that are told apart.
        """
        edge, most = (EDGE, MOST_BLOCKS) if cells.grid.near is None else (1, MOST_IN_MODELS)
        block, count = cells.flat_blocks(edge, rooms)
        while count > most and edge < max(cells.grid.count):
            edge += 1
            block, count = cells.flat_blocks(edge, rooms)
        whole = dr.zeros(mi.Float64, count)
        add_at(whole, mi.Float64(weight), block)
        share = mi.Float(mi.Float64(weight) / dr.gather(mi.Float64, whole, block))
        dr.eval(share)
        return cls(block, count, share)

    def all_bounces(
        self, source: mi.UInt32, cell: mi.UInt32, weight: mi.Float, replicates: int = 1
    ) -> mi.TensorXf:
        """Sum over any number of bounces between blocks, 1 + t + t² + …, of rays t = W·T·P.

        It is the inverse of 1 − t, since no row of t adds up to more than `MOST_RETURNED`. The rays
        of a replicate stand together; the sum has the shape (replicate · block, block).
        """
        count, rows = dr.opaque(mi.UInt32, self.count), replicates * self.count
        out = dr.zeros(mi.Float64, rows * self.count)
        ray = dr.arange(mi.UInt32, dr.width(source))
        replicate, _ = row_and_column(ray, dr.width(source) // replicates)
        row = dr.gather(mi.UInt32, self.of, source) + replicate * count
        value = mi.Float64(weight * dr.gather(mi.Float, self.share, source))
        add_at(out, value, row * count + dr.gather(mi.UInt32, self.of, cell))
        every = np.empty((replicates, self.count, self.count), np.float32)
        for total, t in zip(every, out.numpy().reshape(every.shape), strict=True):
            total[:] = sum_of_bounces(t)
        return mi.TensorXf(flat(every), (rows, self.count))


def sum_of_bounces(t: np.ndarray) -> np.ndarray:
    """1 + t + t² + … of light between blocks, whose rows return at most `MOST_RETURNED`."""
    with one_blas_thread():
        t = t * (MOST_RETURNED / np.maximum(t.sum(axis=1, keepdims=True), 1))
        return np.linalg.inv(np.eye(len(t)) - t)


def trace(
    scene: Scene, cells: Cells, drawn: CellPoints, here: slice, rays: int,
    accuracy: Accuracy, turn: int, marks: Marks | None = None, once: bool = True,
) -> Iterator[CellRays]:  # fmt: skip
    """Trace rays from the points that stand for some cells, in every replicate.

    Parameters
    ----------
    here : slice
        Cells that rays start from.
    rays : int
        Number of rays from a cell in each replicate.
    turn : int
        Number of the round, 0 or 1: each has its own random numbers.
    marks : Marks, optional
        Rule that marks every vertex with the surfaces of its ray.
    once : bool
        Whether rays end at their first diffuse vertex; else paths follow all bounces.

    Yields
    ------
    CellRays
        Rays of one launch; random numbers depend on the cell, not on the launch.
    """
    replicates, keys = drawn.replicates, cells.keys
    seed = launch_seed(accuracy.seed, Stream.CELL_RAYS, turn)
    most = PATHS if once else PATHS // LONG
    step = max(1, most // (rays * replicates))
    for start in range(here.start, here.stop, step):
        some = slice(start, min(start + step, here.stop))
        points, (replicate, cell) = drawn.of_cells(some)
        number = dr.gather(mi.UInt32, keys, cell) * dr.opaque(mi.UInt32, replicates) + replicate
        with scene.ray_counter.purpose(Stream.CELL_RAYS.name, ROUNDS[turn]):
            met = gather(
                scene, points.p, points.n, replicates=1, paths=rays, grid=cells.grid, seed=seed,
                numbers=number, within=points.within, once=once, marks=marks,
            )  # fmt: skip
        if not len(met):  # no path met a diffuse surface
            continue
        met = replace(met, tag=met.tag ^ _TAGS[turn])
        source, own = (dr.gather(mi.UInt32, x, met.row) for x in (cell, replicate))
        yield CellRays(source, met, own)
