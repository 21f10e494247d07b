"""Products of what rays gather and the light of cells, in several replicates at once.

Rows of a matrix are those of one replicate after those of another. Rays tell a matrix by the sums
of their weights; only the columns of cells that have light are ever made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from drcmitsuba.runtime.flat_arrays import row_and_column

SUMMED = 1 << 9
"""Number of cells whose light is summed in single precision."""
TOGETHER = 1 << 24
"""Largest number of values of a matrix, or of its product, that are made at once."""


class Reached(NamedTuple):
    """Where D has light."""

    lit: mi.UInt32
    """Cells that get light from any bin."""
    shining: mi.UInt32
    """Bins that reach any cell."""

    @classmethod
    def by(cls, d: mi.TensorXf, replicates: int = 1) -> Reached:
        """Find the lit cells and the shining bins of D (replicate · cell, bin)."""
        (rows, bins), values = d.shape, d.array
        if not rows * bins:
            return cls(mi.UInt32(), mi.UInt32())
        row, bin = row_and_column(dr.arange(mi.UInt32, rows * bins), bins)
        _, cell = row_and_column(row, rows // replicates)
        lit, shining = dr.zeros(mi.Bool, rows // replicates), dr.zeros(mi.Bool, bins)
        dr.scatter(lit, mi.Bool(True), cell, values > 0)
        dr.scatter(shining, mi.Bool(True), bin, values > 0)
        dr.eval(lit, shining)
        return cls(dr.compress(lit), dr.compress(shining))


class Columns(NamedTuple):
    """Pieces of the lit cells, of the same size; the last one is filled up with dark ones."""

    place: mi.UInt32
    """Place of every cell among the lit ones, beyond all pieces for a dark one."""
    start: int
    """Place of the first cell."""
    size: int
    """Number of cells of a piece."""
    pieces: int


Further = Callable[[Columns], Any]
"""Function that gives columns of a matrix, mi.TensorXf, which is added to that of the rays."""


class RayMatrix(NamedTuple):
    """Matrix (row, cell) of every replicate: the sum of the weights of rays."""

    row: mi.UInt32
    """Replicate · rows + row of every ray."""
    cell: mi.UInt32
    weight: mi.Float
    rows: int
    """Number of rows of a replicate."""
    replicates: int = 1
    there: mi.Bool | None = None
    """Whether a ray counts; by default all do."""

    def columns(self, some: Columns) -> mi.TensorXf:
        """Columns of some cells, shape (piece · replicate · row, cell)."""
        first, size = dr.opaque(mi.UInt32, some.start), dr.opaque(mi.UInt32, some.size)
        count = dr.opaque(mi.UInt32, some.size * some.pieces)
        there = mi.Bool(True) if self.there is None else self.there
        at = dr.gather(mi.UInt32, some.place, self.cell, there) - first
        here = there & (at < count)  # places before the first one wrap around
        piece, column = row_and_column(at, some.size)
        every = self.replicates * self.rows
        line = piece * dr.opaque(mi.UInt32, every) + self.row
        # Double precision neither drifts nor lets the order of threads show in single precision.
        out = dr.zeros(mi.Float64, some.pieces * every * some.size)
        # The rays of a row stand together: their threads hardly meet.
        mode = dr.ReduceMode.Local
        dr.scatter_add(out, mi.Float64(self.weight), line * size + column, here, mode=mode)
        return mi.TensorXf(mi.Float(out), (some.pieces * every, some.size))

    def whole(self, cells: int) -> mi.TensorXf:
        """All columns, shape (replicate · row, cell)."""
        return self.columns(Columns(dr.arange(mi.UInt32, cells), 0, cells, 1))


def rows_of(tensors: Sequence[mi.TensorXf]) -> mi.TensorXf:
    """Rows of several matrices one after another."""
    rows, columns = sum(one.shape[0] for one in tensors), tensors[0].shape[1]
    if not rows * columns:
        return dr.zeros(mi.TensorXf, (rows, columns))
    return mi.TensorXf(dr.concat([one.array for one in tensors]), (rows, columns))


def by_replicate(a: mi.TensorXf, b: mi.TensorXf, replicates: int) -> mi.TensorXf:
    """Products of matrices (row, inner) and (inner, column), one after another in rows."""
    (rows, inner), columns = a.shape, b.shape[1]
    if not rows * inner * columns:
        return dr.zeros(mi.TensorXf, (rows, columns))
    each = mi.TensorXf(a.array, (replicates, rows // replicates, inner))
    out = each @ mi.TensorXf(b.array, (replicates, inner, columns))
    return mi.TensorXf(out.array, (rows, columns))


def product(
    matrix: RayMatrix, d: mi.TensorXf, reached: Reached | None = None,
    further: Further | None = None,
) -> mi.TensorXf:  # fmt: skip
    """G·D, shape (replicate · row, bin), with D of shape (replicate · cell, bin).

    Cells without light and bins that reach no cell are left out of the matrices: `reached`, where D
    is used more than once. G is summed in double precision, and the product `SUMMED` cells at a
    time: single precision drifts. `further` is added to G.
    """
    count, rows = matrix.replicates, matrix.replicates * matrix.rows
    if 0 in d.shape:
        return dr.zeros(mi.TensorXf, (rows, d.shape[1]))
    cells, bins = d.shape[0] // count, d.shape[1]
    lit, shining = Reached.by(d, count) if reached is None else reached
    n_lit, n_shining = dr.width(lit), dr.width(shining)
    out = dr.zeros(mi.Float, rows * bins)
    if not n_lit * n_shining:
        return mi.TensorXf(out, (rows, bins))
    # Literals would have kernels compiled anew.
    every, stride, known = (dr.opaque(mi.UInt32, n) for n in (cells, bins, n_lit))
    place = dr.full(mi.UInt32, 0x7FFFFFFF, cells)
    dr.scatter(place, dr.arange(mi.UInt32, n_lit), lit)
    all_pieces = -(-n_lit // SUMMED)
    size = -(-n_lit // all_pieces)
    step = max(1, TOGETHER // (rows * max(size, n_shining)))
    total = mi.Float64(0)
    for first in range(0, all_pieces, step):
        some = Columns(place, first * size, size, min(step, all_pieces - first))
        batch = some.pieces * count
        line, column = row_and_column(dr.arange(mi.UInt32, batch * size * n_shining), n_shining)
        piece, replicate, at = _piece(line, size, count)
        at += piece * dr.opaque(mi.UInt32, size) + dr.opaque(mi.UInt32, some.start)
        from_cell = dr.gather(mi.UInt32, lit, at, at < known) + replicate * every
        from_bin = dr.gather(mi.UInt32, shining, column)
        D = dr.gather(mi.Float, d.array, from_cell * stride + from_bin, at < known)
        G = matrix.columns(some) if further is None else matrix.columns(some) + further(some)
        parts = by_replicate(G, mi.TensorXf(D, (batch * size, n_shining)), batch).array
        dr.eval(parts)
        entry = dr.arange(mi.UInt32, rows * n_shining)
        for piece in range(some.pieces):
            begin = dr.opaque(mi.UInt32, piece * rows * n_shining)
            total += mi.Float64(dr.gather(mi.Float, parts, entry + begin))
    row, column = row_and_column(dr.arange(mi.UInt32, rows * n_shining), n_shining)
    dr.scatter(out, mi.Float(total), row * stride + dr.gather(mi.UInt32, shining, column))
    return mi.TensorXf(out, (rows, bins))


def _piece(line: mi.UInt32, size: int, replicates: int) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32]:
    """Piece, replicate and column of lines piece · replicate · column."""
    batch, column = row_and_column(line, size)
    piece, replicate = row_and_column(batch, replicates)
    return piece, replicate, column
