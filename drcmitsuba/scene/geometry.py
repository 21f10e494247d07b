"""Plain geometry: room, façades and furniture as quadrilaterals in the room's frame [m].

Panes face the room: their normals point inward. Without a room the frame's origin lies near the
sensors (`recentred`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import MeshComponent
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.furniture import Furniture
from drcmitsuba.case.room import Room
from drcmitsuba.case.sensors import Sensors
from drcmitsuba.model.materials import SurfaceMaterial
from drcmitsuba.model.model import Model, areas
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side, shortened

UP = np.array([0.0, 0.0, 1.0])
SIDES: tuple[Side, ...] = ("south", "east", "north", "west")
UPRIGHT = 1e-3
"""Largest vertical part of an upright surface's normal [–]."""
STEP = 0.02
"""Step of the angles by which walls are counted [deg]: cells end at those within three of them."""
STRAIGHT = 0.01
"""Angle within which walls stand along an axis [deg]."""


@dataclass(frozen=True)
class Surface:
    """Quadrilaterals of one material, shape (quad, 4, 3) [m], counter-clockwise from the front.

    A triangle repeats its last corner. `component` is the name of the surface's component, "" for
    the room, its panes and furniture. The backs of a `closed` body face its inside. `behind` names
    the material on the back of a sheet, where it is another one. Panes `indoors` have rooms on both
    sides.
    """

    name: str
    material: SurfaceMaterial
    quads: np.ndarray
    component: str = ""
    closed: bool = False
    behind: str = ""
    indoors: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its sides."""
        return (self.name, self.behind) if self.behind else (self.name,)


@dataclass(frozen=True)
class Port:
    """Rectangle (4, 3) [m] that light passes on its way to a component; "" for panes of the room.

    Its normal (q₁ − q₀) × (q₃ − q₀) has the direction of the light.
    """

    component: str
    quad: np.ndarray


def quad(corner: Any, u: Any, v: Any) -> np.ndarray:
    """Parallelogram (4, 3) that u and v span from a corner; its front has the direction u × v."""
    c, u, v = (np.asarray(x, float) for x in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def box(corner: np.ndarray, size: np.ndarray) -> list[np.ndarray]:
    """Faces (4, 3) of a box, fronts outward; a box without height is one plate."""
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
    """Corner and size, (3,) [m] each, of every copy of a piece of furniture."""
    size = np.array(furniture.size)
    return [
        (np.array(furniture.corner) + [i * furniture.step[0], j * furniture.step[1], 0], size)
        for i in range(furniture.count[0])
        for j in range(furniture.count[1])
    ]


def faces_of(furniture: Furniture) -> list[np.ndarray]:
    """Faces (4, 3) [m] of every copy of a piece of furniture, fronts outward."""
    return [face for corner, size in boxes(furniture) for face in box(corner, size)]


def normals(quads: np.ndarray) -> np.ndarray:
    """Unit normals (quad, 3) of quadrilaterals (quad, 4, 3); NaN of those without area."""
    n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    length = np.linalg.norm(n, axis=1, keepdims=True)
    return np.divide(n, length, out=np.full(n.shape, np.nan), where=length > 0)


def is_triangle(quads: np.ndarray) -> np.ndarray:
    """Whether the last corner of each quadrilateral repeats, shape (quad,)."""
    return np.asarray((quads[:, 2] == quads[:, 3]).all(axis=1))


def points_on(quads: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Points (quad, 3) on parallelograms and triangles at uniform numbers (quad, 2)."""
    fold = is_triangle(quads) & (uv.sum(axis=1) > 1)
    a, b = np.where(fold[:, None], 1 - uv, uv).T[:, :, None]
    return quads[:, 0] + a * (quads[:, 1] - quads[:, 0]) + b * (quads[:, 3] - quads[:, 0])


def reversed_quads(quads: np.ndarray) -> np.ndarray:
    """Quads (quad, 4, 3) with their fronts on the other side; triangles stay triangles."""
    triangles = quads[:, [0, 2, 1, 1]]
    return np.where(is_triangle(quads)[:, None, None], triangles, quads[:, ::-1])


def side_of(room: Room, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """Start and extent, (3,) [m] each, of a wall's foot; extent × up points out of the room."""
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
    """Cut a side into rectangles (4, 3) of wall, frame and, by material, panes; fronts inward."""
    foot, along = side_of(room, side)
    length = float(np.linalg.norm(along))
    along = along / length

    def rectangle(*edges: float) -> np.ndarray:
        return _upright(foot, along, *edges)

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


def _upright(
    foot: np.ndarray, along: np.ndarray, left: float, right: float, bottom: float, top: float
) -> np.ndarray:
    """Rectangle (4, 3) on a side from its foot [m] and its direction; the front faces inward."""
    start = foot + along * left + UP * bottom
    return quad(start, UP * (top - bottom), along * (right - left))


def overhead(hole: np.ndarray, height: float) -> np.ndarray:
    """Rectangle (4, 3) from lowest and highest x, then y, and its height [m]; front downward."""
    x0, x1, y0, y1 = hole
    return quad([x0, y0, height], [0, y1 - y0, 0], [x1 - x0, 0, 0])


def ceiling(room: Room, holes: list[np.ndarray]) -> list[np.ndarray]:
    """Cut the ceiling around holes (lowest and highest x, then y [m]), fronts downward."""
    width, depth, height = room.size
    x = np.unique([0.0, width, *(e for hole in holes for e in hole[:2])])
    y = np.unique([0.0, depth, *(e for hole in holes for e in hole[2:])])
    quads = []
    for low, high in pairwise(y):
        for left, right in pairwise(x):
            middle = (left + right) / 2, (low + high) / 2
            if not any(h[0] < middle[0] < h[1] and h[2] < middle[1] < h[3] for h in holes):
                quads.append(overhead(np.array([left, right, low, high]), height))
    return quads


def rectangles_on(room: Room, side: Side, rectangles: np.ndarray) -> np.ndarray:
    """Corners (rectangle, 4, 3) of rectangles on a side, fronts inward, in the room's frame [m].

    Each row of `rectangles` (rectangle, 4) is left, right, bottom and top from the side's foot [m].
    """
    foot, along = side_of(room, side)
    along = along / np.linalg.norm(along)
    quads = [_upright(foot, along, *edges) for edges in rectangles]
    return np.reshape(quads, (-1, 4, 3))


def origin(case: Case) -> np.ndarray:
    """Origin of the traced frame in the case's coordinates, shape (3,) [m].

    With a room it is the room's corner, 0. A model, and sensors under the free sky, may have the
    coordinates of a map: there it is the lowest corner of the model's rooms, or the sensors', in
    whole metres.
    """
    if case.room is not None:
        return np.zeros(3)
    near = near_bounds(case.building)
    if near is not None:
        return np.floor(near[0])
    return np.floor(case.sensors.corner) if isinstance(case.sensors, Sensors) else np.zeros(3)


@lru_cache(maxsize=8)
def near_bounds(model: Model, degrees: float = 0.0) -> np.ndarray | None:
    """Bounds (2, 3) [m] of a model without its context, turned; None where nothing else is left."""
    near = [layer.quads for layer in model.layers if layer.role != "context"]
    if not near:
        return None
    turned = (quads @ turn(degrees).T if degrees else quads for quads in near)
    ends = np.array([(quads.min(axis=(0, 1)), quads.max(axis=(0, 1))) for quads in turned])
    return np.array([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def recentred(case: Case) -> Case:
    """Return the case with its coordinates relative to its `origin`.

    Mitsuba computes in single precision and starts rays off a surface by 9e-5 of the largest
    coordinate: 400 m at the northing of Rome. Coordinates near 0 keep this distance small.
    """
    start = origin(case)
    if not start.any():
        return case

    def near(point: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(float(v) for v in np.subtract(point, start))

    components = {}
    for name, c in case.components.items():
        if isinstance(c, MeshComponent):  # without a room there is nothing else
            ports = tuple(tuple(near(corner) for corner in port) for port in c.ports)
            moved = {"position": near(c.position), "ports": ports}
            components[name] = c.model_copy(update=moved)
    pieces = [piece.model_copy(update={"corner": near(piece.corner)}) for piece in case.furniture]
    sensors = case.sensors
    if isinstance(sensors, Sensors):
        sensors = sensors.model_copy(update={"corner": near(sensors.corner)})
    return case.with_tables(sensors=sensors, furniture=tuple(pieces), components=components)


def in_file(case: Case, points: np.ndarray) -> np.ndarray:
    """Points (…, 3) [m] of the traced frame in the coordinates of the case's or model's file."""
    return np.asarray(points @ rotation(case) + origin(case))


def given_points(points: ArrayLike, source: Path | str) -> np.ndarray:
    """Points [m] that a user gives, shape (point, 3); one by itself is a row.

    Errors name the `source` of the points.

    Raises
    ------
    InputError
        There is none, or what is given is no finite x, y and z of each.
    """
    try:
        rows = np.atleast_2d(np.asarray(points, float))
    except (TypeError, ValueError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or not np.isfinite(rows).all():
        got = shortened(" ".join(str(points).split()))
        raise InputError(source, "points", got, "give x, y and z of each in metres")
    return rows


def around(case: Case) -> str:
    """Origin of a recentred case's coordinates, in words for messages."""
    if case.room is not None:
        return "the room's corner"
    return "the model's corner" if case.building.layers else "the sensors"


def rotation(case: Case) -> np.ndarray:
    """Matrix (3, 3) from the frame of the room, or of the model, to the world frame."""
    return turn(clockwise(case))


def clockwise(case: Case) -> float:
    """Angle [°], clockwise as seen from above, by which the world frame has the case turned."""
    return case.room.rotation if case.room else -case.building.north


def heading(case: Case) -> float:
    """Angle [°], clockwise, by which most walls stand askew to the world's axes, −45 to 45."""
    angle = clockwise(case) + (0.0 if case.room else _heading_of_walls(case.building))
    angle -= 90 * round(angle / 90)
    return angle if abs(angle) > STRAIGHT else 0.0


@lru_cache(maxsize=8)
def _heading_of_walls(model: Model) -> float:
    """Angle [°], clockwise, by which most of a model's walls stand askew to its own axes.

    Upright surfaces but those of its context count by their areas.
    """
    near = [layer.quads for layer in model.layers if layer.role != "context"]
    quads = np.concatenate([np.zeros((0, 4, 3)), *near])
    n = normals(quads)
    upright = np.abs(n[:, 2]) < UPRIGHT
    if not upright.any():
        return 0.0
    n, area = n[upright], areas(quads[upright])
    angle = -np.degrees(np.arctan2(n[:, 1], n[:, 0])) % 90
    bins = round(90 / STEP)
    whole = np.bincount((angle / STEP).astype(int) % bins, area, bins)
    around = whole + np.roll(whole, 1) + np.roll(whole, -1)
    best = (np.argmax(around) + 0.5) * STEP
    beside = (angle - best + 45) % 90 - 45
    like = np.abs(beside) <= 1.5 * STEP
    return float(best + np.average(beside[like], weights=area[like]))


def turn(degrees: float) -> np.ndarray:
    """Matrix (3, 3) that turns about the vertical, clockwise as seen from above."""
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
