"""Points that stand for cells: vertices drawn at random, one in each cell and replicate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import row_and_column
from drcmitsuba.transport.cells.vertices import Vertices

# Multiplication by an odd number permutes the 32-bit integers.
_SCRAMBLE = 0x9E3779B1


@dataclass(frozen=True)
class CellPoints:
    """Vertices that stand for the cells, one for each cell in every replicate.

    Entries are those of one replicate after those of another.
    """

    replicates: int
    cells: int
    """Number of cells."""
    rank: mi.UInt32
    """Rank of the drawn vertex, the largest in its cell; 0 of a point that another draw lends."""
    p: mi.Float
    n: mi.Float
    """Positions and normals, three numbers an entry."""
    within: mi.UInt32 | None = None
    """Number of the room of a model in which each point lies, 0 outside; None where nothing
    tells."""

    @classmethod
    def none(cls, replicates: int) -> CellPoints:
        """Begin without cells."""
        return cls(replicates, 0, mi.UInt32(), mi.Float(), mi.Float())

    def of(self, replicates: range) -> CellPoints:
        """Draws of some replicates."""
        if len(replicates) == self.replicates or not self.cells:
            return replace(self, replicates=len(replicates))
        first = dr.opaque(mi.UInt32, replicates.start * self.cells)
        entry = dr.arange(mi.UInt32, len(replicates) * self.cells) + first
        return self._at(len(replicates), self.cells, entry, mi.Bool(True))

    def of_cells(self, some: slice) -> tuple[CellPoints, tuple[mi.UInt32, mi.UInt32]]:
        """Draws of some cells, and the replicate and the cell of each point."""
        count = some.stop - some.start
        entry = dr.arange(mi.UInt32, self.replicates * count)
        replicate, cell = row_and_column(entry, count)
        cell += dr.opaque(mi.UInt32, some.start)
        dr.eval(replicate, cell)
        if count == self.cells:
            return self, (replicate, cell)
        entry = replicate * dr.opaque(mi.UInt32, self.cells) + cell
        return self._at(self.replicates, count, entry, mi.Bool(True)), (replicate, cell)

    def apart(self) -> list[CellPoints]:
        """Draws of every replicate by itself."""
        return [self.of(range(r, r + 1)) for r in range(self.replicates)]

    @property
    def rooms(self) -> mi.UInt32 | None:
        """Room of a model that some point of each cell lies in, 0 for none; None if untold."""
        if self.within is None:
            return None
        out = dr.zeros(mi.UInt32, self.cells)
        for r in range(self.replicates):
            first = dr.opaque(mi.UInt32, r * self.cells)
            out = dr.maximum(
                out, dr.gather(mi.UInt32, self.within, first + dr.arange(mi.UInt32, self.cells))
            )
        dr.eval(out)
        return out

    def extended(
        self, vertices: Vertices, cell: mi.UInt32, count: int, own: mi.UInt32 | None = None,
    ) -> CellPoints:  # fmt: skip
        """Draw one vertex at random from each of `count` cells, among these and earlier vertices.

        `cell` holds the cell of every vertex. Vertices are drawn in proportion to their weights: a
        cell may lie on both sides of a pane, and what is seen through it counts less. `own` is the
        replicate of every vertex: each replicate then draws from its own, and takes the point of
        the next one that has one for a cell in which it has none. Without it, all draw from all
        vertices.
        """
        if count == 0:  # no path met a surface
            return self
        every = self._with_room(count, told=vertices.within is not None)
        tag = dr.zeros(mi.UInt32, dr.width(every.rank))
        dr.make_opaque(tag)
        number, stride = (dr.opaque(mi.UInt32, n) for n in (self.replicates, count))
        begin = mi.UInt32(0) if own is None else own
        end = number if own is None else own + 1
        kernels = _Kernels(vertices, cell, every, tag, begin, end, stride)
        kernels.rank()
        dr.eval(every.rank)
        kernels.break_ties()
        dr.eval(tag)
        kernels.place()
        dr.eval(every)
        if own is not None:
            _lend(every, number, stride)
        return every

    def _with_room(self, count: int, *, told: bool) -> CellPoints:
        """Copy with room for `count` cells."""
        if self.cells:
            replicate, cell = row_and_column(dr.arange(mi.UInt32, self.replicates * count), count)
            before = dr.opaque(mi.UInt32, self.cells)
            out = self._at(self.replicates, count, replicate * before + cell, cell < before)
        else:
            rank = dr.zeros(mi.UInt32, self.replicates * count)
            p, n = (dr.zeros(mi.Float, 3 * self.replicates * count) for _ in range(2))
            within = dr.zeros(mi.UInt32, self.replicates * count) if told else None
            out = CellPoints(self.replicates, count, rank, p, n, within)
        dr.make_opaque(out)  # Dr.Jit 1.5 ignores a pending scatter when it reduces
        return out

    def _at(self, replicates: int, cells: int, entry: mi.UInt32, there: mi.Bool) -> CellPoints:
        """Copy of some entries."""
        rank = dr.gather(mi.UInt32, self.rank, entry, there)
        p, n = (dr.gather(mi.Point3f, values, entry, there) for values in (self.p, self.n))
        within = None if self.within is None else dr.gather(mi.UInt32, self.within, entry, there)
        dr.eval(rank, p, n, within)
        return CellPoints(replicates, cells, rank, dr.ravel(p), dr.ravel(n), within)


@dataclass(frozen=True)
class _Kernels:
    """Draws among the same vertices, one after another in the arrays of `every`."""

    vertices: Vertices
    cell: mi.UInt32
    every: CellPoints
    tag: mi.UInt32
    """Largest tag among the vertices of the largest rank: it breaks ties."""
    begin: mi.UInt32
    end: mi.UInt32
    """First draw of every vertex, and the one after its last."""
    stride: mi.UInt32
    """Number of cells."""

    @property
    def _met(self) -> mi.Bool:
        """Whether an entry is a vertex at all."""
        return self.vertices.weight > 0

    def _entry(self, draw: mi.UInt32) -> mi.UInt32:
        """Entry of every vertex' cell in a draw."""
        return draw * self.stride + self.cell

    def _ranks(self, draw: mi.UInt32) -> mi.UInt32:
        """Rank of every vertex; the largest in a cell wins, whatever the order of threads."""
        salt = draw * mi.UInt32(0x85EBCA6B)
        rank = (self.vertices.tag ^ salt) * _SCRAMBLE
        # w / −ln(1 − v) is the largest with probability w / Σw; positive floats sort as integers.
        # The last steps of MurmurHash3 make the v of neighbouring tags independent.
        rank = (rank ^ (rank >> 16)) * mi.UInt32(0x85EBCA6B)
        rank = (rank ^ (rank >> 13)) * mi.UInt32(0xC2B2AE35)
        v = (mi.Float(rank ^ (rank >> 16)) + 0.5) * 2.0**-32
        time = dr.select(v < 1e-3, v + 0.5 * dr.square(v), -dr.log(dr.maximum(1 - v, 2.0**-24)))
        return dr.reinterpret_array(mi.UInt32, self.vertices.weight / time)

    def _best(self, draw: mi.UInt32) -> mi.Bool:
        """Whether a vertex has the largest rank in its cell."""
        rank = dr.gather(mi.UInt32, self.every.rank, self._entry(draw), self._met)
        return self._met & (rank == self._ranks(draw))

    @symbolic
    def rank(self) -> None:
        """Find the largest ranks."""
        draw = mi.UInt32(self.begin)
        while dr.hint(draw < self.end, exclude=[self]):
            at, rank = self._entry(draw), self._ranks(draw)
            _largest(self.every.rank, rank, at, self._met)
            draw += 1

    @symbolic
    def break_ties(self) -> None:
        """Find the largest tag among the vertices of the largest rank."""
        draw = mi.UInt32(self.begin)
        while dr.hint(draw < self.end, exclude=[self]):
            at, best, tag = self._entry(draw), self._best(draw), self.vertices.tag
            _largest(self.tag, tag, at, best)
            draw += 1

    @symbolic
    def place(self) -> None:
        """Keep the points of the vertices that have won."""
        each, told = dr.arange(mi.UInt32, len(self.vertices)), self.every.within is not None
        p = dr.gather(mi.Point3f, self.vertices.p, each)
        n = dr.gather(mi.Point3f, self.vertices.n, each)
        draw = mi.UInt32(self.begin)
        while dr.hint(draw < self.end, exclude=[self, p, n, told]):
            at, best = self._entry(draw), self._best(draw)
            wins = best & (dr.gather(mi.UInt32, self.tag, at, best) == self.vertices.tag)
            dr.scatter(self.every.p, p, at, wins)
            dr.scatter(self.every.n, n, at, wins)
            if dr.hint(told, mode="scalar"):
                dr.scatter(self.every.within, self.vertices.within, at, wins)
            draw += 1


def _largest(out: mi.UInt32, values: mi.UInt32, entry: mi.UInt32, active: mi.Bool) -> None:
    """Keep the largest values, without copies of `out` for threads: no kernel knows its size."""
    dr.scatter_reduce(dr.ReduceOp.Max, out, values, entry, active, mode=dr.ReduceMode.Direct)


@symbolic
def _lend(every: CellPoints, number: mi.UInt32, stride: mi.UInt32) -> None:
    """Take the points of other draws where a draw has none.

    Their rank remains 0: any vertex of its own takes a lent point's place.
    """
    entry = dr.arange(mi.UInt32, dr.width(every.rank))
    empty, told = every.rank == 0, every.within is not None
    draw, cell = row_and_column(entry, every.cells)
    other, step = mi.UInt32(entry), mi.UInt32(1)
    while dr.hint(empty & (step < number), exclude=[every, told, draw, cell, number, stride]):
        next_draw = draw + step
        at = dr.select(next_draw < number, next_draw, next_draw - number) * stride + cell
        has = dr.gather(mi.UInt32, every.rank, at) > 0
        other = dr.select(has, at, other)
        empty &= ~has
        step += 1
    p, n = (dr.gather(mi.Point3f, values, other) for values in (every.p, every.n))
    within = dr.gather(mi.UInt32, every.within, other) if told else mi.UInt32(0)
    dr.eval(p, n, within)  # read before any is written
    dr.scatter(every.p, p, entry)
    dr.scatter(every.n, n, entry)
    if dr.hint(told, mode="scalar"):
        dr.scatter(every.within, within, entry)
    dr.eval(every)
