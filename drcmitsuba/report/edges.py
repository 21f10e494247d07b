"""Edges of surfaces in pictures: those that no neighbour shares."""

from __future__ import annotations

import numpy as np


def outlines(quads: np.ndarray) -> np.ndarray:
    """Edges (edge, 2, 3) [m] of quads that no other quad of the same plane shares."""
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    facing = _digest(np.round(np.abs(n) * 1e3))
    # The sum is that of both ends, whichever comes first.
    corner = _digest(np.round(ends * 1e4))
    keys = _digest(np.column_stack([corner.sum(axis=1), np.repeat(facing, 4)]))
    _, first, times = np.unique(keys, return_index=True, return_counts=True)
    once = np.sort(first[times == 1])
    return ends[once][np.linalg.norm(ends[once][:, 1] - ends[once][:, 0], axis=1) > 1e-6]


def _digest(rows: np.ndarray) -> np.ndarray:
    """64-bit numbers of rows (…, column) of whole numbers, equal for equal rows."""
    out = np.zeros(rows.shape[:-1], np.uint64)
    for column in np.moveaxis(rows, -1, 0):
        word = column.astype(np.int64 if column.dtype.kind == "f" else np.uint64).view(np.uint64)
        out = (out ^ word) * np.uint64(0x9E3779B97F4A7C15)
        out ^= out >> np.uint64(29)
    return out
