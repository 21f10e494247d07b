"""Many polygons at once as parallelograms and triangles.

`drcmitsuba.model.polygon.quads_of` cuts one polygon of any shape. Most polygons of a scene are seen
whole from one of their corners: they are cut together, as fans about that corner.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drcmitsuba.model.polygon import FLAT, SAME, NoAreaError, quads_of

BLOCK = 20_000
"""Number of polygons that are cut together; bounds the memory that this takes."""
MOST_CORNERS = 12
"""Polygons with more corners are cut one by one."""
LARGEST = 1e12
"""Largest magnitude of a coordinate [m]."""


def cut(
    corners: np.ndarray,
    counts: np.ndarray,
    refuse: Callable[[int, str], Exception],
    leave_out: Callable[[int], None],
) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons into parallelograms and triangles.

    Parameters
    ----------
    corners : np.ndarray, shape (corner, 3)
        Corners of all polygons in turn [m].
    counts : np.ndarray of int, shape (polygon,)
        Number of corners of each polygon.
    refuse : callable
        Exception that is raised, from the index of a polygon and what is wrong with it.
    leave_out : callable
        Takes in the index of a polygon without area, which is left out.

    Returns
    -------
    quads : np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner [m].
    polygon : np.ndarray of int, shape (quad,)
        Index of the polygon that each is part of, rising.
    """
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    far = ~(np.abs(corners) <= LARGEST).all(axis=1)
    if far.any():
        which = int(np.searchsorted(starts, int(np.argmax(far)), side="right")) - 1
        raise refuse(which, "a coordinate is not finite, or too large")
    parts: list[np.ndarray] = []
    index: list[np.ndarray] = []
    for count in np.unique(counts):
        same = np.flatnonzero(counts == count)
        for block in np.split(same, range(BLOCK, len(same), BLOCK)):
            rings = corners[starts[block, None] + np.arange(count)]
            left = np.arange(len(block))
            if 3 <= count <= MOST_CORNERS:
                left = _fans(rings, block, parts, index)
            for i in left:
                try:
                    quads = quads_of(rings[i])
                except NoAreaError:
                    leave_out(int(block[i]))
                    continue
                except ValueError as error:
                    raise refuse(int(block[i]), str(error)) from None
                parts.append(quads)
                index.append(np.full(len(quads), block[i]))
    quads = np.concatenate([np.zeros((0, 4, 3)), *parts])
    polygon = np.concatenate([np.zeros(0, np.int64), *index])
    order = np.argsort(polygon, kind="stable")
    return quads[order], polygon[order]


def _fans(
    rings: np.ndarray, names: np.ndarray, parts: list[np.ndarray], index: list[np.ndarray]
) -> np.ndarray:
    """Cut what can be cut as a fan, and return the positions of the polygons that are left.

    The polygons (polygon, corner, 3) have the indices `names`.
    """
    n = rings.shape[1]
    moved = rings - rings[:, :1]
    normal = np.cross(moved, np.roll(moved, -1, axis=1)).sum(axis=1) / 2
    size = np.linalg.norm(normal, axis=1)
    extent = np.ptp(rings, axis=1).max(axis=1)
    normal /= np.where(size > 0, size, 1)[:, None]
    step = np.abs(rings - np.roll(rings, 1, axis=1)).max(axis=2)
    off = np.abs(np.einsum("pcx,px->pc", moved, normal)).max(axis=1)
    sound = (size > SAME * extent**2) & (off <= FLAT * extent)
    sound &= (step > SAME * extent[:, None]).all(axis=1)
    left = np.flatnonzero(sound)
    if n == 4:
        gap = np.abs(rings[:, 0] - rings[:, 1] + rings[:, 2] - rings[:, 3]).max(axis=1)
        whole = sound & (gap <= 1e-6 * extent)
        parts.append(rings[whole])
        index.append(names[whole])
        left = np.flatnonzero(sound & ~whole)
    for start in range(1 if n == 3 else n):
        if not len(left):
            break
        ring = np.roll(rings[left], -start, axis=1)
        spokes = ring[:, 1:] - ring[:, :1]
        across = np.einsum("pcx,px->pc", np.cross(spokes[:, :-1], spokes[:, 1:]), normal[left])
        along = np.einsum("pcx,pcx->pc", spokes[:, :-1], spokes[:, 1:])
        turn = np.arctan2(across, along).sum(axis=1)
        least = SAME * extent[left] ** 2
        seen = (across > least[:, None]).all(axis=1) & (turn < 2 * np.pi - 1e-6)
        at = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), *2 * [np.arange(2, n)]], axis=1)
        parts.append(ring[seen][:, at].reshape(-1, 4, 3))
        index.append(np.repeat(names[left[seen]], n - 2))
        left = left[~seen]
    return np.concatenate([left, np.flatnonzero(~sound)])
