"""Products of what rays gather and the light of cells, in several replicates at once.

Rows of a matrix are those of one replicate after those of another. Rays tell a matrix by the sums
of their weights; only the columns of cells that have light are ever made.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from drcmitsuba.runtime.flat_arrays import row_and_column

SUMMED = 1 << 9
"""Number of cells whose light is summed in single precision."""


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
    """Some of the lit cells, one after another."""

    place: mi.UInt32
    """Place of every cell among all lit cells; their number for a dark one."""
    start: int
    """Place of the first cell."""
    size: int


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
        """Columns of some cells, shape (replicate · row, cell), summed in double precision."""
        first, size = (dr.opaque(mi.UInt32, n) for n in some[1:])
        there = mi.Bool(True) if self.there is None else self.there
        at = dr.gather(mi.UInt32, some.place, self.cell, there)
        here = there & (at >= first) & (at < first + size)
        every = self.replicates * self.rows
        out = dr.zeros(mi.Float64, every * some.size)
        dr.scatter_add(out, mi.Float64(self.weight), self.row * size + at - first, here)
        return mi.TensorXf(mi.Float(out), (every, some.size))

    def whole(self, cells: int) -> mi.TensorXf:
        """All columns, shape (replicate · row, cell)."""
        return self.columns(Columns(dr.arange(mi.UInt32, cells), 0, cells))


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
    every, stride = dr.opaque(mi.UInt32, cells), dr.opaque(mi.UInt32, bins)
    place = dr.full(mi.UInt32, n_lit, cells)
    dr.scatter(place, dr.arange(mi.UInt32, n_lit), lit)
    total = mi.Float64(0)
    for start in range(0, n_lit, SUMMED):
        some = Columns(place, start, min(SUMMED, n_lit - start))
        line, column = row_and_column(
            dr.arange(mi.UInt32, count * some.size * n_shining), n_shining
        )
        replicate, at = row_and_column(line, some.size)
        from_cell = dr.gather(mi.UInt32, lit, at + dr.opaque(mi.UInt32, start)) + replicate * every
        from_bin = dr.gather(mi.UInt32, shining, column)
        D = dr.gather(mi.Float, d.array, from_cell * stride + from_bin)
        G = matrix.columns(some) if further is None else matrix.columns(some) + further(some)
        part = by_replicate(G, mi.TensorXf(D, (count * some.size, n_shining)), count)
        total += mi.Float64(part.array)
    row, column = row_and_column(dr.arange(mi.UInt32, rows * n_shining), n_shining)
    dr.scatter(out, mi.Float(total), row * stride + dr.gather(mi.UInt32, shining, column))
    return mi.TensorXf(out, (rows, bins))
