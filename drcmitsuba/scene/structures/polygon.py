"""Triangles of a plane polygon, for the ends of extruded solids."""

from __future__ import annotations

import numpy as np


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products of vectors (…, 2) in a plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def triangles(points: np.ndarray) -> np.ndarray:
    """Cut a simple polygon (corner, 2), counter-clockwise, into triangles by clipping its ears.

    The result, shape (corner − 2, 3), holds indices of corners, counter-clockwise.
    """
    left = list(range(len(points)))
    ears: list[tuple[int, int, int]] = []
    at = 0
    while len(left) > 3:
        for step in range(len(left)):
            i = (at + step) % len(left)
            ear = left[i - 1], left[i], left[(i + 1) % len(left)]
            if _is_ear(points, ear, left):
                break
        else:  # only rounding can leave no ear: the rest is a sliver
            i = at % len(left)
            ear = left[i - 1], left[i], left[(i + 1) % len(left)]
        ears.append(ear)
        left.pop(i)
        at = i  # the next ear is sought further on, which avoids slivers
    return np.array([*ears, tuple(left)])


def _is_ear(points: np.ndarray, ear: tuple[int, int, int], left: list[int]) -> bool:
    """Whether the triangle of three neighbours is convex and holds no other corner."""
    a, b, c = points[list(ear)]
    if cross(b - a, c - b) <= 0:
        return False
    others = points[[k for k in left if k not in ear]]
    sides = [cross(q - p, others - p) for p, q in ((a, b), (b, c), (c, a))]
    return not (np.min(sides, axis=0) >= 0).any()
