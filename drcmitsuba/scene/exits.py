"""Exits of a model: rectangles that straight light passes on its way out of closed rooms.

Whatever lets straight light through counts: glass, views straight through films, holes; between two
rooms as well, since straight light may pass several panes. What light passes last on its way to a
point is an exit of the room in which the point lies.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.scene.geometry import normals, reversed_quads
from drcmitsuba.scene.panes_of_model import rectangle_around

MOST = 48
"""Largest number of planes with exits: with more, a look at all of them takes as long as a ray."""
SAME_NORMAL, SAME_PLANE = 1e-5, 1e-5
"""Difference of normals [–], and distance [m], below which quads may lie in one plane."""
MARGIN = 0.005
"""Width by which rectangles reach beyond the quads [m]: several planes may count as one."""


def exits_of(quads: np.ndarray) -> np.ndarray | None:
    """Rectangles around the quads of each plane, one for each side of it.

    Parameters
    ----------
    quads : np.ndarray, shape (quad, 4, 3)
        Quads that straight light passes [m].

    Returns
    -------
    np.ndarray, shape (exit, 4, 3)
        Rectangles [m]; None where they lie in more than `MOST` planes.
    """
    n = normals(quads)
    largest = np.take_along_axis(n, np.abs(n).argmax(axis=1)[:, None], axis=1)
    rectangles = _by_plane(quads, n * np.sign(largest))
    if len(rectangles) > MOST:
        return None
    return np.concatenate([rectangles, reversed_quads(rectangles)])


def exits_on_sides(quads: np.ndarray) -> np.ndarray:
    """Rectangles (exit, 4, 3) around quads (quad, 4, 3) [m] of each plane that face one way."""
    return _by_plane(quads, normals(quads))


def _by_plane(quads: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Rectangles around the quads of each plane, whose fronts have the direction of `n`."""
    offset = np.einsum("qi,qi->q", n, quads[:, 0])
    key = np.column_stack([n / SAME_NORMAL, offset / SAME_PLANE]).round()
    planes, plane = np.unique(key, axis=0, return_inverse=True)
    members = (np.flatnonzero(plane.ravel() == i) for i in range(len(planes)))
    fronts = [_grown(rectangle_around(quads[m].reshape(-1, 3), n[m[0]])) for m in members]
    return np.reshape(fronts, (-1, 4, 3))


def _grown(rectangle: np.ndarray) -> np.ndarray:
    """Rectangle (4, 3) that is larger by `MARGIN` on every side."""
    u, v = rectangle[1] - rectangle[0], rectangle[3] - rectangle[0]
    u, v = (MARGIN * edge / np.linalg.norm(edge) for edge in (u, v))
    return np.asarray(rectangle + np.array([-u - v, u - v, u + v, v - u]))
