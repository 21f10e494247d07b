"""Paths that gather the light of elements: those that met no opening, and those that did.

On paths that follow all bounces, G₀ and G_m are sums over them. Where light between surfaces is
solved on cells, `solved_paths` has both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import add_at, flat_indices
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.elements.marked_light import MarkedLight, quick
from drcmitsuba.transport.elements.marks import elements_of
from drcmitsuba.transport.elements.weights import Year
from drcmitsuba.transport.gather.blocks import Gathered, Met

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")


class SentBack(Protocol):
    """Light that openings send back into the room, in one replicate."""

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""

    @property
    def met(self) -> np.ndarray:
        """Elements that paths met, int, shape (vertex, meeting), −1 for none."""

    def weighed(self, shares: np.ndarray) -> np.ndarray:
        """Light that sensors get of light on blocks (sensor, block), with shares (element,)."""

    def scaled(self, factors: np.ndarray) -> SentBack:
        """Light with factors (element,) of what passes openings from outside on its way."""

    def add(self, E: np.ndarray, D: np.ndarray, year: Year) -> None:
        """Add to E (time, sensor) [lx] what returns of light D (time, block) [lx] in a year."""


class OutsideRooms(NamedTuple):
    """Whether sensors (sensor,) and cells (cell,) lie outside of the rooms."""

    sensors: np.ndarray
    cells: np.ndarray

    @classmethod
    def of(cls, scene: Scene, points: np.ndarray, gathered: Gathered) -> OutsideRooms:
        """Look where sensors at points (sensor, 3), and what stands for cells, lie."""
        rooms, count = gathered.drawn.rooms, gathered.cells.count
        if rooms is not None and gathered.within is not None:
            return cls(np.asarray(gathered.within) == 0, rooms.numpy() == 0)
        if scene.enclosure is None or not scene.enclosure.is_box:
            return cls(np.zeros(len(points), bool), np.zeros(count, bool))
        first = dr.gather(mi.Float, gathered.drawn.p, dr.arange(mi.UInt32, 3 * count))
        drawn = first.numpy().reshape(-1, 3)  # of one replicate: cells lie alike in all
        return cls(~scene.enclosure.holds(points), ~scene.enclosure.holds(drawn))


class ElementPaths(Protocol):
    """Paths of all sensors."""

    @property
    def gathered(self) -> Gathered:
        """Paths as they were traced, and the cells that they met."""

    @property
    def blocks(self) -> int:
        """Number of blocks of cells of which openings may send light back."""

    def matrix(self, result: int) -> csr_matrix | np.ndarray:
        """G₀ of the sensors from the cells, shape (sensor, cell)."""

    def onto_blocks(self, result: int) -> csr_matrix | np.ndarray:
        """Light of blocks from D of the cells, without openings, shape (block, cell)."""

    def returned(self, result: int) -> SentBack:
        """Light that openings send back."""


BLOCK = 3
"""Cells along an edge of the blocks that give D to paths with a mark."""


@dataclass(frozen=True)
class FollowedPaths:
    """Paths that follow all bounces, split by whether they have a mark.

    Those without one give a matrix of cells. Those with one are kept one by one: the light on
    blocks of cells is enough for them, since they carry a few per cent of the light.
    """

    gathered: Gathered
    outside: OutsideRooms
    results: int = 1
    """Number of results, each of `draws` replicates."""
    draws: int = 1

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return len(self.outside.sensors)

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
        block, count = self.gathered.cells.blocks(BLOCK)
        if count == 0:
            return block, 0
        within = dr.zeros(mi.UInt32, self.gathered.cells.count)
        for _, met in self._met():
            dr.scatter(within, 1, met.cell, (met.mark == 0) & (met.weight > 0))
        kind, rooms = (2 * block + within).numpy().astype(np.uint64), self.gathered.drawn.rooms
        if rooms is not None:
            kind += rooms.numpy().astype(np.uint64) << np.uint64(32)
        kinds, number = np.unique(kind, return_inverse=True)
        return flat_indices(number), len(kinds)

    @property
    def blocks(self) -> int:
        """Number of blocks of all cells."""
        return self._blocks[1]

    def matrix(self, result: int) -> csr_matrix | np.ndarray:
        """G₀ of the sensors from the cells, shape (sensor, cell); a sparse one in large scenes."""
        parts = [np.zeros((3, 0))]
        for here, met in self._met():
            few = dr.opaque(mi.UInt32, here.stop - here.start)
            of_result = met.row // few // self.draws == dr.opaque(mi.UInt32, result)
            at = dr.compress(of_result & (met.mark == 0) & (met.weight > 0))
            if not dr.width(at):  # all of them met openings: black walls, glass that mirrors
                continue
            row, cell, weight = (dr.gather(type(x), x, at) for x in met[:3])
            sensor = row % few + dr.opaque(mi.UInt32, here.start)
            parts.append(np.stack([x.numpy().astype(float) for x in (weight, sensor, cell)]))
        weight, sensor, cell = np.concatenate(parts, axis=1)
        place = sensor.astype(np.int32), cell.astype(np.int32)
        shape = self.sensors, self.gathered.cells.count
        G = sparse.csr_matrix((weight / self.draws, place), shape)
        G.sum_duplicates()  # in double precision
        return quick(G.astype(np.float32))

    def onto_blocks(self, result: int) -> csr_matrix:
        """Shares of cells in the means over blocks, the same in all results."""
        return self._means

    @cached_property
    def _means(self) -> csr_matrix:
        """Shares of cells in the means over blocks, shape (block, cell).

        The share of a cell is that of its visits by marked paths in those of its block.
        """
        block, blocks = self._blocks
        visits = dr.zeros(mi.Float64, self.gathered.cells.count)
        for _, met in self._met():
            add_at(visits, mi.Float64(met.weight), met.cell, met.mark > 0)
            dr.eval(visits)
        each, of = visits.numpy(), block.numpy()
        whole = np.bincount(of, each, blocks)[of]
        share = np.divide(each, whole, out=np.zeros_like(each), where=whole > 0)
        place = of, np.arange(self.gathered.cells.count)
        return sparse.csr_matrix(
            (share.astype(np.float32), place), (blocks, self.gathered.cells.count)
        )

    def returned(self, result: int) -> MarkedLight:
        """Vertices of the paths with marks."""
        return self._returned[result]

    @cached_property
    def _returned(self) -> list[MarkedLight]:
        """Vertices of the paths with marks, by result."""
        none = np.zeros(0, np.uint32)
        columns = [(none, none, none, none, np.zeros(0, np.float32))]
        for here, met in self._met():
            few = here.stop - here.start
            at = dr.compress(met.mark > 0)
            row = dr.gather(mi.UInt32, met.row, at).numpy()
            cell, mark, weight = (
                dr.gather(type(x), x, at).numpy() for x in (met.cell, met.mark, met.weight)
            )
            of_result, sensor = row // few // self.draws, row % few + here.start
            columns.append((of_result, sensor, cell, mark, weight / self.draws))
        result, sensor, cell, mark, weight = map(np.concatenate, zip(*columns, strict=True))
        block, outside = self._blocks[0].numpy()[cell], self.outside
        passes = outside.sensors[sensor] != outside.cells[cell]
        elements, shape = elements_of(mark), (self.sensors, self.blocks)
        each = (np.flatnonzero(result == r) for r in range(self.results))
        return [
            MarkedLight(sensor[at], block[at], weight[at], elements[at], passes[at], shape)
            for at in each
        ]
