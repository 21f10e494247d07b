"""Many polygons at once as parallelograms and triangles.

`drcmitsuba.model.polygon.quads_of` cuts one polygon of any shape. Most polygons of a scene are seen
whole from one of their corners: they are cut together, as fans about that corner.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drcmitsuba.model.facets import fans
from drcmitsuba.model.polygon import NoAreaError, quads_of

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
                quads, polygon, left = fans(rings, starts=count)
                parts.append(quads)
                index.append(block[polygon])
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
