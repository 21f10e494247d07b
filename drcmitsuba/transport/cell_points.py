"""Points that stand for cells: vertices drawn at random, one in each cell and replicate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from drcmitsuba.transport.cells import Vertices

# Multiplication by an odd number permutes the 32-bit integers.
_SCRAMBLE = 0x9E3779B1


class Drawn(NamedTuple):
    """Vertices that stand for the cells."""

    rank: mi.UInt32
    """Rank of the drawn vertex, the largest in its cell."""
    p: mi.Float
    n: mi.Float
    """Positions and normals, three numbers a cell."""
    within: mi.Bool | None = None
    """Whether the points lie in the rooms of a model; None where nothing tells."""


def draw_points(
    vertices: Vertices, cell: mi.UInt32, count: int, salt: int, before: Drawn | None = None
) -> Drawn:
    """Draw one vertex at random from each of `count` cells; each `salt` gives another draw.

    `cell` holds the cell of every vertex. The draw extends `before`, a draw among earlier vertices.
    """
    return _draws(vertices, cell, count, [before], salt, weighted=False)[0]


def draw_all(
    vertices: Vertices, cell: mi.UInt32, count: int, before: Sequence[Drawn | None], *,
    weighted: bool = False, own: mi.UInt32 | None = None,
) -> tuple[Drawn, ...]:  # fmt: skip
    """Extend the draws `before` of all replicates, as `draw_points` does.

    A `weighted` draw takes vertices in proportion to their weights. `own` is the replicate of every
    vertex: each replicate then draws from its own, and takes the point of the next one that has one
    for a cell in which it has none. Without it, all draw from all vertices.
    """
    return _draws(vertices, cell, count, before, 0, weighted=weighted, own=own)


def _draws(
    vertices: Vertices, cell: mi.UInt32, count: int, before: Sequence[Drawn | None], salt: int, *,
    weighted: bool, own: mi.UInt32 | None = None,
) -> tuple[Drawn, ...]:  # fmt: skip
    """Extend draws of the salts from `salt` on: all in one launch, whatever their number."""
    told = vertices.within is not None
    if count == 0:  # no path met a surface
        none = mi.UInt32(), mi.Float(), mi.Float(), mi.Bool() if told else None
        return tuple(Drawn(*none) for _ in before)
    every = _joined(before, count, told)
    tag = dr.zeros(mi.UInt32, dr.width(every.rank))
    dr.make_opaque(tag)
    number, stride, first = (dr.opaque(mi.UInt32, n) for n in (len(before), count, salt))
    begin = mi.UInt32(0) if own is None else own
    end = number if own is None else own + 1
    draws = _Draws(vertices, cell, every, tag, begin, end, stride, first, weighted)
    draws.rank()
    dr.eval(every.rank)
    draws.break_ties()
    dr.eval(tag)
    draws.place()
    dr.eval(every)
    if own is not None:
        _lend(every, number, stride)
    at = dr.arange(mi.UInt32, count)
    parts = []
    for i in range(len(before)):
        entry = at + dr.opaque(mi.UInt32, i * count)
        rank, p, n = (
            dr.gather(mi.UInt32, every.rank, entry),
            *(dr.ravel(dr.gather(mi.Point3f, values, entry)) for values in (every.p, every.n)),
        )
        within = dr.gather(mi.Bool, every.within, entry) if told else None
        parts.append(Drawn(rank, p, n, within))
    dr.eval(parts)
    return tuple(parts)


@dataclass(frozen=True)
class _Draws:
    """Draws among the same vertices, one after another in the arrays of `every`."""

    vertices: Vertices
    cell: mi.UInt32
    every: Drawn
    tag: mi.UInt32
    """Largest tag among the vertices of the largest rank: it breaks ties."""
    begin: mi.UInt32
    end: mi.UInt32
    """First draw of every vertex, and the one after its last."""
    stride: mi.UInt32
    """Number of cells."""
    salt: mi.UInt32
    """Salt of the first draw."""
    weighted: bool

    @property
    def _met(self) -> mi.Bool:
        """Whether an entry is a vertex at all."""
        return self.vertices.weight > 0

    def _entry(self, draw: mi.UInt32) -> mi.UInt32:
        """Entry of every vertex' cell in a draw."""
        return draw * self.stride + self.cell

    def _ranks(self, draw: mi.UInt32) -> mi.UInt32:
        """Rank of every vertex; the largest in a cell wins, whatever the order of threads."""
        salt = (self.salt + draw) * mi.UInt32(0x85EBCA6B)
        rank = (self.vertices.tag ^ salt) * _SCRAMBLE
        if not self.weighted:
            return rank
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

    @dr.syntax
    def rank(self) -> None:
        """Find the largest ranks."""
        draw = mi.UInt32(self.begin)
        while dr.hint(draw < self.end, exclude=[self]):
            at, rank = self._entry(draw), self._ranks(draw)
            dr.scatter_reduce(dr.ReduceOp.Max, self.every.rank, rank, at, self._met)
            draw += 1

    @dr.syntax
    def break_ties(self) -> None:
        """Find the largest tag among the vertices of the largest rank."""
        draw = mi.UInt32(self.begin)
        while dr.hint(draw < self.end, exclude=[self]):
            at, best, tag = self._entry(draw), self._best(draw), self.vertices.tag
            dr.scatter_reduce(dr.ReduceOp.Max, self.tag, tag, at, best)
            draw += 1

    @dr.syntax
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


@dr.syntax
def _lend(every: Drawn, number: mi.UInt32, stride: mi.UInt32) -> None:
    """Take the points of other draws where a draw has none.

    Their rank remains 0: any vertex of its own takes a lent point's place.
    """
    entry = dr.arange(mi.UInt32, dr.width(every.rank))
    empty, told = every.rank == 0, every.within is not None
    cell, other, step = entry % stride, mi.UInt32(entry), mi.UInt32(1)
    while dr.hint(empty & (step < number), exclude=[every, told, entry, cell, number, stride]):
        at = (entry // stride + step) % number * stride + cell
        has = dr.gather(mi.UInt32, every.rank, at) > 0
        other = dr.select(has, at, other)
        empty &= ~has
        step += 1
    p, n = (dr.gather(mi.Point3f, values, other) for values in (every.p, every.n))
    within = dr.gather(mi.Bool, every.within, other) if told else mi.Bool(False)
    dr.eval(p, n, within)  # read before any is written
    dr.scatter(every.p, p, entry)
    dr.scatter(every.n, n, entry)
    if dr.hint(told, mode="scalar"):
        dr.scatter(every.within, within, entry)
    dr.eval(every)


def _joined(before: Sequence[Drawn | None], count: int, told: bool) -> Drawn:
    """Copies of draws one after another, each with room for `count` cells."""
    whole = len(before) * count
    p, n = (dr.zeros(mi.Float, 3 * whole) for _ in range(2))
    within = dr.zeros(mi.Bool, whole) if told else None
    every = Drawn(dr.zeros(mi.UInt32, whole), p, n, within)
    for name, column in every._asdict().items():
        if column is None:
            continue
        step = dr.width(column) // len(before)
        for i, old in enumerate(before):
            values = None if old is None else getattr(old, name)
            if values is not None and dr.width(values):
                to = dr.arange(mi.UInt32, dr.width(values)) + dr.opaque(mi.UInt32, i * step)
                dr.scatter(column, values, to)
        dr.eval(column)  # Dr.Jit 1.5 ignores a pending scatter when it reduces
    return every
