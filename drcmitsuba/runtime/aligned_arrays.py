"""NumPy arrays that begin where the device can take them without a copy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

ALIGNMENT = 64
"""Bytes to a multiple of which arrays begin: kernels are compiled for the alignment of an array."""


def is_aligned(a: np.ndarray) -> bool:
    """Whether an array lies row by row from a multiple of `ALIGNMENT`, and may be written to."""
    return bool(a.ctypes.data % ALIGNMENT == 0 and a.flags.c_contiguous and a.flags.writeable)


def aligned(a: np.ndarray) -> np.ndarray:
    """Array in single precision that is aligned: a copy, unless it is so already."""
    return a if a.dtype == np.float32 and is_aligned(a) else aligned_copy(a, np.float32)


def aligned_copy(a: ArrayLike, dtype: type[np.generic]) -> np.ndarray:
    """Copy an array to one of a type that is aligned."""
    values = np.asarray(a)
    out = aligned_empty(values.shape, dtype)
    out[...] = values
    return out


def aligned_empty(shape: Sequence[int], dtype: DTypeLike) -> np.ndarray:
    """Array of numbers without values that is aligned."""
    return _aligned(np.empty, shape, dtype)


def aligned_zeros(shape: Sequence[int], dtype: DTypeLike) -> np.ndarray:
    """Array of zeros that is aligned; it takes memory where it is written to."""
    return _aligned(np.zeros, shape, dtype)


def _aligned(
    made: Callable[[int, type[np.uint8]], np.ndarray], shape: Sequence[int], dtype: DTypeLike
) -> np.ndarray:
    """Array in memory that `made` gives, a few bytes more than it needs."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = made(size + ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    return memory[start : start + size].view(dtype).reshape(shape)


def aligned_rows(shape: Sequence[int]) -> np.ndarray:
    """Zeros in single precision, each row of which, along the first dim, is aligned."""
    rows, size = shape[0], math.prod(shape[1:])
    width = -(-size // (ALIGNMENT // 4)) * (ALIGNMENT // 4)
    return aligned_zeros((rows, width), np.float32)[:, :size].reshape(shape)
