"""NumPy arrays as flat arrays on the device, row by row."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike


def flat(a: ArrayLike) -> mi.Float:
    """Numbers in single precision."""
    return mi.Float(np.ascontiguousarray(a, np.float32).ravel())


def flat_indices(a: ArrayLike) -> mi.UInt32:
    """Whole numbers from 0."""
    return mi.UInt32(np.ascontiguousarray(a, np.uint32).ravel())
