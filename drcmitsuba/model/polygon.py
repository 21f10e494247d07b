"""Polygons of any shape as parallelograms and triangles, which the engine knows."""

from __future__ import annotations

from collections.abc import Sequence

import mapbox_earcut
import numpy as np
import shapely

FLAT = 1e-3
"""Largest distance of a corner from its polygon's plane, over the polygon's extent [–]."""
SAME = 1e-9
"""Corners nearer to each other than this, over the polygon's extent, are one corner [–]."""
PARALLEL = 1e-6
"""Largest gap between a corner and the one that closes a parallelogram, over the extent [–]."""


class NoAreaError(ValueError):
    """A polygon has no area."""


def are_parallelograms(corners: np.ndarray) -> np.ndarray:
    """Whether polygons (polygon, 4, 3) are parallelograms, bool (polygon,)."""
    gap = np.abs(corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]).max(axis=1)
    return np.asarray(gap <= PARALLEL * np.ptp(corners, axis=1).max(axis=1))


def area_vector(corners: np.ndarray) -> np.ndarray:
    """Normal times area of a polygon (corner, 3), front counter-clockwise (Newell) [m²]."""
    c = corners - corners[0]
    return np.asarray(np.cross(c, np.roll(c, -1, axis=0)).sum(axis=0) / 2)


def closes(areas: np.ndarray, missing: float) -> bool:
    """Whether area vectors (face, 3) are those of a closed body, of which a part may be missing."""
    whole = float(np.linalg.norm(areas, axis=1).sum())
    return bool(np.linalg.norm(areas.sum(axis=0)) <= missing * whole)


def quads_of(corners: np.ndarray, holes: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Cut a polygon into parallelograms and triangles.

    A polygon whose boundary runs along a seam to a hole and back, as Radiance writes holes, is cut
    like one with holes.

    Parameters
    ----------
    corners : np.ndarray, shape (corner, 3)
        Corners in turn, counter-clockwise from the front [m].
    holes : sequence of np.ndarray, shape (corner, 3) each
        Corners of holes, in any direction [m].

    Returns
    -------
    np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner, counter-clockwise from the
        front [m].

    Raises
    ------
    NoAreaError
        The polygon has no area.
    ValueError
        It is not planar, or crosses itself.
    """
    rings = [_distinct(np.asarray(ring, float)) for ring in (corners, *holes)]
    outer = rings[0]
    if len(outer) < 3:
        raise NoAreaError("fewer than three distinct corners")
    extent = float(np.ptp(outer, axis=0).max())
    normal = area_vector(outer)
    size = float(np.linalg.norm(normal))
    if not np.isfinite(extent) or size < SAME * extent**2:
        raise NoAreaError("no area")
    normal /= size
    every = np.concatenate(rings)
    off = float(np.abs((every - outer[0]) @ normal).max())
    if off > FLAT * extent:
        raise ValueError(f"not planar: a corner lies {off:.3g} m off its plane")
    if len(rings) == 1 and len(outer) == 3:
        return outer[[0, 1, 2, 2]][None]
    if len(rings) == 1 and len(outer) == 4 and are_parallelograms(outer[None])[0]:
        return outer[None]
    u, v = axes_across(normal)
    flat = [np.stack([(ring - outer[0]) @ u, (ring - outer[0]) @ v], axis=1) for ring in rings]
    loops = [loop for ring in rings for loop in _loops(ring)]
    if len(loops) > len(rings):  # a seam leads to a hole and back
        return _quads_of_seamed(loops, outer[0], u, v, extent)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    index = mapbox_earcut.triangulate_float64(np.concatenate(flat), ends).reshape(-1, 3)
    triangles = every[index]
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) @ normal
    wanted = size - sum(float(np.linalg.norm(area_vector(hole))) for hole in rings[1:])
    if abs(float(np.abs(n).sum()) / 2 - wanted) > 1e-6 * size:
        raise ValueError("its outline crosses itself, or a hole crosses it")
    triangles[n < 0] = triangles[n < 0][:, ::-1]
    triangles = triangles[np.abs(n) > SAME * extent**2]
    return triangles[:, [0, 1, 2, 2]]


def _loops(ring: np.ndarray) -> list[np.ndarray]:
    """Loops (corner, 3) of a ring that comes to the same corner twice; seams are left out."""
    extent = float(np.ptp(ring, axis=0).max())
    _, key = np.unique(np.round(ring / (1e-7 * extent)), axis=0, return_inverse=True)
    path: list[int] = []
    loops: list[np.ndarray] = []
    position: dict[int, int] = {}  # of every corner in the path
    for i, corner in enumerate(key.ravel().tolist()):
        if corner in position:
            start = position[corner]
            loops.append(ring[path[start:]])
            for other in path[start:]:
                position.pop(int(key.flat[other]))
            del path[start:]
        position[corner] = len(path)
        path.append(i)
    return [loop for loop in [*loops, ring[path]] if len(loop) > 2]


def _quads_of_seamed(
    loops: Sequence[np.ndarray], corner: np.ndarray, u: np.ndarray, v: np.ndarray, extent: float
) -> np.ndarray:
    """Quads of what an odd number of loops surrounds, whichever way they turn, as Radiance does."""
    shape = shapely.Polygon()
    for loop in loops:
        own = shapely.Polygon(np.stack([(loop - corner) @ u, (loop - corner) @ v], axis=1))
        if not own.is_valid:
            raise ValueError("its outline crosses itself, or a hole crosses it")
        shape = shape.symmetric_difference(own)
    quads = []
    for part in getattr(shape, "geoms", [shape]):
        if part.area < SAME * extent**2:
            continue
        rings = [
            corner + c[:, :1] * u + c[:, 1:] * v
            for c in (np.array(ring.coords)[:-1] for ring in (part.exterior, *part.interiors))
        ]
        if not part.exterior.is_ccw:
            rings[0] = rings[0][::-1]
        quads.append(quads_of(rings[0], rings[1:]))
    if not quads:
        raise ValueError("no area")
    return np.concatenate(quads)


def _distinct(ring: np.ndarray) -> np.ndarray:
    """Corners without those that repeat the one before."""
    if len(ring) < 2:
        return ring
    extent = float(np.ptp(ring, axis=0).max())
    far = np.abs(ring - np.roll(ring, 1, axis=0)).max(axis=1) > SAME * extent
    return ring[far]


def axes_across(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across a normal; (u, v, normal) is right-handed."""
    least = np.eye(3)[np.argmin(np.abs(normal))]
    u = np.cross(least, normal)
    u /= np.linalg.norm(u)
    return u, np.cross(normal, u)
