r"""Paths of elements where light between surfaces is solved on cells.

The paths of sensors end at their first surface, and rays between cells take over: with T₀ and G₁
those that met no opening, t_e and g_e those that met the element e, X the light on the targets of
rays by way of openings, and s what these send to blocks of cells,

.. math:: s = \sum_e w_e t_e X, \qquad E = S + G_0 D + G_1 P M s + \sum_e w_e g_e X,

where M sums all bounces between blocks that meet no opening, and P gives every cell the value of
its block. A target is a block of cells whose light counts by the rays that end there, since below
a sill it differs from cell to cell: V are its means, after a last bounce cell by cell,

.. math:: X = V \big( D + T_0 \, (D + P M W T_0 D) \big) + (V P + V T_0 P M) \, s,

with W the means over blocks. Half of the rays that meet a film go on by its lobes. The others are
deposited: they end there, at targets X = V D, with the light that reaches the film straight, which
counts as if the film sent it on evenly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.transport.cells.cells import Cells
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.marks import elements_of, is_deposited
from drcmitsuba.transport.elements.paths import OutsideRooms
from drcmitsuba.transport.elements.weights import Year
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.interreflection.solved_cells import Transfer
from drcmitsuba.transport.light.products import Columns, PathMatrix

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

NEGLIGIBLE = 1e-6
"""Share of the light that openings send back which a sum over its returns may leave out."""
RETURNS = 3
"""Times that light is sent back by openings; what returns more often, some 10⁻⁵ of E, is lost."""


class _EndedRays(NamedTuple):
    """Rays that end at cells, an entry of each array for every ray."""

    row: np.ndarray
    """Sensor, or block of cells, from which it starts, int."""
    cell: np.ndarray
    weight: np.ndarray
    mark: np.ndarray
    outside: np.ndarray
    """Whether it starts outside of the rooms."""

    def among(self, some: Callable[[np.ndarray], np.ndarray]) -> _EndedRays:
        """Rays that carry light, of some marks."""
        here = np.flatnonzero(some(self.mark) & (self.weight > 0))
        return _EndedRays(*(each[here] for each in self))


class _Bounces(NamedTuple):
    """Bounces of a result that meet no opening."""

    once: csr_matrix
    """W·T₀, shape (block, cell)."""
    last: csr_matrix
    """V·T₀, shape (target, cell)."""
    between: np.ndarray
    """V·T₀·P·M, shape (target, block)."""
    all: np.ndarray
    """M, shape (block, block)."""


@dataclass(frozen=True)
class SolvedPaths:
    """Paths that end at their first surface, and rays between cells.

    G, M and rays of a result are means over its replicates: products join rays of different ones.
    """

    gathered: Gathered
    transfer: Transfer
    """T with the mark of every ray."""
    outside: OutsideRooms
    paths: int
    """Number of paths of a sensor in a replicate."""
    draws: int = 1
    """Number of replicates that are averaged into one result."""
    _latest: dict[int, _Bounces] = field(default_factory=dict, init=False, repr=False)
    """`_bounces` of the latest result."""

    @property
    def sensors(self) -> int:
        """Number of sensors."""
        return len(self.outside.sensors)

    @property
    def cells(self) -> Cells:
        """All cells."""
        return self.gathered.cells

    @property
    def blocks(self) -> int:
        """Number of targets of rays by way of openings."""
        return len(self._reached)

    @cached_property
    def _shut(self) -> Transfer:
        """T of the rays that met no opening."""
        return self.transfer.weighed(lambda mark: dr.select(mark == 0, mi.Float(1), 0))

    @cached_property
    def _means(self) -> csr_matrix:
        """W, shares of cells in the means over blocks, shape (block, cell)."""
        of, share = self.transfer.blocks.of.numpy(), self.transfer.blocks.share.numpy()
        place = of, np.arange(len(of))
        return sparse.csr_matrix((share, place), (self.transfer.blocks.count, len(of)))

    def matrix(self, result: int) -> np.ndarray:
        """G₀ of all bounces, see `ElementPaths`."""
        cells, here = self.cells.count, self._replicates(result)
        every = Columns(dr.arange(mi.UInt32, cells), 0, cells, 1)
        rows = []
        for some in self.gathered.blocks:
            met, count = self.gathered.met(some), some.stop - some.start
            assert met.mark is not None
            weight = dr.select(met.mark == 0, met.weight, 0)
            G = np.zeros((count, cells), np.float32)
            for r in here:
                first = PathMatrix(met.cell, weight, self.paths, count, 1, r)
                to_cells, onward = self._shut.followed(range(r, r + 1), first, some)
                G += (to_cells.columns(every) + onward(every)).numpy() / np.float32(self.draws)
            rows.append(G)
        return np.concatenate(rows)

    def onto_blocks(self, result: int) -> np.ndarray:
        """V·(1 + T₀·(1 + P·M·W·T₀)), see `ElementPaths`."""
        bounces = self._bounces(result)
        return np.asarray(self._visits + bounces.last + bounces.between @ bounces.once)

    def returned(self, result: int) -> SolvedReturn:
        """Rays with marks, from sensors and from cells."""
        between = MarkedLight.mean([self._between(r) for r in self._replicates(result)])
        bounces, blocks = self._bounces(result), self.transfer.blocks
        back = bounces.between.copy()
        rows = np.flatnonzero(self._reached < blocks.count)
        back[rows, self._reached[rows]] += 1
        rays = self._of_sensors(result)
        inside, marked = rays.among(lambda mark: mark == 0), rays.among(lambda mark: mark > 0)
        place = inside.row, blocks.of.numpy()[inside.cell]
        G_1 = sparse.csr_matrix((inside.weight, place), (self.sensors, blocks.count))
        onto = np.asarray(G_1 @ bounces.all)
        return SolvedReturn(onto, back, between, self._marked(marked, self.sensors))

    @cached_property
    def _visited(self) -> np.ndarray:
        """Light that sensors get of every cell by rays that meet an opening, float, (2, cell).

        The second row is that of rays that are deposited on films.
        """
        assert self.transfer.importance is not None
        cells, total = self.cells.count, np.zeros(2 * self.cells.count)
        importance = self.transfer.importance.numpy() / len(self.transfer.marks)

        def add(cell: mi.UInt32, mark: mi.UInt32, weight: np.ndarray) -> None:
            place = cell.numpy() + cells * is_deposited(mark.numpy())
            total[:] += np.bincount(place, weight * (mark.numpy() > 0), 2 * cells)

        for (source, cell, weight), mark in zip(
            self.transfer.bounces, self.transfer.marks, strict=True
        ):
            add(cell, mark, importance[source.numpy()] * weight.numpy())
        for some in self.gathered.blocks:
            met = self.gathered.met(some)
            assert met.mark is not None
            add(met.cell, met.mark, met.weight.numpy())
        return total.reshape(2, cells)

    @cached_property
    def _reached(self) -> np.ndarray:
        """Targets of rays by way of openings in any replicate, int, shape (target,).

        They are blocks of cells, and beyond their number those of which rays are deposited on
        films.
        """
        deposited, cell = np.nonzero(self._visited > 0)
        return np.unique(self._target(cell, deposited))

    @cached_property
    def _visits(self) -> csr_matrix:
        """V, shares of cells in what rays by way of openings meet, shape (target, cell)."""
        deposited, cell = np.nonzero(self._visited > 0)
        target, visits = self._target(cell, deposited), self._visited[deposited, cell]
        share = (visits / np.bincount(target, visits)[target]).astype(np.float32)
        place = np.searchsorted(self._reached, target), cell
        return sparse.csr_matrix((share, place), (len(self._reached), self.cells.count))

    def _target(self, cell: np.ndarray, deposited: np.ndarray) -> np.ndarray:
        """Target of rays that end at cells, as `_reached` numbers them before it leaves some out.

        `deposited` says, by 0 or 1, whether they are deposited on films.
        """
        blocks = self.transfer.blocks
        return np.asarray(blocks.of.numpy()[cell] + blocks.count * deposited)

    def _bounces(self, result: int) -> _Bounces:
        """Bounces of a result, which is asked for twice."""
        if result not in self._latest:
            self._latest.clear()
            self._latest[result] = self._computed(result)
        return self._latest[result]

    def _computed(self, result: int) -> _Bounces:
        """Bounces of a result; cells that send no rays count with the mean of their block."""
        numbers, blocks = self._replicates(result), self.transfer.blocks
        sending = self.transfer.sending
        T = sum(self._shut.matrix(r) for r in numbers) / np.float32(self.draws)
        of, cells = blocks.of.numpy(), np.arange(self.cells.count)
        one = np.ones(len(cells), np.float32)
        once, P = self._means @ T, sparse.csr_matrix((one, (cells, of)), (len(cells), blocks.count))
        is_block = (self._reached < blocks.count).astype(np.float32)
        V = sparse.diags(is_block) @ self._visits
        last = V @ T  # cells that send no rays have none in T
        if sending is not None:
            last = last + (V[:, sending:] @ P[sending:]) @ once
        every = self._shut.all_bounces(numbers).numpy()
        M = np.asarray(every.reshape(-1, blocks.count, blocks.count).mean(axis=0))
        return _Bounces(once, last, np.asarray((last @ P) @ M), M)

    def _replicates(self, result: int) -> range:
        """Replicates of a result."""
        return range(result * self.draws, (result + 1) * self.draws)

    def _of_sensors(self, result: int) -> _EndedRays:
        """Rays from the sensors in a result."""
        parts, here = [], self._replicates(result)
        for some in self.gathered.blocks:
            met, count = self.gathered.met(some), some.stop - some.start
            assert met.mark is not None
            each = slice(here.start * count * self.paths, here.stop * count * self.paths)
            cell, weight, mark = (a.numpy()[each] for a in (met.cell, met.weight, met.mark))
            sensor = some.start + np.arange(len(cell)) // self.paths % count
            starts = self.outside.sensors[sensor]
            parts.append((sensor, cell, weight / np.float32(self.draws), mark, starts))
        return _EndedRays(*(np.concatenate(a) for a in zip(*parts, strict=True)))

    def _between(self, replicate: int) -> MarkedLight:
        """Rays with marks from blocks to targets."""
        blocks = self.transfer.blocks
        source, cell, weight = (a.numpy() for a in self.transfer.bounces[replicate])
        of, share = (a.numpy()[source] for a in (blocks.of, blocks.share))
        mark, starts = self.transfer.marks[replicate].numpy(), self.outside.cells[source]
        rays = _EndedRays(of, cell, share * weight, mark, starts)
        return self._marked(rays.among(lambda mark: mark > 0), blocks.count)

    def _marked(self, rays: _EndedRays, rows: int) -> MarkedLight:
        """Rays with marks, from so many rows to targets."""
        target = self._target(rays.cell, is_deposited(rays.mark))
        place, met = np.searchsorted(self._reached, target), elements_of(rays.mark)
        passes = rays.outside != self.outside.cells[rays.cell]
        return MarkedLight(rays.row, place, rays.weight, met, passes, (rows, self.blocks))


@dataclass(frozen=True, eq=False)
class SolvedReturn:
    """Light that openings send back, where light between surfaces is solved on cells."""

    onto: np.ndarray
    """G₁·P·M, shape (sensor, block)."""
    back: np.ndarray
    """Light that targets of rays get, after all bounces, of what openings send to any block, shape
    (target, block); none where rays are deposited on films."""
    between: MarkedLight
    """t, rays from every block to the targets by way of openings."""
    sensors: MarkedLight
    """g, paths from sensors to the targets by way of openings."""

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        rays = self.between.nbytes + self.sensors.nbytes
        return rays + self.onto.nbytes + self.back.nbytes

    @property
    def met(self) -> np.ndarray:
        """Elements that paths met, see `SentBack`."""
        return np.concatenate([self.between.met, self.sensors.met])

    def weighed(self, shares: np.ndarray) -> np.ndarray:
        """Light of sensors from blocks, see `SentBack`."""
        t, g = self.between.weighed(shares), self.sensors.weighed(shares)
        first = g + self.onto @ t
        return np.asarray(first + first @ all_powers(self.back @ t))

    def scaled(self, factors: np.ndarray) -> SolvedReturn:
        """Light with factors of what passes openings, see `SentBack`."""
        between, sensors = (each.scaled(factors) for each in (self.between, self.sensors))
        return replace(self, between=between, sensors=sensors)

    def add(self, E: np.ndarray, D: np.ndarray, year: Year) -> None:
        """Add the light of a year, see `SentBack`."""
        X, sent = D, np.empty((len(D), self.onto.shape[1]), np.float32)
        for _ in range(RETURNS):
            sent.fill(0)
            self.between.add(sent, X, year)
            X = D + sent @ self.back.T
        E += sent @ self.onto.T
        self.sensors.add(E, X, year)


def all_powers(once: np.ndarray) -> np.ndarray:
    """Light between blocks after one return or more: O + O² + O³ + …, from that after one, O.

    The number of powers doubles with each step, S₂ₖ = Sₖ + Oᵏ Sₖ. Openings send back little light:
    there are half as many products as an inverse of 1 − O is worth.
    """
    power = once @ once
    total = once + power
    while (most := abs(power).sum(axis=1).max(initial=0)) > NEGLIGIBLE:
        total = total + power @ total
        if most**2 <= NEGLIGIBLE:
            break
        power = power @ power
    return total
