"""Suns on a mesh of triangles over the sky, finer where it must be.

The upper half of an octahedron, |x| + |y| + z = 1, is the square |u| + |v| ≤ 1 seen from above:
(u, v) = (x, y) / (|x| + |y| + z). Halving its edges ℓ times gives the mesh of level ℓ; every
triangle has four children, and a value between its corners follows from the barycentric
coordinates in (u, v). A node's label tells its place, so a blend follows from the labels of the
nodes alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drcmitsuba.sky.sun import direction_of_hour
from drcmitsuba.sky.sun_models.blend import Blend

FINEST = 7
"""Level that nodes are numbered by; its edges are 0.7° long."""
COARSEST = 3
"""Level of the first triangles; their edges are 11° long."""
_STEPS = 1 << FINEST
PREFIX = "sun_mesh_"
OBLIQUITY = 23.45
"""Obliquity of the ecliptic [deg]: the largest declination of the sun, north and south."""
MARGIN = 2.5
"""Declination [deg] by which the mesh is wider, so that no triangle at its border is missed."""


def label(node: np.ndarray) -> str:
    """Label of a node, shape (2,), such as `sun_mesh_+064_-032`."""
    return f"{PREFIX}{node[0]:+04d}_{node[1]:+04d}"


def node(name: str) -> tuple[int, int]:
    """Invert `label`."""
    u, v = name.removeprefix(PREFIX).split("_")
    return int(u), int(v)


def directions_of(nodes: np.ndarray) -> np.ndarray:
    """Unit vectors to nodes (node, 2)."""
    u, v = np.moveaxis(nodes / _STEPS, -1, 0)
    d = np.stack([u, v, 1 - abs(u) - abs(v)], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def triangles(directions: np.ndarray, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a level that directions (n, 3), not below the horizon, fall into.

    Each has the nodes of its corners (n, 3, 2), of int, and barycentric coordinates (n, 3).
    """
    uv = directions[:, :2] / abs(directions).sum(axis=1, keepdims=True)
    signs = np.where(uv < 0, -1, 1)
    at = abs(uv) * (1 << level)
    low = np.minimum(np.floor(at).astype(int), (1 << level) - 1)
    rest = at - low
    # The half of its square away from the zenith; below the horizon there is none.
    beyond = (rest.sum(axis=1) > 1) & (low.sum(axis=1) < (1 << level) - 1)
    a, b = rest.T
    # The square's corners (0,0) or (1,1), then (1,0) and (0,1).
    offsets = np.array([[[0, 0], [1, 0], [0, 1]], [[1, 1], [1, 0], [0, 1]]])[beyond.astype(int)]
    weights = np.where(
        beyond[:, None],
        np.stack([a + b - 1, 1 - b, 1 - a], axis=1),
        np.stack([1 - a - b, a, b], axis=1),
    )
    corners = (low[:, None] + offsets) * signs[:, None] << (FINEST - level)
    return corners, weights


def triangles_of(directions: np.ndarray, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (triangle, 3, 2) of a level that hold directions, and each direction's triangle."""
    corners = triangles(directions, level)[0].reshape(-1, 6)
    each, of_direction = np.unique(corners, axis=0, return_inverse=True)
    return each.reshape(-1, 3, 2), of_direction.ravel()


def nodes_of(directions: np.ndarray, level: int) -> np.ndarray:
    """Nodes (node, 2) of the triangles about directions, and those half way between them."""
    corners = triangles_of(directions, level)[0]
    both = np.concatenate([corners, midpoints(corners)])
    return np.unique(both.reshape(-1, 2), axis=0)


def midpoints(corners: np.ndarray) -> np.ndarray:
    """Nodes half way along the edges of triangles (n, 3, 2), opposite to the corners."""
    return (corners[:, [1, 2, 0]] + corners[:, [2, 0, 1]]) // 2


def possible_suns(latitude: float) -> np.ndarray:
    """Directions (sun, 3) of all suns of a year at a latitude [deg], at most 1° apart."""
    furthest = OBLIQUITY + MARGIN
    declination = np.linspace(-furthest, furthest, 70)[:, None]
    d = direction_of_hour(latitude, declination, np.arange(-180.0, 180.0, 0.75)).reshape(-1, 3)
    return d[d[:, 2] >= 0]


def blend(directions: np.ndarray, up: np.ndarray, labels: Sequence[str]) -> Blend:
    """Blend each sun from the corners of the finest triangle about it whose corners are known.

    `labels` are those of the known bins; other kinds of bins play no part. A sun has three bins; ""
    where not even the coarsest triangle is known.
    """
    size = 2 * _STEPS + 1
    known = np.zeros((size, size), bool)
    names = np.full((size, size), "", dtype=object)
    for name in labels:
        if name.startswith(PREFIX):
            u, v = node(name)
            known[u + _STEPS, v + _STEPS], names[u + _STEPS, v + _STEPS] = True, name
    bins = np.full((len(up), 3), "", dtype=object)
    weights = np.zeros((len(up), 3))
    for level in range(COARSEST, FINEST + 1):
        corners, shares = triangles(directions, level)
        at = tuple(np.moveaxis(corners + _STEPS, -1, 0))
        is_known = up & known[at].all(axis=1)
        bins[is_known], weights[is_known] = names[at][is_known], shares[is_known]
    return Blend(bins, weights)
