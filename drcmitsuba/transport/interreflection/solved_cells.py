r"""Interreflection solved on cells: light beyond the first reflection is the same for all sensors.

With D[cell, bin] the irradiance of a cell before any diffuse reflection and T[cell, cell] the share
of the irradiance of one cell that it sends on to another, irradiance after all reflections is

.. math:: H = D + T H, \qquad C = D(sensors) + G_1 H,

with G₁ of one bounce only. Rays from a random point of every cell, in every replicate, estimate T:
they follow the BSDFs of the room to the first surface that reflects diffusely. T·H is smooth; it is
solved as its mean X over blocks of cells, and its last bounces before the sensor, which a block
would smear, are followed cell by cell:

.. math:: X = W T (D + P X), \qquad Y_0 = P X, \quad Y_{k+1} = T (D + Y_k), \qquad H = D + Y_K

where P gives every cell the value of its block, and W is the mean over a block's cells, weighted by
their importance. A first round of few paths, of all bounces, finds all cells and their importance;
in a second one, rays from points drawn by importance estimate T and draw the points at which D is
computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat, repeated, row_and_column
from drcmitsuba.scene.geometry import is_triangle
from drcmitsuba.scene.materials import is_diffuse
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import Cells, furniture
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.gather.blocks import Gathered, with_weights
from drcmitsuba.transport.gather.paths import Marks
from drcmitsuba.transport.interreflection.cell_rays import Blocks, trace
from drcmitsuba.transport.light.lit_cells import LitCells
from drcmitsuba.transport.light.products import (
    Columns,
    DenseMatrix,
    Further,
    Matrix,
    PathMatrix,
    RayMatrix,
    by_replicate,
    product,
    rows_of,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

FEW = 8
"""Number of paths from a cell in the first round, in every replicate, at least."""
PER_CELL = 4
"""Number of paths in the first round for each possible cell, at least: few cells may be all that
the sensors see."""
MANY = 1 << 12
"""Number of possible cells beyond which their number asks for no more paths."""
LAST = 1 / 32
"""Share of the cells below which those that the second round finds send no rays in turn."""
STEPS = 2
"""Number of last bounces before the sensor that are followed cell by cell: with one, eyes that
look into a deep room's dark end see it 0.6 % too bright."""
AMONG_FURNITURE = 3
"""Number of them where light varies within a block, since something stands in the room."""
SPARSE = 8
"""Multiplications of a product of matrices that take as long as one along a ray."""
KEPT = 1 << 24
"""Largest number of values of what sensors have gathered that are kept for further states."""
MOST_CELLS = 1 << 17
"""Largest number of cells that send rays; light that further ones send on in turn is left out."""


class OneBounce(NamedTuple):
    """T of one replicate, an entry for each ray."""

    source: mi.UInt32
    """Cell that a ray starts from."""
    cell: mi.UInt32
    """Cell that it meets."""
    weight: mi.Float
    """Contribution to the irradiance of the first cell per irradiance on the second."""


class Followed(NamedTuple):
    """Matrices from the light D on cells to the sensors, by way of any number of bounces."""

    to_cells: Matrix
    """Bounces that are followed cell by cell, G₁ + G₁·T + …."""
    onward: Further
    """Columns of the rest, by way of blocks."""


class _LastBounces(NamedTuple):
    """Matrices of the last bounces before the sensors, in a replicate."""

    to_cells: mi.TensorXf
    """From cells, by up to so many bounces, shape (sensor, cell)."""
    onto_blocks: mi.TensorXf
    """From blocks, before these bounces, shape (sensor, block)."""


@dataclass(frozen=True)
class Transfer:
    """Light that cells send to blocks of cells."""

    blocks: Blocks
    bounces: tuple[OneBounce, ...]
    """T of every replicate."""
    steps: int = 0
    """Number of last bounces before the sensor that no block smears."""
    sending: int | None = None
    """Number of cells that rays start from, the first ones; None for all."""
    marks: tuple[mi.UInt32, ...] = ()
    """Mark of every ray of T, of every replicate, where rays have marks."""
    importance: mi.Float | None = None
    """Light that all sensors get by way of each cell in all replicates, where rays have marks."""
    _all_bounces: list[mi.TensorXf] = field(default_factory=list, init=False, repr=False)
    """Sums over all bounces of all replicates, once they have been computed."""
    _sent: dict[range, RayMatrix] = field(default_factory=dict, init=False, repr=False)
    """Matrices W·T that have been made, by replicates."""
    _matrices: dict[int, Any] = field(default_factory=dict, init=False, repr=False)
    """Matrices T that have been made, by replicate: `csr_matrix`, which Dr.Jit cannot look up."""
    _followed: dict[tuple[int, int, int], _LastBounces] = field(
        default_factory=dict, init=False, repr=False
    )
    """Light that sensors have gathered, by the first and the last of them and the replicate."""

    @property
    def cells(self) -> int:
        """Number of cells."""
        return dr.width(self.blocks.of)

    def weighed(self, share: Callable[[mi.UInt32], mi.Float]) -> Transfer:
        """T whose rays count with a share that follows from their marks."""
        bounces = tuple(
            one._replace(weight=one.weight * share(mark))
            for one, mark in zip(self.bounces, self.marks, strict=True)
        )
        dr.eval(bounces)
        return replace(self, bounces=bounces, marks=())

    def sent(self, replicates: range) -> RayMatrix:
        """W·T, shape (replicate · block, cell)."""
        if replicates not in self._sent:
            self._sent[replicates] = self._rays(replicates)
        return self._sent[replicates]

    def _rays(self, replicates: range) -> RayMatrix:
        blocks, count = self.blocks, len(replicates)
        every = [self.bounces[r] for r in replicates]
        source, cell, weight = (dr.concat(column) for column in zip(*every, strict=True))
        number, _ = row_and_column(
            dr.arange(mi.UInt32, dr.width(source)), dr.width(source) // count
        )
        row = dr.gather(mi.UInt32, blocks.of, source) + number * dr.opaque(mi.UInt32, blocks.count)
        share = weight * dr.gather(mi.Float, blocks.share, source)
        dr.eval(row, cell, share)
        return RayMatrix(row, cell, share, blocks.count, count)

    def all_bounces(self, replicates: range) -> mi.TensorXf:
        """M = (1 − W·T·P)⁻¹, shape (replicate · block, block)."""
        if not self._all_bounces:
            source, cell, weight = (dr.concat(c) for c in zip(*self.bounces, strict=True))
            every = self.blocks.all_bounces(source, cell, weight, len(self.bounces))
            self._all_bounces.append(every)
        if len(replicates) == len(self.bounces):
            return self._all_bounces[0]
        rows, first = (n * self.blocks.count for n in (len(replicates), replicates.start))
        size = rows * self.blocks.count
        at = dr.arange(mi.UInt32, size) + dr.opaque(mi.UInt32, first * self.blocks.count)
        here = dr.gather(mi.Float, self._all_bounces[0].array, at)
        dr.eval(here)
        return mi.TensorXf(here, (rows, self.blocks.count))

    def matrix(self, replicate: int) -> csr_matrix:
        """T of a replicate, shape (cell, cell)."""
        if replicate not in self._matrices:
            source, cell, weight = (column.numpy() for column in self.bounces[replicate])
            shape = self.cells, self.cells
            self._matrices[replicate] = sparse.csr_matrix((weight, (source, cell)), shape=shape)
        return self._matrices[replicate]

    def indirect(
        self, replicates: range, d: mi.TensorXf, reached: LitCells | None = None
    ) -> mi.TensorXf:
        """Compute Y, the light that cells get from cells, by the T of some replicates.

        X = M·(W·T·D) is known by block; the last bounces, Y = T·(D + Y) from Y = P·X, by cell.

        Parameters
        ----------
        d : mi.TensorXf, shape (replicate · cell, bin)
            Irradiance before any diffuse reflection [sr].
        reached : Reached, optional
            Cells and bins with light of D.

        Returns
        -------
        mi.TensorXf, shape (replicate · cell, bin)
            Irradiance by light that cells have reflected [sr].
        """
        count, (rows, bins) = len(replicates), d.shape
        if reached is not None and not dr.width(reached.lit):
            return dr.zeros(mi.TensorXf, (rows, bins))
        once = product(self.sent(replicates), d, reached)
        X = by_replicate(self.all_bounces(replicates), once, count)
        block, light = self.blocks.of.numpy(), _by_replicate(d, count)
        Y = np.ascontiguousarray(_by_replicate(X, count)[:, block])
        for at, D, of_replicate in zip(replicates, light, Y, strict=True):
            T = self.matrix(at)[: self.sending]
            for _ in range(self.steps):
                of_replicate[: self.sending] = T @ (D + of_replicate)
        return mi.TensorXf(flat(Y), (rows, bins))

    def followed(self, replicates: range, to_cells: PathMatrix, sensors: slice) -> Followed:
        """Follow what sensors gather, G₁, through the last bounces and then from blocks.

        `to_cells` is G₁ of these replicates. States of a façade ask for the same sensors again.
        """
        blocks = self.blocks
        if not self.steps:
            onto_blocks = to_cells.columns(Columns(blocks.of, 0, blocks.count, 1))
            return Followed(to_cells, self._onward(replicates, onto_blocks))
        parts = []
        for r in replicates:
            key = sensors.start, sensors.stop, r
            part = self._followed.get(key)
            if part is None:
                part = self._of_replicate(r, to_cells._replace(replicates=1, first=r))
                if (len(self._followed) + 1) * to_cells.rows * self.cells <= KEPT:
                    self._followed[key] = part
            parts.append(part)
        whole = DenseMatrix(rows_of([part.to_cells for part in parts]), len(parts))
        return Followed(whole, self._onward(replicates, rows_of([p.onto_blocks for p in parts])))

    def _of_replicate(self, replicate: int, to_cells: PathMatrix) -> _LastBounces:
        """Follow what sensors gather in a replicate through the last bounces."""
        every, sending = dr.arange(mi.UInt32, self.cells), self.sending
        first = to_cells.columns(Columns(every, 0, self.cells, 1)).numpy()
        A, T = np.ascontiguousarray(first.T), self.matrix(replicate)[:sending].T.tocsr()
        total, end = A.copy(), np.zeros_like(A)
        for _ in range(self.steps):
            if sending is not None:
                end[sending:] += A[sending:]
            A = T @ A[:sending]
            total += A
        one, block = np.ones(self.cells, np.float32), self.blocks.of.numpy()
        shape = self.blocks.count, self.cells
        of_block = sparse.csr_matrix((one, (block, np.arange(self.cells))), shape=shape)
        tensors = (mi.TensorXf(flat(x.T), x.T.shape) for x in (total, of_block @ (A + end)))
        return _LastBounces(*tensors)

    def _onward(self, replicates: range, to_blocks: mi.TensorXf) -> Further:
        """Make the function that gives columns of (A·P)·M·(W·T).

        `to_blocks` is A·P, shape (replicate · sensor, block), A what sensors get of cells by way of
        the last bounces.
        """
        count, sent = len(replicates), self.sent(replicates)
        solved = by_replicate(to_blocks, self.all_bounces(replicates), count)
        dr.eval(solved)

        def columns(some: Columns) -> mi.TensorXf:
            rows, blocks = solved.shape
            each = mi.TensorXf(repeated(solved.array, some.pieces), (some.pieces * rows, blocks))
            return by_replicate(each, sent.columns(some), some.pieces * count)

        return columns

    def pays(self, bins: int, lit: int, sensors: int, most: int) -> bool:
        """Whether Y of so many bins takes fewer multiplications than `followed` from lit cells.

        A sensor gathers Y by no more than `most` multiplications for each bin.
        """
        blocks, rays = self.blocks.count, self.steps * SPARSE * dr.width(self.bounces[0].cell)
        of_light = bins * (blocks * (lit + blocks) + rays + sensors * min(self.cells, most))
        of_sensors = lit * blocks * (blocks + sensors) + sensors * (rays + lit * bins)
        return of_light <= of_sensors


def _by_replicate(light: mi.TensorXf, replicates: int) -> np.ndarray:
    """Light (replicate · row, bin) as an array (replicate, row, bin)."""
    rows, bins = light.shape
    return np.asarray(light.array.numpy().reshape(replicates, rows // replicates, bins))


def solved(
    scene: Scene, gathered: Gathered, accuracy: Accuracy, marks: Marks | None = None
) -> tuple[Gathered, Transfer]:
    """Trace T among the cells that sensors see, and those that these cells see in turn.

    Parameters
    ----------
    scene : Scene
    gathered : Gathered
        Paths from the sensors that end at their first diffuse vertex.
    accuracy : Accuracy
    marks : Marks, optional
        Rule that marks every ray with the surfaces that it meets.

    Returns
    -------
    gathered : Gathered
        The same paths, with all cells and the points that stand for them.
    transfer : Transfer
    """
    replicates, first = accuracy.replicates, _explored(scene, gathered, accuracy)
    cells, drawn, total = first.cells, gathered.drawn, first.of_sensors
    importance, points, sent = first.importance, first.points, 0
    parts: list[list[OneBounce]] = [[] for _ in range(replicates)]
    marked: list[list[mi.UInt32]] = [[] for _ in range(replicates)]
    while min(cells.count, MOST_CELLS) - sent > LAST * sent:
        here = slice(sent, min(cells.count, MOST_CELLS))
        for rays in trace(scene, cells, points, here, accuracy.cell_paths, accuracy, 1, marks):
            cells = cells.extended(rays.met)
            met = rays.weighed(importance, replicates)
            cell = cells.of(met)
            drawn = drawn.extended(met, cell, cells.count, own=rays.replicate)
            total = with_weights(total, cells.count, cell, met.weight)
            each = dr.width(cell) // replicates  # the rays of a replicate stand together
            for r, part in enumerate(parts):
                at = dr.arange(mi.UInt32, each) + dr.opaque(mi.UInt32, r * each)
                columns = (rays.source, cell, rays.met.weight)
                part.append(OneBounce(*(dr.gather(type(c), c, at) for c in columns)))
                if marks is not None:
                    marked[r].append(dr.gather(mi.UInt32, rays.met.mark, at))
                dr.eval(*part[-1], marked[r])
        importance, points, sent = mi.Float(total), drawn, here.stop
    bounces = tuple(OneBounce(*(dr.concat(c) for c in zip(*p, strict=True))) for p in parts)
    # No rays give the mean of a block from the cells that come last.
    sends = dr.arange(mi.UInt32, cells.count) < dr.opaque(mi.UInt32, sent)
    weight = dr.maximum(dr.select(sends, mi.Float(total), 0), 1e-30)
    blocks = Blocks.weighed(cells, weight, drawn.rooms)
    marks_of = () if marks is None else tuple(map(dr.concat, marked))
    steps = AMONG_FURNITURE if len(furniture(scene)) else STEPS
    steps = 0 if blocks.count == cells.count else steps
    sending = None if sent == cells.count else sent
    known = None if marks is None else weight
    transfer = Transfer(blocks, bounces, steps, sending, marks_of, known)
    return replace(gathered, cells=cells, drawn=drawn), transfer


class _Explored(NamedTuple):
    """Result of the first round."""

    cells: Cells
    points: CellPoints
    """Points that rays of the second round start from."""
    of_sensors: mi.Float64
    """G₁ of every cell, in sum over the sensors."""
    importance: mi.Float


def _explored(scene: Scene, gathered: Gathered, accuracy: Accuracy) -> _Explored:
    """Find all cells and their importance by few paths from those that the sensors see.

    The importance is the light that all sensors get by way of a cell, I = G₁ + G₁·T + G₁·T² + ….
    """
    assert gathered.seen is not None
    seen, cells, points = mi.Float(gathered.seen), gathered.cells, gathered.drawn
    total, known = gathered.seen, slice(0, min(cells.count, MOST_CELLS))
    possible = min(_possible_cells(scene, accuracy.cell_size), MANY)
    each = max(FEW, math.ceil(PER_CELL * possible / known.stop))
    for paths in trace(scene, cells, points, known, each, accuracy, 0, once=False):
        met = paths.weighed(seen, accuracy.replicates)
        cells = cells.extended(met)
        cell = cells.of(met)
        points = points.extended(met, cell, cells.count, own=paths.replicate)
        total = with_weights(total, cells.count, cell, met.weight)
    of_sensors = with_weights(gathered.seen, cells.count, mi.UInt32(), mi.Float())
    most = float(dr.max(total)[0])
    importance = dr.maximum(mi.Float(total), dr.opaque(mi.Float, 1e-9 * most))
    return _Explored(cells, points, of_sensors, importance)


def _possible_cells(scene: Scene, size: float) -> float:
    """Number of cells on all diffuse surfaces, about."""
    quads = [part.quads for part in scene.parts if is_diffuse(part.material)]
    if not quads:
        return 0.0
    every = np.concatenate(quads)
    area = np.linalg.norm(np.cross(every[:, 1] - every[:, 0], every[:, 3] - every[:, 0]), axis=1)
    return float((area * np.where(is_triangle(every), 0.5, 1.0)).sum() / size**2)
