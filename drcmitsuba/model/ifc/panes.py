"""Solid panes of glass as sheets: one for each plane of an element's glass."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress

import numpy as np
import shapely

from drcmitsuba.model.ifc.shapes import area_vectors
from drcmitsuba.model.plane import Plane, Rings
from drcmitsuba.model.polygon import NoAreaError, quads_of
from drcmitsuba.runtime import lazy

sparse, csgraph = lazy.module("scipy.sparse"), lazy.module("scipy.sparse.csgraph")

PARALLEL = 0.9
"""Cosine of the angle between faces of one pane, at least [–]."""
LEAST_SHARE = 0.1
"""Area of a further pane of an element, over that of the largest one, at least [–]."""
LEAST = 1e-3
"""Area of the smallest pane [m²]."""
APART = 0.25
"""Distance between parallel faces from which on they are of two panes [m]."""
WELD = 1e-4
"""Distance within which corners are one [m]."""
SEAM = 2e-3
"""Width of seams within a pane that are closed [m]."""


def sheets_of(triangles: np.ndarray) -> np.ndarray:
    """Sheets in the middle of the panes that triangles enclose.

    Panes close behind one another, as of an insulating glass unit, are one sheet.

    Parameters
    ----------
    triangles : np.ndarray, shape (triangle, 3, 3)
        Faces of the glass of one element [m].

    Returns
    -------
    np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner [m].
    """
    out = [np.empty((0, 4, 3))]
    normal = area_vectors(triangles)
    area, body = np.linalg.norm(normal, axis=1), _bodies(triangles)
    triangles, normal, area, body = (a[area > 0] for a in (triangles, normal, area, body))
    first = 0.0
    while len(area):
        axis = normal[np.argmax(area)] / area.max()
        mine = np.abs(normal @ axis) > PARALLEL * area
        size = float(area[mine].sum())
        if size < LEAST_SHARE * first:
            break
        faces = triangles[mine]
        place = _places(faces @ axis)
        solid = _solids(faces, place, body[mine])
        # Along a further axis, slabs are seen by their edges.
        kept = np.flatnonzero((first == 0) | _are_slabs(faces @ axis, area[mine], solid))
        pane = _joined(place[kept], solid[kept])[place[kept]]
        for number in np.unique(pane):
            each = kept[pane == number]
            out += _sheet(faces[each], area[mine][each])
        first = first or size
        triangles, normal, area, body = (a[~mine] for a in (triangles, normal, area, body))
    return np.concatenate(out)


def _bodies(triangles: np.ndarray) -> np.ndarray:
    """Number (triangle,) of the body that triangles with common corners make up."""
    _, corner = np.unique(np.round(triangles.reshape(-1, 3) / WELD), axis=0, return_inverse=True)
    return _joined(np.repeat(np.arange(len(triangles)), 3), corner.ravel())


def _joined(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Number of the group of each first thing, of which some share a second one; pairs (pair,)."""
    count = int(first.max(initial=-1)) + 1
    size = count + int(second.max(initial=-1)) + 1
    pairs = sparse.coo_matrix((np.ones(len(first)), (first, count + second)), (size, size))
    return np.asarray(csgraph.connected_components(pairs, directed=False)[1][:count])


def _places(reach: np.ndarray) -> np.ndarray:
    """Number (triangle,) of triangles close behind one another, by their corners' reach [m]."""
    low, high = reach.min(axis=1), reach.max(axis=1)
    order = low.argsort()
    so_far = np.maximum.accumulate(high[order])
    place = np.empty(len(order), int)
    place[order] = np.cumsum(np.r_[0, low[order][1:] > so_far[:-1] + APART])
    return place


def _are_slabs(reach: np.ndarray, area: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Whether triangles are of solid parts that are wider than thick, bool (triangle,)."""
    size = np.bincount(solid, area) / 2
    low, high = np.full(len(size), np.inf), np.full(len(size), -np.inf)
    np.minimum.at(low, solid, reach.min(axis=1))
    np.maximum.at(high, solid, reach.max(axis=1))
    return np.asarray((high - low <= np.sqrt(size))[solid])


def _solids(triangles: np.ndarray, place: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Number (triangle,) of the part of a body between whose faces there is no empty space.

    Faces of a body are of one part, however thick it is; opposite sides of a ring are of two. A
    line that has met an even number of a body's faces is outside of it. `place` is from `_places`.
    """
    plane = Plane.of(triangles[np.argmax(np.linalg.norm(area_vectors(triangles), axis=1))])
    solid = body * (place.max() + 1)
    for number in np.unique(body):
        mine = np.flatnonzero(body == number)
        before = np.unique(place[mine])[:-1]
        faces = [plane.polygon([triangles[k]]) for k in mine] if len(before) else []
        for last in before:
            lower = [face for face, at in zip(faces, place[mine], strict=True) if at <= last]
            nearest = [face for face, at in zip(faces, place[mine], strict=True) if at == last]
            middles = shapely.centroid(nearest)
            line, _ = shapely.STRtree(lower).query(middles, predicate="intersects")
            is_outside = np.bincount(line, minlength=len(middles)) % 2 == 0
            if np.average(is_outside, weights=shapely.area(nearest)) > 0.5:
                solid[mine[place[mine] > last]] += 1
    return np.unique(solid, return_inverse=True)[1]


def _sheet(triangles: np.ndarray, area: np.ndarray) -> list[np.ndarray]:
    """Quads of parallel triangles, in their mean plane."""
    plane = Plane.of(triangles[np.argmax(area)])
    offset = (triangles.mean(axis=1) - plane.corner) @ plane.normal
    middle = np.average(offset, weights=area)
    plane = Plane(plane.corner + middle * plane.normal, plane.u, plane.v, plane.normal)
    shapes = [plane.polygon([triangle]).buffer(SEAM, join_style="mitre") for triangle in triangles]
    whole = shapely.union_all(shapes).buffer(-SEAM, join_style="mitre").simplify(SEAM / 4)
    return list(_quads(plane.rings(whole, LEAST)))


def _quads(every: Iterable[Rings]) -> Iterator[np.ndarray]:
    """Quads of polygons, without those that are too thin to have an area."""
    for rings in every:
        with suppress(NoAreaError):
            yield quads_of(rings[0], rings[1:])
