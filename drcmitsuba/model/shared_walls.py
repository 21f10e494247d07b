"""Faces that lie in one place: those of two rooms are one sheet with a side for each room.

Else rounding would decide which of the two a ray meets, and either room would get the other's
reflectance. Files may state such pairs; here they are found by their geometry, also where a face
lies along several others or on a part of one. What lies on a room's face from outside, as a shade,
is left out there by `uncovered`, and so are windows that two rooms have in one place, or that look
at the wall of another room, by `single_panes`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from drcmitsuba.model.plane import Plane, Rings
from drcmitsuba.model.polygon import area_vector

UNSTATED = (
    "Faces of two rooms lie in one place, which the file does not say: they are one wall with a "
    "side for each room"
)
"""Note on such faces."""
COVERED = "Windows and doors that lie on those or on the wall of another room are left out there"
"""Note on such windows."""
PARALLEL = 1e-3
"""Largest sine of the angle between normals of faces in one plane."""


class RoomFace(NamedTuple):
    """Opaque face of a room."""

    rings: Rings
    """Outline, counter-clockwise from outside the room, and holes."""
    room: str


class FaceSheet(NamedTuple):
    """Part of a face, with what lies behind it."""

    rings: Rings
    """As those of the face, or, of a part that is shared, with the front towards its room."""
    behind: int | None = None
    """Index of the face of another room on its back; None without any."""


def sheets_of(faces: Sequence[RoomFace], tolerance: float) -> list[list[FaceSheet]]:
    """Sheets of every face.

    Parameters
    ----------
    faces : sequence of RoomFace
    tolerance : float
        Distance within which faces lie in one plane, and width of the smallest part, in the unit of
        the faces.

    Returns
    -------
    list of list of FaceSheet, by face
        What two faces share is a sheet of the first of them alone. Faces that share nothing stay
        as they are.
    """
    shared: list[list[FaceSheet]] = [[] for _ in faces]
    rest = [[face.rings] for face in faces]
    for plane, one, other in _pairs(faces, tolerance):
        mine, theirs = (_shape(plane, rest[i]) for i in (one, other))
        both = mine & theirs
        if both.area <= tolerance * both.length:
            continue
        common = plane.rings(both, tolerance**2)
        shared[one] += [FaceSheet(rings, other) for rings in _turned(common)]
        rest[one] = _wide(plane, mine - both, tolerance)
        rest[other] = _turned(_wide(plane, theirs - both, tolerance))
    return [
        [*sheets, *(FaceSheet(rings) for rings in own)]
        for sheets, own in zip(shared, rest, strict=True)
    ]


def uncovered(
    polygons: Sequence[Rings], covers: Sequence[Rings], tolerance: float
) -> list[list[Rings]]:
    """Parts of polygons on which no other polygon lies.

    Parameters
    ----------
    polygons, covers : sequence of Rings
        Outlines and holes, with fronts to either side.
    tolerance : float
        As for `sheets_of`.

    Returns
    -------
    list of list of Rings, by polygon
        Those that nothing covers are as they came; others keep their front.
    """
    out = [[rings] for rings in polygons]
    if not (count := len(polygons)):
        return out
    for plane, one, other in _in_one_plane([*polygons, *covers], tolerance, count):
        mine = _shape(plane, out[one])
        both = mine & _shape(plane, [covers[other - count]])
        if both.area > tolerance * both.length:
            out[one] = _wide(plane, mine - both, tolerance)
    return out


def single_panes(
    panes: Sequence[Rings], walls: Sequence[Rings], tolerance: float
) -> list[list[Rings]]:
    """Parts of panes on which neither a wall nor a pane before them lies.

    Parameters
    ----------
    panes, walls : sequence of Rings
        Those of all rooms; walls have holes where their own panes are.
    tolerance : float
        As for `sheets_of`.

    Returns
    -------
    list of list of Rings, by pane
        Those that nothing covers are as they came; others keep their front.
    """
    out = uncovered(panes, walls, tolerance)
    for plane, one, other in _in_one_plane(panes, tolerance):
        theirs = _shape(plane, out[other])
        both = theirs & _shape(plane, out[one])
        if both.area > tolerance * both.length:
            faces_back = area_vector(panes[other][0]) @ plane.normal < 0
            left = _wide(plane, theirs - both, tolerance)
            out[other] = _turned(left) if faces_back else left
    return out


def _shape(plane: Plane, parts: Sequence[Rings]) -> Any:
    """Parts of a face as a shape in a plane; empty where an outline crosses itself."""
    outlines = [plane.polygon(rings[:1]) for rings in parts]
    holes = [plane.polygon([hole]) for rings in parts for hole in rings[1:] if len(hole) > 2]
    if not all(shape.is_valid for shape in (*outlines, *holes)):
        return shapely.Polygon()
    return shapely.union_all(outlines) - shapely.union_all(holes)


def _turned(polygons: Sequence[Rings]) -> list[Rings]:
    """Polygons with their fronts to the other side."""
    return [tuple(ring[::-1] for ring in rings) for rings in polygons]


def _wide(plane: Plane, shape: Any, tolerance: float) -> list[Rings]:
    """Polygons of a shape that are wider than a tolerance; their front is the plane's."""
    parts = [part for part in shapely.get_parts(shape) if part.area > tolerance * part.length / 2]
    return plane.rings(shapely.MultiPolygon(parts), tolerance**2) if parts else []


def _pairs(faces: Sequence[RoomFace], tolerance: float) -> Iterator[tuple[Plane, int, int]]:
    """Faces of two rooms in one plane that look at each other's back and may overlap.

    The front of the plane is that of the first face.
    """
    for plane, one, other in _in_one_plane([face.rings for face in faces], tolerance):
        away = area_vector(faces[other].rings[0]) @ plane.normal < 0
        if away and faces[one].room != faces[other].room:
            yield plane, one, other


def _in_one_plane(
    polygons: Sequence[Rings], tolerance: float, covered: int | None = None
) -> Iterator[tuple[Plane, int, int]]:
    """Polygons in one plane that may overlap, the first of lower index.

    The front of the plane is that of the first polygon. With `covered`, the first is one of so many
    at the beginning, the other one of those behind them.
    """
    vectors = np.array([area_vector(rings[0]) for rings in polygons]).reshape(-1, 3)
    size = np.linalg.norm(vectors, axis=1)
    some = np.flatnonzero(size > 0)
    if len(some) < 2:
        return
    normals = vectors[some] / size[some, None]
    corners = [np.asarray(polygons[i][0]) for i in some.tolist()]
    low = np.array([c.min(axis=0) for c in corners]) - tolerance
    high = np.array([c.max(axis=0) for c in corners]) + tolerance
    tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    first, second = tree.query(tree.geometries, predicate="intersects")
    one, other = some[first], some[second]
    kept = one < other if covered is None else (one < covered) & (other >= covered)
    kept &= ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
    kept &= np.linalg.norm(np.cross(normals[first], normals[second]), axis=1) < PARALLEL
    for a, b in zip(first[kept].tolist(), second[kept].tolist(), strict=True):
        plane = Plane.of(corners[a])
        if plane.distance(corners[b]) <= tolerance:
            yield plane, int(some[a]), int(some[b])
