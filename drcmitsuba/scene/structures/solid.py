"""Whether a mesh is the surface of a solid, and which points lie in it."""

from __future__ import annotations

import numpy as np

from drcmitsuba.runtime.errors import InputError

SAME = 1e-6
"""Corners closer than this fraction of the extent count as one."""


def welded(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Join corners (vertex, 3) that lie at one place, and drop faces that shrink to an edge."""
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-30)
    whole = np.round((vertices - vertices.min(axis=0)) / (size * SAME)).astype(np.int64)
    span = round(1 / SAME) + 1
    key = (whole[:, 0] * span + whole[:, 1]) * span + whole[:, 2]  # one number sorts faster
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    faces = number.reshape(-1)[faces]
    shrunk = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return vertices[first], faces[~shrunk]


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume of a closed mesh [unit³ of the vertices]; negative if normals point inward."""
    a, b, c = (vertices[faces[:, i]] - vertices[0] for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def is_closed(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether neighbouring faces share every edge, and agree on which side is out."""
    vertices, faces = welded(vertices, faces)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    count = len(vertices)
    there, back = np.sort(start * count + end), np.sort(end * count + start)
    return len(faces) > 0 and np.array_equal(there, back)


def check_solid(source: object, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse a mesh that is not closed, or whose normals do not point outward.

    Raises
    ------
    InputError
    """
    if is_closed(vertices, faces):
        if volume(vertices, faces) > 0:
            return
        raise InputError(source, "mesh", "the normals point inward", "turn the faces over")
    vertices, faces = welded(vertices, faces)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    count = len(vertices)
    low, high = np.minimum(start, end), np.maximum(start, end)
    paired = np.unique(low * count + high, return_counts=True)[1] % 2 == 0
    if len(faces) and paired.all():
        got = "neighbouring faces disagree on which side is out"
        raise InputError(source, "mesh", got, "turn some of the faces over")
    got = f"the surface of a clear solid is not closed: {int((~paired).sum())} open edges"
    raise InputError(source, "mesh", got, "close it, or give it a mirror's material")


def winding(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Winding number of a mesh at points (point, 3), shape (point,): 1 in a solid, 0 outside.

    It is the signed solid angle of the triangles over 4π [1]_.

    References
    ----------
    .. [1] A. Van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Transactions
       on Biomedical Engineering 30, 1983.
    """
    total = np.zeros(len(points))
    for i, p in enumerate(points):
        a, b, c = (vertices[faces[:, k]] - p for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        over = np.einsum("fi,fi->f", a, np.cross(b, c))
        under = la * lb * lc + lc * _dot(a, b) + la * _dot(b, c) + lb * _dot(c, a)
        total[i] = np.arctan2(over, under).sum() / (2 * np.pi)
    return total


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("fi,fi->f", a, b)
