"""Products of what rays gather and the light of cells, in several replicates at once.

Rows of a matrix are those of one replicate after those of another. Rays tell a matrix by the sums
of their weights; only the columns of cells that have light are ever made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import row_and_column
from drcmitsuba.transport.light.lit_cells import LitCells, Tile

SUMMED = 1 << 9
"""Number of cells whose light is summed in single precision."""
TOGETHER = 1 << 24
"""Largest number of values of a matrix, or of its product, that are made at once."""
NOWHERE = 0xFFFFFFFF
"""Entry of a cell that is not among some columns."""
MOST_SINGLE = 1 << 12
"""Number of paths of a row whose weights are summed in single precision."""


class Columns(NamedTuple):
    """Pieces of the lit cells, of the same size; the last one is filled up with dark ones."""

    place: mi.UInt32
    """Place of every cell among the lit ones, beyond all pieces for a dark one; or its block, in
    columns of blocks."""
    start: int
    """Place of the first cell."""
    size: int
    """Number of cells of a piece."""
    pieces: int

    def entries(self, rows: int) -> mi.UInt32:
        """Entry of every cell in the first row of (piece · row, cell); `NOWHERE` beyond them."""
        at = self.place - dr.opaque(mi.UInt32, self.start)  # places before it wrap around
        piece, column = row_and_column(at, self.size)
        entry = piece * dr.opaque(mi.UInt32, rows * self.size) + column
        entry = dr.select(at < dr.opaque(mi.UInt32, self.size * self.pieces), entry, NOWHERE)
        dr.eval(entry)
        return entry


Further = Callable[[Columns], Any]
"""Function that gives columns of a matrix, mi.TensorXf, which is added to that of the rays."""


class Matrix(Protocol):
    """Matrix (row, cell) of every replicate."""

    @property
    def rows(self) -> int:
        """Number of rows of a replicate."""

    @property
    def replicates(self) -> int:
        """Number of replicates."""

    def columns(self, some: Columns) -> mi.TensorXf:
        """Columns of some cells, shape (piece · replicate · row, cell)."""


class RayMatrix(NamedTuple):
    """Matrix of the sums of the weights of rays in any order."""

    row: mi.UInt32
    """Replicate · rows + row of every ray."""
    cell: mi.UInt32
    weight: mi.Float
    rows: int
    replicates: int = 1
    there: mi.Bool | None = None
    """Whether a ray counts; by default all do."""

    def columns(self, some: Columns) -> mi.TensorXf:
        """Columns of some cells, as `Matrix.columns`."""
        every, there = self.replicates * self.rows, self.there
        active = mi.Bool(True) if there is None else there
        entry = dr.gather(mi.UInt32, some.entries(every), self.cell, active)
        here = active & (entry != NOWHERE)
        entry += self.row * dr.opaque(mi.UInt32, some.size)
        # Double precision neither drifts nor lets the order of threads show in single precision.
        out = dr.zeros(mi.Float64, some.pieces * every * some.size)
        # The rays of a row stand together: their threads hardly meet.
        dr.scatter_add(out, mi.Float64(self.weight), entry, here, mode=dr.ReduceMode.Local)
        return mi.TensorXf(mi.Float(out), (some.pieces * every, some.size))


class PathMatrix(NamedTuple):
    """Matrix of the sums of the weights of paths, which stand together by rows.

    One thread sums a row, path after path: sums need not be atomic, and no order of threads shows.
    """

    cell: mi.UInt32
    """Cell of every path of all replicates, as many in each row."""
    weight: mi.Float
    """Weight of every path; 0 for none."""
    paths: int
    """Number of paths of a row."""
    rows: int
    replicates: int
    first: int = 0
    """Number of replicates before these."""

    def columns(self, some: Columns) -> mi.TensorXf:
        """Columns of some cells, as `Matrix.columns`."""
        every = self.replicates * self.rows
        kind = mi.Float if self.paths <= MOST_SINGLE else mi.Float64
        out = dr.zeros(kind, some.pieces * every * some.size)
        dr.make_opaque(out)  # a loop that is being recorded adds to it
        row = dr.arange(mi.UInt32, every)
        begin, paths = (dr.opaque(mi.UInt32, n) for n in (self.first * self.rows, self.paths))
        path, start = (row + begin) * paths, row * dr.opaque(mi.UInt32, some.size)
        add_rows(out, start, path, path + paths, self.cell, self.weight, some.entries(every))
        return mi.TensorXf(mi.Float(out), (some.pieces * every, some.size))


class DenseMatrix(NamedTuple):
    """Matrix of which every value is known, shape (replicate · row, cell)."""

    values: mi.TensorXf
    replicates: int

    @property
    def rows(self) -> int:
        """Number of rows of a replicate."""
        return int(self.values.shape[0]) // self.replicates

    def columns(self, some: Columns) -> mi.TensorXf:
        """Columns of some cells, as `Matrix.columns`; no two cells share one."""
        rows, cells = self.values.shape
        row, cell = row_and_column(dr.arange(mi.UInt32, rows * cells), cells)
        entry = dr.gather(mi.UInt32, some.entries(rows), cell)
        here = entry != NOWHERE
        entry += row * dr.opaque(mi.UInt32, some.size)
        out = dr.zeros(mi.Float, some.pieces * rows * some.size)
        dr.scatter(out, self.values.array, entry, here)
        return mi.TensorXf(out, (some.pieces * rows, some.size))


@symbolic
def add_rows(
    out: mi.Float, start: mi.UInt32, at: mi.UInt32, end: mi.UInt32, cell: mi.UInt32,
    weight: mi.Float, entries: mi.UInt32,
) -> None:  # fmt: skip
    """Add the weights from `at` to `end` to each row of a matrix, which begins at `start`.

    `entries` are those of cells in the first row. One thread adds a row: sums are not atomic.
    """
    while dr.hint(at < end, exclude=[out, start, end, cell, weight, entries]):
        value = dr.gather(mi.Float, weight, at)
        entry = dr.gather(mi.UInt32, entries, dr.gather(mi.UInt32, cell, at))
        here, mode = (value > 0) & (entry != NOWHERE), dr.ReduceMode.NoConflicts
        dr.scatter_add(out, type(out)(value), entry + start, here, mode=mode)
        at += 1


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
    matrix: Matrix, d: mi.TensorXf, reached: LitCells | None = None,
    further: Further | None = None,
) -> mi.TensorXf:  # fmt: skip
    """G·D, shape (replicate · row, bin), with D of shape (replicate · cell, bin).

    Cells without light and bins that reach no cell are left out of the matrices: `reached`, where D
    is used more than once. The product is summed `SUMMED` cells at a time: single precision drifts.
    `further` is added to G. Tiles of bins have products of their own.
    """
    count, rows = matrix.replicates, matrix.replicates * matrix.rows
    if 0 in d.shape:
        return dr.zeros(mi.TensorXf, (rows, d.shape[1]))
    cells, bins = d.shape[0] // count, d.shape[1]
    lit, shining, tiles = LitCells.by(d, count) if reached is None else reached
    n_lit, n_shining = dr.width(lit), dr.width(shining)
    out = dr.zeros(mi.Float, rows * bins)
    if not n_lit * n_shining:
        return mi.TensorXf(out, (rows, bins))
    if tiles and rows * n_lit <= TOGETHER and max(dr.width(tile.lit) for tile in tiles) <= SUMMED:
        return _by_tiles(matrix, d, lit, tiles, further)
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


def _by_tiles(
    matrix: Matrix, d: mi.TensorXf, lit: mi.UInt32, tiles: Sequence[Tile], further: Further | None
) -> mi.TensorXf:
    """`product` of few lit cells, by tiles of bins."""
    count, rows, n_lit = matrix.replicates, matrix.replicates * matrix.rows, dr.width(lit)
    cells, bins = d.shape[0] // count, d.shape[1]
    place, out = dr.full(mi.UInt32, 0x7FFFFFFF, cells), dr.zeros(mi.Float, rows * bins)
    dr.scatter(place, dr.arange(mi.UInt32, n_lit), lit)
    every = Columns(place, 0, n_lit, 1)
    G = matrix.columns(every) if further is None else matrix.columns(every) + further(every)
    dr.eval(G)
    width, stride, height = (dr.opaque(mi.UInt32, n) for n in (n_lit, bins, cells))
    for tile in tiles:
        inner, columns = dr.width(tile.lit), dr.width(tile.bins)
        row, column = row_and_column(dr.arange(mi.UInt32, rows * inner), inner)
        of_lit = dr.gather(mi.Float, G.array, row * width + dr.gather(mi.UInt32, tile.lit, column))
        line, column = row_and_column(dr.arange(mi.UInt32, count * inner * columns), columns)
        replicate, at = row_and_column(line, inner)
        cell = dr.gather(mi.UInt32, lit, dr.gather(mi.UInt32, tile.lit, at)) + replicate * height
        D = dr.gather(mi.Float, d.array, cell * stride + dr.gather(mi.UInt32, tile.bins, column))
        part = by_replicate(
            mi.TensorXf(of_lit, (rows, inner)), mi.TensorXf(D, (count * inner, columns)), count
        )
        row, column = row_and_column(dr.arange(mi.UInt32, rows * columns), columns)
        dr.scatter(out, part.array, row * stride + dr.gather(mi.UInt32, tile.bins, column))
        dr.eval(out)
    return mi.TensorXf(out, (rows, bins))


def _piece(line: mi.UInt32, size: int, replicates: int) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32]:
    """Piece, replicate and column of lines piece · replicate · column."""
    batch, column = row_and_column(line, size)
    piece, replicate = row_and_column(batch, replicates)
    return piece, replicate, column
