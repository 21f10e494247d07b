"""Surfaces in one plane: rounding would decide which one a ray meets, so none may remain.

Outside faces in the plane of a wall, the floor or the ceiling are set back; overlapping faces of
two reflectances are refused. Faces that look opposite ways may share a plane, as cupboard and wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.furniture import Furniture
from drcmitsuba.case.unit_check import refuse_far
from drcmitsuba.model.materials import Reflectance
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import around, faces_of, normals

SAME_PLANE = 1e-5
"""Distance below which two planes count as one [m]."""
SET_BACK = 0.005
"""Distance by which outside faces in the plane of a wall move into their body [m]."""
OVERLAP = 1e-6
"""Rectangles that overlap by less than this only touch [m]."""

_PLANES = ("west wall", "east wall", "south wall", "north wall", "floor", "ceiling")


@dataclass(frozen=True)
class RoomPlane:
    """One of the six planes of a room; its name for messages is such as "west wall"."""

    axis: int
    """Axis of its normal: 0, 1, 2 for x, y, z."""
    at: float
    """Coordinate on that axis [m]."""
    inward: int
    """Sign of the normal of the room's own surface."""
    name: str

    @property
    def beside(self) -> list[int]:
        """The two other axes."""
        return [i for i in range(3) if i != self.axis]

    def holds(self, faces: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Whether polygons (face, corner, 3) lie in the plane and overlap a room of `size` (3,).

        Bounding rectangles decide, so a triangle beside a corner of the room overlaps it, too.
        """
        near = (abs(faces[:, :, self.axis] - self.at) < SAME_PLANE).all(axis=1)
        flat = faces[:, :, self.beside]
        low, high = flat.min(axis=1), flat.max(axis=1)
        return near & ((low < size[self.beside] - OVERLAP) & (high > OVERLAP)).all(axis=1)


def planes(case: Case) -> list[RoomPlane]:
    """The six planes of a case's room; an empty list without a room."""
    if case.room is None:
        return []
    ends = [(axis, end) for axis in range(3) for end in (0, 1)]
    return [
        RoomPlane(axis, end * case.room.size[axis], 1 - 2 * end, name)
        for (axis, end), name in zip(ends, _PLANES, strict=True)
    ]


def settled(case: Case) -> list[tuple[Furniture, np.ndarray]]:
    """Furniture of a recentred case with its faces (face, 4, 3), none of them in another's plane.

    A face of a body outside in the plane of a wall, such as a balcony's, moves into the body: it
    is seen only through the panes. A ground plate that reaches below the room moves down.

    Raises
    ------
    InputError
        Two pieces of different reflectance, or a plate and the floor or ceiling, share a plane; or
        a piece lies too far from the origin.
    """
    pieces = [(piece, np.array(faces_of(piece))) for piece in case.furniture]
    for i, (_, faces) in enumerate(pieces):
        refuse_far(case.source, f"furniture.{i}", faces.reshape(-1, 3), around(case))
    for i, (piece, faces) in enumerate(pieces):
        for plane in planes(case):
            _settle(case, plane, i, piece, faces)
    _check_pieces(case, pieces)
    return pieces


def _settle(case: Case, plane: RoomPlane, i: int, piece: Furniture, faces: np.ndarray) -> None:
    """Set back the faces of a piece that lie in a plane of the room and look into it."""
    assert case.room is not None
    size = np.array(case.room.size)
    is_plate = piece.size[2] == 0
    alike = normals(faces)[:, plane.axis] * plane.inward > 0.5
    mine = plane.holds(faces, size) & (alike | is_plate)
    if is_plate:
        flat = faces[:, :, plane.beside]
        margin = size[plane.beside] * [[0], [1]] + [[-OVERLAP], [OVERLAP]]
        within = ((flat >= margin[0]) & (flat <= margin[1])).all(axis=(1, 2))
        if (mine & within).any():
            got = f"{piece.name!r} lies in the plane of the {plane.name}"
            raise InputError(case.source, f"furniture.{i}", got, "move it 1 mm into the room")
    depth = SET_BACK if is_plate else min(SET_BACK, piece.size[plane.axis] / 2)
    faces[mine, :, plane.axis] -= plane.inward * depth


def _check_pieces(case: Case, pieces: list[tuple[Furniture, np.ndarray]]) -> None:
    """Refuse faces of different reflectance that overlap in one plane and look the same way."""
    colours: dict[Reflectance, int] = {}
    for piece, _ in pieces:
        colours.setdefault(piece.reflectance, len(colours))
    if len(colours) < 2:
        return
    faces = np.concatenate([f for _, f in pieces])
    owner = np.repeat(np.arange(len(pieces)), [len(f) for _, f in pieces])
    colour = np.array([colours[piece.reflectance] for piece, _ in pieces])[owner]
    n = normals(faces)
    plates = np.flatnonzero(np.array([piece.size[2] == 0 for piece, _ in pieces])[owner])
    twice = np.append(np.arange(len(faces)), plates)  # a plate has two sides
    n = np.concatenate([n, -n[plates]])
    faces, owner, colour = faces[twice], owner[twice], colour[twice]
    axis = abs(n).argmax(axis=1)
    sign = np.take_along_axis(n, axis[:, None], 1)[:, 0] > 0
    at = np.take_along_axis(faces[:, 0], axis[:, None], 1)[:, 0]
    low, high = faces.min(axis=1), faces.max(axis=1)
    order = np.lexsort((at, sign, axis))
    changes = np.diff(axis[order]) | np.diff(sign[order].astype(int)) != 0
    starts = np.flatnonzero(changes | (np.diff(at[order]) > SAME_PLANE)) + 1
    for group in np.split(order, starts):
        if (colour[group] == colour[group[0]]).all():
            continue
        beside = [i for i in range(3) if i != axis[group[0]]]
        low_here, high_here = low[group][:, beside], high[group][:, beside]
        for k, face in enumerate(group):
            other = colour[group] != colour[face]
            meets = (low_here < high_here[k] - OVERLAP) & (high_here > low_here[k] + OVERLAP)
            clash = other & meets.all(axis=1)
            if clash.any():
                one, two = sorted((int(owner[face]), int(owner[group[np.argmax(clash)]])))
                first, second = pieces[one][0].name, pieces[two][0].name
                place = f"{'xyz'[axis[face]]} = {at[face]:.4g} m"
                got = f"{second!r} and {first!r} share the plane {place}, with two reflectances"
                raise InputError(case.source, f"furniture.{two}", got, "move it 1 mm")


def refuse_in_walls(case: Case, name: str, triangles: np.ndarray, two_sided: bool) -> None:
    """Refuse a mesh with triangles (triangle, 3, 3) [m] in the plane of a wall, floor or ceiling.

    Unless the triangles are `two_sided`, only fronts that face the room matter.

    Raises
    ------
    InputError
        A triangle lies in one of the planes.
    """
    for plane in planes(case):
        assert case.room is not None
        mine = np.flatnonzero(plane.holds(triangles, np.array(case.room.size)))
        u, v = triangles[mine, 1] - triangles[mine, 0], triangles[mine, 2] - triangles[mine, 0]
        facing = np.cross(u, v)[:, plane.axis] * plane.inward
        if (facing != 0).any() if two_sided else (facing > 0).any():
            got = f"some of its faces lie in the plane of the {plane.name}"
            remedy = f"move it {SET_BACK * 1000:g} mm off, with `position`"
            raise InputError(case.source, f"components.{name}", got, remedy)
