"""Products of rays between cells with light on the cells: T and its transpose as sparse matrices.

A row is a run of rays that stand together. Neighbouring lanes read neighbouring columns of the
dense array, four values at once, so that a product needs no matrix of cell by cell.
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat_indices, row_and_column

WIDE = 4
"""Number of columns that are read at once."""


class RayRows(NamedTuple):
    """Sparse matrix (row, inner) whose entries are the weights of rays."""

    start: mi.UInt32
    """First ray of every row, and at last the number of rays."""
    inner: mi.UInt32
    """Column of every ray."""
    weight: mi.Float

    @classmethod
    def sorted_by(cls, row: mi.UInt32, inner: mi.UInt32, weight: mi.Float, rows: int) -> RayRows:
        """Put rays of any order in the order of their rows; those of weight 0 are left out."""
        here = dr.compress(weight > 0) if dr.width(weight) else mi.UInt32()
        if not dr.width(here):
            return cls(dr.zeros(mi.UInt32, rows + 1), mi.UInt32(), mi.Float())
        of_ray = dr.gather(mi.UInt32, row, here).numpy()
        start = np.zeros(rows + 1, np.uint32)
        np.cumsum(np.bincount(of_ray, minlength=rows), out=start[1:])
        # A stable sort: neither threads nor launches show in the order of sums.
        order = dr.gather(mi.UInt32, here, flat_indices(np.argsort(of_ray, kind="stable")))
        columns = dr.gather(mi.UInt32, inner, order), dr.gather(mi.Float, weight, order)
        dr.eval(columns)
        return cls(mi.UInt32(start), *columns)

    def times(self, dense: mi.Float, width: int) -> mi.Float:
        """Product with an array (inner, width), shape (row, width), both flat.

        `width` is a multiple of `WIDE`.
        """
        rows = dr.width(self.start) - 1
        if not dr.width(self.weight):
            return dr.zeros(mi.Float, rows * width)
        lanes = rows * width // WIDE
        row, column = row_and_column(dr.arange(mi.UInt32, lanes), width // WIDE)
        ray = dr.gather(mi.UInt32, self.start, row)
        end = dr.gather(mi.UInt32, self.start, row + 1)
        out = _summed(ray, end, column, dr.opaque(mi.UInt32, width // WIDE), self, dense)
        dr.eval(out)
        return out


@symbolic
def _summed(
    ray: mi.UInt32, end: mi.UInt32, column: mi.UInt32, stride: mi.UInt32, rays: RayRows,
    dense: mi.Float,
) -> mi.Float:  # fmt: skip
    """Sum the rays of every lane's row."""
    total = mi.Vector4f(0)
    while dr.hint(ray < end, exclude=[end, column, stride, rays, dense]):
        at = dr.gather(mi.UInt32, rays.inner, ray) * stride + column
        weight = dr.gather(mi.Float, rays.weight, ray)
        total = dr.fma(dr.gather(mi.Vector4f, dense, at), weight, total)
        ray += 1
    return dr.ravel(total)


def widened(values: mi.Float, rows: int, columns: int) -> tuple[mi.Float, int]:
    """Rows filled up with 0 to a multiple of `WIDE` columns, and their width."""
    width = -(-columns // WIDE) * WIDE
    if width == columns:
        return values, width
    row, column = row_and_column(dr.arange(mi.UInt32, rows * width), width)
    stride = dr.opaque(mi.UInt32, columns)
    out = dr.gather(mi.Float, values, row * stride + column, column < stride)
    dr.eval(out)
    return out, width


def narrowed(values: mi.Float, rows: int, columns: int) -> mi.Float:
    """Rows without the columns that `widened` has added."""
    width = dr.width(values) // max(rows, 1)
    if width == columns:
        return values
    row, column = row_and_column(dr.arange(mi.UInt32, rows * columns), columns)
    return dr.gather(mi.Float, values, row * dr.opaque(mi.UInt32, width) + column)
