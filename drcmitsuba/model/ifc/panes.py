"""Solid panes of glass as sheets: one for each plane of an element's glass."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress

import numpy as np
import shapely

from drcmitsuba.model.plane import Plane, Rings
from drcmitsuba.model.polygon import NoAreaError, quads_of

PARALLEL = 0.9
"""Cosine of the angle between faces of one pane, at least [–]."""
LEAST_SHARE = 0.1
"""Area of a further pane of an element, over that of the largest one, at least [–]."""
LEAST = 1e-3
"""Area of the smallest pane [m²]."""
APART = 0.25
"""Distance between parallel faces from which on they are of two panes [m]."""
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
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2
    area = np.linalg.norm(normal, axis=1)
    triangles, normal, area = (a[area > 0] for a in (triangles, normal, area))
    first = 0.0
    while len(area):
        axis = normal[np.argmax(area)] / area.max()
        mine = np.abs(normal @ axis) > PARALLEL * area
        size = float(area[mine].sum())
        first = first or size
        if size < LEAST_SHARE * first:
            break
        for each in _apart(triangles[mine] @ axis):
            out += _sheet(triangles[mine][each], area[mine][each])
        triangles, normal, area = (a[~mine] for a in (triangles, normal, area))
    return np.concatenate(out)


def _apart(reach: np.ndarray) -> list[np.ndarray]:
    """Indices of triangles of each pane, by how far their corners (triangle, 3) reach [m]."""
    low = reach.min(axis=1)
    order = low.argsort()
    so_far = np.maximum.accumulate(reach.max(axis=1)[order])
    begins = np.flatnonzero(low[order][1:] > so_far[:-1] + APART) + 1
    return np.split(order, begins)


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
