"""Gaps between the surfaces around a space, and the polygons that close them.

Edges around a closed space lie on edges of other surfaces. What is left of them bounds gaps: in
each plane of such edges, the polygons that they form and that no surface covers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from drcmitsuba.model.plane import Plane, Rings
from drcmitsuba.model.polygon import area_vector

NEAR = 0.05
"""Distance within which edges and corners lie on each other [m]."""
LEAST = 1e-3
"""Area of the smallest gap that is closed [m²]."""
LEAST_SINE = 0.1
"""Sine of the angle between two edges that span a plane, at least [–]."""
MOST_EDGES = 4000
"""Largest number of a space's edges among which gaps are looked for."""


def gaps_of(rings: Sequence[np.ndarray]) -> list[Rings]:
    """Polygons that close the gaps of a space.

    Parameters
    ----------
    rings : sequence of np.ndarray
        Polygons around the space, shape (corner, 3) each [m].

    Returns
    -------
    list of Rings
        Outline and holes of each, facing any side. There are none where the space is closed, where
        what is missing is not plane, or where there are too many edges.
    """
    edges = open_edges(rings) if rings else np.empty((0, 2, 3))
    return [gap for plane in _planes(edges) for gap in _closing(plane, edges, rings)]


def open_edges(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Parts of edges (edge, 2, 3) on which no other edge lies [m]."""
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    length = np.linalg.norm(end - start, axis=1)
    start, end, length = (a[length > NEAR] for a in (start, end, length))
    if len(start) > MOST_EDGES:
        return np.empty((0, 2, 3))
    along = (end - start) / length[:, None]
    out = []
    for i, (origin, d, whole) in enumerate(zip(start, along, length, strict=True)):
        first, last = ((point - origin) @ d for point in (start, end))
        apart = [
            np.linalg.norm(point - origin - at[:, None] * d, axis=1)
            for point, at in ((start, first), (end, last))
        ]
        on = np.maximum(*apart) < NEAR
        on[i] = False
        covered, order = 0.0, np.argsort(np.minimum(first, last)[on])
        spans = np.sort(np.column_stack([first, last])[on][order], axis=1)
        for low, high in [*spans.tolist(), [whole, whole]]:
            if low > covered + NEAR and covered < whole:
                out.append(origin + np.outer([covered, min(low, whole)], d))
            covered = max(covered, high)
    return np.array(out).reshape(-1, 2, 3)


def _planes(edges: np.ndarray) -> list[Plane]:
    """Planes of edges that meet in a corner, once each."""
    corners = edges.reshape(-1, 3)
    tree, planes = shapely.STRtree(shapely.points(corners[:, :2])), list[Plane]()
    first, second = tree.query(shapely.points(corners[:, :2]), "dwithin", NEAR)
    meet = (first // 2 < second // 2) & (np.abs(corners[first, 2] - corners[second, 2]) < NEAR)
    for i, k in zip(first[meet].tolist(), second[meet].tolist(), strict=True):
        ring = np.stack([corners[i ^ 1], corners[i], corners[k ^ 1]])
        lengths = np.linalg.norm(ring[[0, 2]] - ring[1], axis=1)
        if 2 * np.linalg.norm(area_vector(ring)) < LEAST_SINE * lengths.prod():
            continue
        if not any(other.distance(ring) < NEAR for other in planes):
            planes.append(Plane.of(ring))
    return planes


def _closing(plane: Plane, edges: np.ndarray, rings: Sequence[np.ndarray]) -> list[Rings]:
    """Polygons in a plane between all edges, without surfaces, most of whose edges are open."""
    start = np.concatenate(rings)
    every = np.stack([start, np.concatenate([np.roll(r, -1, axis=0) for r in rings])], axis=1)
    lines, bounds = (_lines(plane, some) for some in (every, edges))
    shapes = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines).tolist()))
    level = [r for r in rings if np.abs((r - plane.corner) @ plane.normal).max() < NEAR]
    there = [shapely.make_valid(shapely.Polygon(_flat(plane, ring))) for ring in level]
    covered = shapely.union_all([shape.buffer(NEAR) for shape in there])
    rest = shapely.get_parts(shapely.union_all(shapes).difference(covered))
    whole = [part.buffer(NEAR, join_style="mitre") for part in rest if part.area > LEAST]
    open_lines = bounds.buffer(3 * NEAR)
    gaps = [g for g in whole if g.boundary.intersection(open_lines).length > g.length / 2]
    return plane.rings(shapely.union_all(gaps), LEAST)


def _lines(plane: Plane, edges: np.ndarray) -> Any:
    """Edges (edge, 2, 3) in a plane as lines, a little longer, so that those that meet cross."""
    own = edges[np.abs((edges - plane.corner) @ plane.normal).max(axis=1) < NEAR]
    along = own[:, 1] - own[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along * NEAR / np.maximum(length, NEAR)
    longer = own + np.stack([-along, along], axis=1)
    return shapely.union_all(shapely.linestrings([_flat(plane, edge) for edge in longer]))


def _flat(plane: Plane, points: np.ndarray) -> np.ndarray:
    """Coordinates (point, 2) in a plane [m]."""
    away = points - plane.corner
    return np.stack([away @ plane.u, away @ plane.v], axis=1)
