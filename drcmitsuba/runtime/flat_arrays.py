"""NumPy arrays as flat arrays on the device, row by row, and rows of unequal length."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike


def flat(a: ArrayLike) -> mi.Float:
    """Numbers in single precision."""
    return mi.Float(np.ascontiguousarray(a, np.float32).ravel())


def flat_indices(a: ArrayLike) -> mi.UInt32:
    """Whole numbers from 0."""
    return mi.UInt32(np.ascontiguousarray(a, np.uint32).ravel())


def first_of_rows(row: mi.UInt32, count: int) -> mi.UInt32:
    """First entry of each of `count` rows in a list sorted by row, and last its length."""
    entries = dr.zeros(mi.UInt32, count + 1)
    dr.scatter_add(entries, mi.UInt32(1), row + 1)
    return dr.cumsum(entries)
