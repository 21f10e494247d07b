"""Glare sources of a picture: bright pixels, merged where they lie near each other.

A chain of bright pixels joins two to one source where each is within half of the opening angle of
the next. Peaks within a source become sources of their own, merged by the same rule. So does
`evalglare` 3.06 (options -b, -r, -Y), as its manual page and its results show [1]_.

References
----------
.. [1] J. Wienold, J. Christoffersen, "Evaluation methods and development of a new glare prediction
   model for daylight environments with the use of CCD cameras", Energy and Buildings 38(7), 2006.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drcmitsuba.picture.position_index import position_index
from drcmitsuba.picture.view import PictureView
from drcmitsuba.runtime import lazy

if TYPE_CHECKING:
    from scipy import spatial
    from scipy.sparse import coo_array, csgraph
else:
    spatial = lazy.module("scipy.spatial")
    csgraph = lazy.module("scipy.sparse.csgraph")

FARTHEST = 1.0
"""Largest opening angle within which pixels are merged [rad]."""


@dataclass(frozen=True, eq=False)
class GlareSources:
    """Glare sources of a picture, the largest first."""

    luminance: np.ndarray
    """Mean luminance by solid angle [cd/m²], shape (source,)."""
    solid_angle: np.ndarray
    """[sr], shape (source,)."""
    direction: np.ndarray
    """Unit vectors to the mean place of the light in the picture, shape (source, 3)."""
    position_index: np.ndarray
    """Position index of the direction, from 1 in the line of sight to 16 [–], shape (source,)."""
    illuminance: np.ndarray
    """Illuminance at the eye [lx], shape (source,)."""
    label: np.ndarray
    """Number of each pixel's source from 0, −1 elsewhere, int, shape (row, column)."""

    def __len__(self) -> int:
        return len(self.luminance)


def find(
    luminance: np.ndarray,
    directions: np.ndarray,
    solid_angles: np.ndarray,
    view: PictureView,
    threshold: float,
    opening: float,
    peak: float,
) -> GlareSources:
    """Find the glare sources of a picture.

    Parameters
    ----------
    luminance : np.ndarray, shape (row, column)
        Luminance of the pixels [cd/m²].
    directions : np.ndarray, shape (row, column, 3)
        Unit vectors of the pixels, NaN outside the projection.
    solid_angles : np.ndarray, shape (row, column)
        Solid angles of the pixels in view [sr]; 0 outside.
    view : PictureView
        View of the picture.
    threshold : float
        Luminance above which a pixel is bright [cd/m²].
    opening : float
        Opening angle: pixels within half of it are merged [rad].
    peak : float
        Luminance above which pixels are a source of their own [cd/m²]; infinite for none.
    """
    bright = (luminance > threshold) & (solid_angles > 0)
    back = -view.frame[2]
    source = _merged(directions, bright, opening, back)[bright]
    peaks = luminance[bright] > peak
    of_peaks = _merged(directions, bright & (luminance > peak), opening, back)[bright]
    number = np.where(peaks, of_peaks + len(source), source)
    omega = solid_angles[bright]
    _, number = np.unique(number, return_inverse=True)
    order = np.argsort(-np.bincount(number, omega), kind="stable")
    rank = np.argsort(order, kind="stable")
    label = np.full(bright.shape, -1)
    label[bright] = rank[number]
    return _sources(luminance, directions, solid_angles, view, label)


def _sources(
    luminance: np.ndarray,
    directions: np.ndarray,
    solid_angles: np.ndarray,
    view: PictureView,
    label: np.ndarray,
) -> GlareSources:
    """Sums and means of the labelled pixels."""
    lit = label >= 0
    rows, columns = np.nonzero(lit)
    number, omega = label[lit], solid_angles[lit]
    total = np.bincount(number, omega)
    flux = luminance[lit] * omega
    light = np.bincount(number, flux)
    x, y = (
        np.bincount(number, flux * place) / light
        for place in ((columns + 0.5) / label.shape[1], 1 - (rows + 0.5) / label.shape[0])
    )
    direction = view.directions(x, y)
    return GlareSources(
        luminance=light / total,
        solid_angle=total,
        direction=direction,
        position_index=position_index(direction @ view.frame.T),
        illuminance=np.bincount(number, flux * (directions[lit] @ view.frame[2])),
        label=label,
    )


def _merged(
    directions: np.ndarray, bright: np.ndarray, opening: float, back: np.ndarray
) -> np.ndarray:
    """Number of the component of each bright pixel, shape (row, column).

    Neighbours in the picture are joined first. What joins components across a gap are links between
    pixels at their edges, and the shortest of these are edges of the Delaunay triangulation of the
    sphere, which is the convex hull of the directions.
    """
    index = np.full(bright.shape, -1)
    count = int(bright.sum())
    index[bright] = np.arange(count)
    points = directions[bright]
    longest = 2 * np.sin(opening / 4)  # the chord of half the opening angle
    links, is_inner = [], np.ones(count, bool)
    for ahead, behind in (
        (index[:, 1:], index[:, :-1]), (index[1:], index[:-1]),
        (index[1:, 1:], index[:-1, :-1]), (index[1:, :-1], index[:-1, 1:]),
    ):  # fmt: skip
        both = (ahead >= 0) & (behind >= 0)
        pair = np.stack([ahead[both], behind[both]], axis=1)
        near = _length(points, pair) <= longest
        links.append(pair[near])
        degree = np.bincount(links[-1].ravel(), minlength=count)
        is_inner &= degree == 2
    edge = np.flatnonzero(~is_inner)
    across = edge[_delaunay(points[edge], back)]
    links.append(across[_length(points, across) <= longest])
    first, second = np.concatenate(links).T
    graph = _graph(first, second, count)
    _, component = csgraph.connected_components(graph, directed=False)
    merged = np.full(bright.shape, -1)
    merged[bright] = component
    return merged


def _graph(first: np.ndarray, second: np.ndarray, count: int) -> coo_array:
    from scipy.sparse import coo_array

    return coo_array((np.ones(len(first), np.int8), (first, second)), shape=(count, count))


def _length(points: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Chord between pairs of unit vectors [–], shape (pair,)."""
    return np.linalg.norm(points[pair[:, 0]] - points[pair[:, 1]], axis=1)


def _delaunay(points: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Edges (edge, 2) of the Delaunay triangulation of unit vectors in front of the eye.

    Four directions around the one behind the eye make the hull a body, whichever points there are.
    They are too far from the points to break a link of two that are near each other.
    """
    if len(points) < 2:
        return np.empty((0, 2), int)
    aside = np.cross(back, np.eye(3)[np.argmin(np.abs(back))])
    aside /= np.linalg.norm(aside)
    turned = np.cross(back, aside)
    ring = [0.8 * back + 0.6 * (np.cos(a) * aside + np.sin(a) * turned) for a in (0, 2.1, 4.2)]
    hull = spatial.ConvexHull(np.concatenate([points, [back], ring]))
    sides = np.concatenate([hull.simplices[:, pair] for pair in ([0, 1], [1, 2], [0, 2])])
    return sides[(sides < len(points)).all(axis=1)]
