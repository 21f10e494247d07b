"""Plain geometry: surfaces as quadrilaterals, and the room, its façades and its furniture as such.

All is in the room's own frame [m]. Panes face the room: their normals point inward. Where there is
no room, the frame begins near the sensors: see `recentred`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import MeshComponent
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.furniture import Furniture
from drcmitsuba.case.room import Room
from drcmitsuba.case.toml import Side
from drcmitsuba.case.unit_check import refuse_far
from drcmitsuba.scene.materials import SurfaceMaterial

UP = np.array([0.0, 0.0, 1.0])
SIDES: tuple[Side, ...] = ("south", "east", "north", "west")


@dataclass(frozen=True)
class Surface:
    """Quadrilaterals of one material, shape (quad, 4, 3) [m], counter-clockwise from the front.

    A triangle repeats its last corner. `component` names the component that it is a part of; ""
    is the room, its panes and furniture. Nothing sees the backs of a `closed` body.
    """

    name: str
    material: SurfaceMaterial
    quads: np.ndarray
    component: str = ""
    closed: bool = False


@dataclass(frozen=True)
class Port:
    """Rectangle (4, 3) [m] that light passes on its way to a component; its front faces inward.

    Parameters
    ----------
    component : str
        "" are the panes of the room.
    quad : np.ndarray, shape (4, 3)
        Its normal (q₁ − q₀) × (q₃ − q₀) points the way that the light goes.
    """

    component: str
    quad: np.ndarray


def quad(corner: Any, u: Any, v: Any) -> np.ndarray:
    """Quadrilateral with its front in the direction u × v."""
    c, u, v = (np.asarray(x, float) for x in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def box(corner: np.ndarray, size: np.ndarray) -> list[np.ndarray]:
    """Faces of a box, fronts outward; a box without height is one plate."""
    x, y, z = np.diag(size)
    top = quad(corner + z, x, y)
    if size[2] == 0:
        return [top]
    return [
        top,
        quad(corner, y, x),
        quad(corner, x, z),
        quad(corner + x, y, z),
        quad(corner + x + y, -x, z),
        quad(corner + y, -y, z),
    ]


def boxes(furniture: Furniture) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corner and size of every repetition of a piece of furniture."""
    size = np.array(furniture.size)
    return [
        (np.array(furniture.corner) + [i * furniture.step[0], j * furniture.step[1], 0], size)
        for i in range(furniture.count[0])
        for j in range(furniture.count[1])
    ]


def normals(quads: np.ndarray) -> np.ndarray:
    """Unit normals (quad, 3) of quadrilaterals (quad, 4, 3)."""
    n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def side_of(room: Room, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """Foot and direction of a wall, such that direction × up points out of the room."""
    width, depth, _ = room.size
    return {
        "south": (np.zeros(3), np.array([width, 0.0, 0.0])),
        "east": (np.array([width, 0.0, 0.0]), np.array([0.0, depth, 0.0])),
        "north": (np.array([width, depth, 0.0]), np.array([-width, 0.0, 0.0])),
        "west": (np.array([0.0, depth, 0.0]), np.array([0.0, -depth, 0.0])),
    }[side]


def wall(
    room: Room, side: Side, facade: Facade
) -> tuple[list[np.ndarray], list[np.ndarray], dict[str, list[np.ndarray]]]:
    """Cut a side of the room into wall, frame and panes by material, fronts inward."""
    foot, along = side_of(room, side)
    length = float(np.linalg.norm(along))
    along = along / length

    def rectangle(left: float, right: float, bottom: float, top: float) -> np.ndarray:
        start = foot + along * left + UP * bottom
        return quad(start, UP * (top - bottom), along * (right - left))

    opaque: list[np.ndarray] = []
    frame: list[np.ndarray] = []
    panes: dict[str, list[np.ndarray]] = {}
    segment, half = length / facade.segments, facade.frame / 2
    for column, strips in facade.columns():
        begin, end = column.start * segment, column.stop * segment
        top = 0.0
        for strip in strips:
            if strip.bottom > top:
                opaque.append(rectangle(begin, end, top, strip.bottom))
            top = strip.top
            if strip.material == "wall":
                opaque.append(rectangle(begin, end, strip.bottom, strip.top))
                continue
            for i in column:
                left, right = i * segment, (i + 1) * segment
                inner = (left + half, right - half, strip.bottom + half, strip.top - half)
                panes.setdefault(strip.material, []).append(rectangle(*inner))
                if half > 0:
                    frame += [
                        rectangle(left, right, strip.bottom, inner[2]),
                        rectangle(left, right, inner[3], strip.top),
                        rectangle(left, inner[0], inner[2], inner[3]),
                        rectangle(inner[1], right, inner[2], inner[3]),
                    ]
        if top < room.size[2]:
            opaque.append(rectangle(begin, end, top, room.size[2]))
    return opaque, frame, panes


def ceiling(room: Room, holes: list[np.ndarray]) -> list[np.ndarray]:
    """Cut the ceiling about holes (lowest and highest x, lowest and highest y), fronts downward."""
    width, depth, height = room.size
    x = np.unique([0.0, width, *(e for hole in holes for e in hole[:2])])
    y = np.unique([0.0, depth, *(e for hole in holes for e in hole[2:])])
    quads = []
    for low, high in pairwise(y):
        for left, right in pairwise(x):
            middle = (left + right) / 2, (low + high) / 2
            if not any(h[0] < middle[0] < h[1] and h[2] < middle[1] < h[3] for h in holes):
                quads.append(quad([left, low, height], [0, high - low, 0], [right - left, 0, 0]))
    return quads


def facade_quads(case: Case, side: Side, rectangles: np.ndarray) -> np.ndarray:
    """Quadrilaterals (rectangle, 4, 3) in the world of rectangles on a side, fronts inward [m].

    Parameters
    ----------
    case : Case
    side : {"south", "east", "north", "west"}
    rectangles : np.ndarray, shape (rectangle, 4)
        Left, right, bottom and top from the foot of the side [m].
    """
    assert case.room is not None
    foot, along = side_of(case.room, side)
    along = along / np.linalg.norm(along)
    quads = [
        quad(foot + along * left + UP * bottom, UP * (top - bottom), along * (right - left))
        for left, right, bottom, top in rectangles
    ]
    return np.reshape(quads, (-1, 4, 3)) @ rotation(case).T


def origin(case: Case) -> np.ndarray:
    """Where the frame that is traced has its origin, in the case's coordinates, shape (3,) [m].

    The room's corner, 0, or the corner of the sensors in whole metres: scenes without a room may
    be given in coordinates of a map.
    """
    return np.zeros(3) if case.room is not None else np.floor(case.sensors.corner)


def recentred(case: Case) -> Case:
    """Return the case with its coordinates counted from its `origin`.

    Mitsuba's numbers have 24 bits, and it starts rays off a surface by 9e-5 of the largest
    coordinate: 400 m at the northing of Rome. So coordinates are subtracted before it sees them.
    """
    start = origin(case)
    if not start.any():
        return case

    def near(point: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(float(v) for v in np.subtract(point, start))

    components = {
        name: c.model_copy(
            update={
                "position": near(c.position),
                "ports": tuple(tuple(near(corner) for corner in port) for port in c.ports),
            }
        )
        for name, c in case.components.items()
        if isinstance(c, MeshComponent)  # without a room there is nothing else
    }
    pieces = [piece.model_copy(update={"corner": near(piece.corner)}) for piece in case.furniture]
    sensors = case.sensors.model_copy(update={"corner": near(case.sensors.corner)})
    return case.moved(sensors, tuple(pieces), components)


def around(case: Case) -> str:
    """What the coordinates of a recentred case are counted from, in words."""
    return "the room's corner" if case.room is not None else "the sensors"


def furniture(case: Case) -> list[tuple[Furniture, list[np.ndarray]]]:
    """Furniture of a recentred case with its faces (4, 3), fronts outward.

    Raises
    ------
    InputError
        A piece lies on the other side of the map.
    """
    pieces = []
    for i, piece in enumerate(case.furniture):
        faces = [face for corner, size in boxes(piece) for face in box(corner, size)]
        points = np.concatenate(faces)
        refuse_far(case.source, f"furniture.{i}", points, around(case))
        pieces.append((piece, faces))
    return pieces


def rotation(case: Case) -> np.ndarray:
    """Matrix that turns the room's frame into the world's."""
    angle = np.radians(case.room.rotation) if case.room else 0.0
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
