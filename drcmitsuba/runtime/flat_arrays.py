"""NumPy arrays as flat arrays on the device, row by row, and rows of unequal length."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike

from drcmitsuba.runtime.aligned_arrays import aligned, aligned_copy


def flat(a: ArrayLike | mi.Float) -> mi.Float:
    """Numbers in single precision; those on the device stay as they are."""
    return a if isinstance(a, mi.Float) else mi.Float(aligned_copy(a, np.float32).ravel())


def flat_indices(a: ArrayLike | mi.UInt32) -> mi.UInt32:
    """Whole numbers from 0; those on the device stay as they are."""
    return a if isinstance(a, mi.UInt32) else mi.UInt32(aligned_copy(a, np.uint32).ravel())


def shared(a: np.ndarray) -> mi.Float:
    """Numbers in single precision, without a copy of an array that came from the device.

    Such an array must not change while its numbers are in use.
    """
    return mi.Float(aligned(a).ravel())


def add_at(out: Any, values: Any, entry: mi.UInt32, active: mi.Bool | bool = True) -> None:
    """Add values to entries of an array, in a kernel that does nothing else.

    Every thread has a copy of a small array, which is several times as fast as atomic sums. The
    size of the array becomes part of the kernel; no other kernel shall be compiled anew for it.
    """
    entry, active = mi.UInt32(entry), mi.Bool(active)
    dr.eval(values, entry, active)
    dr.scatter_add(out, values, entry, active)


def marked(count: int, entry: mi.UInt32, active: mi.Bool | bool = True) -> mi.UInt32:
    """Indices, of `count`, that any active thread has for its `entry`, in rising order.

    A maximum leaves an entry alone that is marked: threads that all write to the same few entries
    would take their lines of memory from each other.
    """
    marks, one, active = dr.zeros(mi.UInt32, count), mi.UInt32(1), mi.Bool(active)
    dr.scatter_reduce(dr.ReduceOp.Max, marks, one, entry, active, mode=dr.ReduceMode.Direct)
    return dr.compress(marks == 1)


def row_and_column(entry: mi.UInt32, columns: int) -> tuple[mi.UInt32, mi.UInt32]:
    """Row and column of entries of a flat array (row, column).

    A kernel must not know the number of columns, or it would be compiled anew for every size, and
    processors take long to divide by an unknown number. A product with its reciprocal in double
    precision gives the same whole numbers.
    """
    if dr.width(entry) == 0:
        return entry, entry
    row = mi.UInt32((mi.Float64(entry) + 0.5) * dr.opaque(mi.Float64, 1 / columns))
    return row, entry - row * dr.opaque(mi.UInt32, columns)


def repeated(values: Any, times: int) -> Any:
    """Array several times over; `dr.tile` would have kernels compiled anew for every length."""
    if times == 1 or dr.width(values) == 0:
        return values
    _, at = row_and_column(dr.arange(mi.UInt32, times * dr.width(values)), dr.width(values))
    out = dr.gather(type(values), values, at)
    dr.eval(out)
    return out


def vectors_of(rows: ArrayLike) -> tuple[mi.Vector3f, ...]:
    """Vectors (row, 3), one value each, which kernels read: literals would have them compiled."""
    numbers, count = flat(rows), len(np.asarray(rows))
    every = tuple(dr.gather(mi.Vector3f, numbers, mi.UInt32(k)) for k in range(count))
    dr.eval(every)
    return every


def first_of_rows(row: mi.UInt32, count: int) -> mi.UInt32:
    """First entry of each of `count` rows in a list sorted by row, and last its length."""
    entries = dr.zeros(mi.UInt32, count + 1)
    dr.scatter_add(entries, mi.UInt32(1), row + 1)
    return dr.cumsum(entries)
