"""Gather paths of which some met panes whose state or material is left open.

Paths without a mark give a matrix G₀ of cells. Those with a mark are kept one by one: the light on
blocks of cells is enough for them, since they carry a few per cent of the light.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import add_at, flat_indices
from drcmitsuba.transport.cells.cells import Cells
from drcmitsuba.transport.gather.blocks import Gathered, Met

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

BLOCK = 3
"""Cells along an edge of the blocks that give D to marked paths."""


FULL = 1 / 32
"""Share of entries from which on products with a full matrix are the faster ones."""


def quick(G: csr_matrix) -> csr_matrix | np.ndarray:
    """Matrix in the form whose products are the faster ones."""
    return G if G.nnz < FULL * G.shape[0] * G.shape[1] else G.toarray()


class MarkedVertices(NamedTuple):
    """Vertices of paths that met marked panes, one entry each."""

    row: np.ndarray
    """Result and sensor of the path, int: result · sensors + sensor."""
    block: np.ndarray
    """Block of cells that the vertex lies in, int."""
    mark: np.ndarray
    """Mark of the path, int."""
    weight: np.ndarray
    """Throughput, float."""


@dataclass(frozen=True)
class MarkedPaths:
    """Gather paths of all sensors, split by whether they have a mark.

    Parameters
    ----------
    gathered : Gathered
        Paths with marks.
    sensors : int
        Number of sensors.
    draws : int
        Number of replicates that are averaged into one result.
    """

    gathered: Gathered
    sensors: int
    draws: int = 1

    @property
    def cells(self) -> Cells:
        """Cells that the paths meet."""
        return self.gathered.cells

    def _met(self) -> Iterator[tuple[slice, Met]]:
        """Vertices of every block of sensors that has any."""
        for here in self.gathered.blocks:
            met = self.gathered.met(here)
            if len(met):
                yield here, met

    @cached_property
    def _blocks(self) -> tuple[mi.UInt32, int]:
        """Block of every cell, and their number.

        Cells that no path without a mark meets have blocks of their own: they lie beyond openings,
        as outer reveals do beside a sill, and their light must not enter by closed openings. Where
        walls are openings, such cells lie in rooms, too: the paths tell which.
        """
        block, count = self.cells.blocks(BLOCK)
        if count == 0:
            return block, 0
        within = dr.zeros(mi.UInt32, self.cells.count)
        for _, met in self._met():
            dr.scatter(within, 1, met.cell, (met.mark == 0) & (met.weight > 0))
        kind, rooms = (2 * block + within).numpy().astype(np.uint64), self.gathered.drawn.rooms
        if rooms is not None:
            kind += rooms.numpy().astype(np.uint64) << np.uint64(32)
        kinds, number = np.unique(kind, return_inverse=True)
        return flat_indices(number), len(kinds)

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self._blocks[1]

    @cached_property
    def means(self) -> csr_matrix:
        """Shares of cells in the means over blocks, shape (block, cell).

        The share of a cell is that of its visits by marked paths in those of its block.
        """
        block, blocks = self._blocks
        visits = dr.zeros(mi.Float64, self.cells.count)
        for _, met in self._met():
            add_at(visits, mi.Float64(met.weight), met.cell, met.mark > 0)
            dr.eval(visits)
        each, of = visits.numpy(), block.numpy()
        whole = np.bincount(of, each, blocks)[of]
        share = np.divide(each, whole, out=np.zeros_like(each), where=whole > 0)
        place = of, np.arange(self.cells.count)
        return sparse.csr_matrix((share.astype(np.float32), place), (blocks, self.cells.count))

    def matrix(self, result: int) -> csr_matrix | np.ndarray:
        """G₀ of the sensors from the cells, shape (sensor, cell); a sparse one in large scenes."""
        parts = [np.zeros((3, 0))]
        for here, met in self._met():
            few = dr.opaque(mi.UInt32, here.stop - here.start)
            of_result = met.row // few // self.draws == dr.opaque(mi.UInt32, result)
            at = dr.compress(of_result & (met.mark == 0) & (met.weight > 0))
            row, cell, weight = (dr.gather(type(x), x, at) for x in met[:3])
            sensor = row % few + dr.opaque(mi.UInt32, here.start)
            parts.append(np.stack([x.numpy().astype(float) for x in (weight, sensor, cell)]))
        weight, sensor, cell = np.concatenate(parts, axis=1)
        place = sensor.astype(np.int32), cell.astype(np.int32)
        shape = self.sensors, self.cells.count
        G = sparse.csr_matrix((weight / self.draws, place), shape)
        G.sum_duplicates()  # in double precision
        return quick(G.astype(np.float32))

    def marked(self) -> MarkedVertices:
        """Vertices of the paths with marks."""
        none = np.zeros(0, np.uint32)
        parts = [MarkedVertices(none, none, none, np.zeros(0, np.float32))]
        for here, met in self._met():
            few = here.stop - here.start
            at = dr.compress(met.mark > 0)
            row = dr.gather(mi.UInt32, met.row, at).numpy()
            result, sensor = row // few // self.draws, row % few + here.start
            block = dr.gather(mi.UInt32, self._blocks[0], dr.gather(mi.UInt32, met.cell, at))
            mark, weight = (dr.gather(type(x), x, at).numpy() for x in (met.mark, met.weight))
            row = result * self.sensors + sensor
            parts.append(MarkedVertices(row, block.numpy(), mark, weight / self.draws))
        return MarkedVertices(*(np.concatenate(column) for column in zip(*parts, strict=True)))
