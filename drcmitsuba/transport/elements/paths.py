r"""Paths that gather the light of elements: those that met no opening, and those that did.

On paths that follow all bounces, G₀ and G_m are sums over them. Where light between surfaces is
solved on cells, the paths of sensors end at their first surface, and rays between cells take over:
with T₀ and G₁ those that met no opening, t_e and g_e those that met the element e, and X the light
on blocks of cells after all reflections,

.. math:: X = X_0 + M \sum_e w_e t_e X, \qquad
          E = S + G_0 D + G_1 P \, (X - X_0) + \sum_e w_e g_e X

where M sums all bounces between blocks that meet no opening, X₀ is what they give, and P gives
every cell the value of its block.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.launch_size import PATHS, SENSORS
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import Cells
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.marks import elements_of
from drcmitsuba.transport.elements.weights import Year
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.gather.marked_paths import MarkedPaths
from drcmitsuba.transport.gather.paths import Marks
from drcmitsuba.transport.interreflection.solved_cells import Transfer, solved
from drcmitsuba.transport.light.products import Columns, PathMatrix

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

MOST_PAIRS = 1 << 28
"""Largest number of pairs of a sensor and a cell that a matrix holds; beyond it, paths are kept."""
NEGLIGIBLE = 1e-6
"""Share of the light that openings send back which a sum over its returns may leave out."""
RETURNS = 3
"""Times that light is sent back by openings; what returns more often, some 10⁻⁵ of E, is lost."""


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

    def add(self, E: np.ndarray, D: np.ndarray, year: Year) -> None:
        """Add to E (time, sensor) [lx] what returns of light D (time, block) [lx] in a year."""


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


def paths_of(
    world: Scene, points: np.ndarray, normals: np.ndarray, accuracy: Accuracy, marks: Marks,
    draws: int, *, on_cells: bool,
) -> ElementPaths:  # fmt: skip
    """Trace the paths of sensors.

    Parameters
    ----------
    world : Scene
        Scene with the openings, whose fill `marks` draws.
    points, normals : np.ndarray, shape (sensor, 3)
        Positions [m] and unit normals.
    draws : int
        Number of replicates whose paths are averaged into one result.
    on_cells : bool
        Whether light between surfaces may be solved on cells.
    """
    if on_cells:
        gathered = Gathered.of(
            world, points, normals, accuracy, block=SENSORS, lanes=PATHS, marks=marks, once=True
        )
        if gathered.cells.count:
            gathered, transfer = solved(world, gathered, accuracy, marks)
            if gathered.cells.count * len(points) <= MOST_PAIRS:
                return SolvedPaths(gathered, transfer, len(points), accuracy.paths)
    gathered = Gathered.of(
        world, points, normals, accuracy, block=SENSORS, lanes=PATHS, marks=marks
    )
    return FollowedPaths(gathered, len(points), accuracy.replicates // draws, draws)


@dataclass(frozen=True)
class FollowedPaths:
    """Paths that follow all bounces."""

    gathered: Gathered
    sensors: int
    results: int
    """Number of results, each of `draws` replicates."""
    draws: int

    @cached_property
    def _marked(self) -> MarkedPaths:
        return MarkedPaths(self.gathered, self.sensors, self.draws)

    @cached_property
    def _returned(self) -> list[MarkedLight]:
        shape = self.sensors, self.blocks
        return MarkedLight.by_result(self._marked.marked(), self.results, shape)

    @property
    def blocks(self) -> int:
        """Number of blocks of all cells."""
        return self._marked.blocks

    def matrix(self, result: int) -> csr_matrix | np.ndarray:
        """G₀, see `ElementPaths`."""
        return self._marked.matrix(result)

    def onto_blocks(self, result: int) -> csr_matrix:
        """Shares of cells in the means over blocks, the same in all results."""
        return self._marked.means

    def returned(self, result: int) -> MarkedLight:
        """Paths with marks."""
        return self._returned[result]


@dataclass(frozen=True)
class SolvedPaths:
    """Paths that end at their first surface, and rays between cells; a result is one replicate."""

    gathered: Gathered
    transfer: Transfer
    """T with the mark of every ray."""
    sensors: int
    paths: int
    """Number of paths of a sensor in a replicate."""

    @property
    def cells(self) -> Cells:
        """All cells."""
        return self.gathered.cells

    @property
    def blocks(self) -> int:
        """Number of blocks that rays reach by way of openings."""
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
        cells, here = self.cells.count, range(result, result + 1)
        every = Columns(dr.arange(mi.UInt32, cells), 0, cells, 1)
        rows = []
        for some in self.gathered.blocks:
            met, count = self.gathered.met(some), some.stop - some.start
            assert met.mark is not None
            weight = dr.select(met.mark == 0, met.weight, 0)
            first = PathMatrix(met.cell, weight, self.paths, count, 1, result)
            to_cells, onward = self._shut.followed(here, first, some)
            rows.append((to_cells.columns(every) + onward(every)).numpy())
        return np.concatenate(rows)

    def onto_blocks(self, result: int) -> np.ndarray:
        """W + M·W·T₀, see `ElementPaths`."""
        T, W = self._shut.matrix(result), self._means
        return np.asarray(self._all_bounces(result)[self._reached] @ (W @ T) + W[self._reached])

    def returned(self, result: int) -> SolvedReturn:
        """Rays with marks, from sensors and from cells."""
        onto, between, sensors = self._marked[result]
        place = np.searchsorted(self._reached, np.arange(self.transfer.blocks.count))

        def numbered(rays: MarkedLight) -> MarkedLight:
            return replace(rays, block=place[rays.block], shape=(rays.shape[0], self.blocks))

        bounces = self._all_bounces(result)
        return SolvedReturn(bounces, onto, numbered(between), numbered(sensors), self._reached)

    @cached_property
    def _reached(self) -> np.ndarray:
        """Blocks that rays reach by way of openings in any replicate, int, shape (reached,)."""
        every = [marked.block for _, *both in self._marked for marked in both]
        return np.unique(np.concatenate(every))

    @cached_property
    def _marked(self) -> list[tuple[csr_matrix, MarkedLight, MarkedLight]]:
        """G₁·P, and rays with marks from blocks and from sensors, of every replicate."""
        parts = []
        for replicate in range(len(self.transfer.marks)):
            onto, from_sensors = self._of_sensors(replicate)
            parts.append((onto, self._between(replicate), from_sensors))
        return parts

    def _all_bounces(self, replicate: int) -> np.ndarray:
        """M, shape (block, block)."""
        return np.asarray(self._shut.all_bounces(range(replicate, replicate + 1)).numpy())

    def _between(self, replicate: int) -> MarkedLight:
        """Rays with marks from blocks to blocks."""
        blocks = self.transfer.blocks
        of, share = blocks.of.numpy(), blocks.share.numpy()
        source, cell, weight = (a.numpy() for a in self.transfer.bounces[replicate])
        mark = self.transfer.marks[replicate].numpy()
        here = np.flatnonzero((mark > 0) & (weight > 0))
        source = source[here]
        return MarkedLight(
            of[source], of[cell[here]], weight[here] * share[source], elements_of(mark[here]),
            (blocks.count, blocks.count),
        )  # fmt: skip

    def _of_sensors(self, replicate: int) -> tuple[csr_matrix, MarkedLight]:
        """Paths of the sensors in a replicate: G₁·P, and those with marks."""
        parts, of = [], self.transfer.blocks.of.numpy()
        for some in self.gathered.blocks:
            met, count = self.gathered.met(some), some.stop - some.start
            assert met.mark is not None
            each = slice(replicate * count * self.paths, (replicate + 1) * count * self.paths)
            sensor = np.repeat(np.arange(some.start, some.stop), self.paths)
            cell, weight, mark = (a.numpy()[each] for a in (met.cell, met.weight, met.mark))
            there = weight > 0
            parts.append([a[there] for a in (sensor, of[cell], weight, mark)])
        sensor, block, weight, mark = (np.concatenate(a) for a in zip(*parts, strict=True))
        shape, back = (self.sensors, self.transfer.blocks.count), mark > 0
        place = sensor[~back], block[~back]
        onto = sparse.csr_matrix((weight[~back], place), shape)
        by_mark = elements_of(mark[back])
        marked = MarkedLight(sensor[back], block[back], weight[back], by_mark, shape)
        return onto, marked


@dataclass(frozen=True, eq=False)
class SolvedReturn:
    """Light that openings send back, where light between surfaces is solved on cells."""

    bounces: np.ndarray
    """M, shape (block, block)."""
    onto: csr_matrix
    """G₁·P, shape (sensor, block)."""
    between: MarkedLight
    """t, rays from every block to the `reached` ones by way of openings."""
    sensors: MarkedLight
    """g, paths from sensors to the `reached` blocks by way of openings."""
    reached: np.ndarray
    """Blocks whose light openings send back, of which alone X is needed, int, shape (reached,)."""

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        light = self.between.nbytes + self.sensors.nbytes
        return light + self.bounces.nbytes + self.onto.data.nbytes + self.onto.indices.nbytes

    @property
    def met(self) -> np.ndarray:
        """Elements that paths met, see `SentBack`."""
        return np.concatenate([self.between.met, self.sensors.met])

    def weighed(self, shares: np.ndarray) -> np.ndarray:
        """Light of sensors from blocks, see `SentBack`."""
        once, G = self.bounces @ self.between.weighed(shares), self.sensors.weighed(shares)
        returned = once + once @ all_powers(once[self.reached])
        return np.asarray(G + self.onto @ returned + G @ returned[self.reached])

    def add(self, E: np.ndarray, D: np.ndarray, year: Year) -> None:
        """Add the light of a year, see `SentBack`."""
        X, sent = D, np.empty((len(D), len(self.bounces)), np.float32)
        for _ in range(RETURNS):
            sent.fill(0)
            self.between.add(sent, X, year)
            back = sent @ self.bounces.T
            X = D + back[:, self.reached]
        E += (self.onto @ back.T).T
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
