"""Gather paths of which some met panes whose state or material is left open.

Paths without a mark give a matrix G₀ of cells. Those with a mark are kept one by one: the light on
blocks of cells is enough for them, since they carry a few per cent of the light.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.transport.cells import Cells
from drcmitsuba.transport.gather_blocks import Gathered, Met

BLOCK = 3
"""Cells along an edge of the blocks that give D to marked paths."""


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
        return self.cells.blocks(BLOCK)

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self._blocks[1]

    @cached_property
    def share(self) -> mi.Float:
        """Share of a cell in its block: in the visits of its block by marked paths."""
        block, blocks = self._blocks
        visits = dr.zeros(mi.Float64, self.cells.count)
        for _, met in self._met():
            dr.scatter_add(visits, mi.Float64(met.weight), met.cell, met.mark > 0)
            dr.eval(visits)
        of_block = dr.zeros(mi.Float64, blocks)
        dr.scatter_add(of_block, visits, block)
        whole = dr.gather(mi.Float64, of_block, block)
        return mi.Float(dr.select(whole > 0, visits / whole, 0))

    def matrix(self, result: int) -> mi.TensorXf:
        """G₀ of the sensors from the cells, shape (sensor, cell)."""
        count = dr.opaque(mi.UInt32, self.cells.count)
        out = dr.zeros(mi.Float64, self.sensors * self.cells.count)
        for here, met in self._met():
            few = dr.opaque(mi.UInt32, here.stop - here.start)
            replicate, sensor = met.row // few, met.row % few + dr.opaque(mi.UInt32, here.start)
            mine = (replicate // self.draws == dr.opaque(mi.UInt32, result)) & (met.mark == 0)
            weight = mi.Float64(met.weight / self.draws)
            dr.scatter_add(out, weight, sensor * count + met.cell, mine)
            dr.eval(out)
        return mi.TensorXf(mi.Float(out), (self.sensors, self.cells.count))

    def means(self, D: mi.TensorXf) -> mi.TensorXf:
        """Mean of values on cells (cell, bin) over every block, shape (block, bin)."""
        block, blocks = self._blocks
        cells, bins = D.shape
        if bins == 0:
            return dr.zeros(mi.TensorXf, (blocks, 0))
        width = dr.opaque(mi.UInt32, bins)
        entry = dr.arange(mi.UInt32, cells * bins)
        cell = entry // width
        out = dr.zeros(mi.Float64, blocks * bins)
        value = mi.Float64(D.array * dr.gather(mi.Float, self.share, cell))
        to = dr.gather(mi.UInt32, block, cell) * width + entry % width
        dr.scatter_add(out, value, to, value != 0)
        dr.eval(out)
        return mi.TensorXf(mi.Float(out), (blocks, bins))

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
