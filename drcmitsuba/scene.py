"""Room, façade and furniture of a case as surfaces, and these as Mitsuba scenes.

`surfaces` is plain geometry (NumPy quadrilaterals) that tests and exporters can read; `build` makes
the Mitsuba scenes that transport traces. Panes face the room: their normals point inward.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import mitsuba as mi
import numpy as np

from drcmitsuba.case import (
    BsdfMaterial,
    Case,
    DiffuserMaterial,
    Facade,
    Furniture,
    GlazingMaterial,
    Room,
    Side,
)
from drcmitsuba.errors import InputError
from drcmitsuba.materials import Lambertian, SurfaceMaterial, bsdf, film, lets_through

State = Literal["open", "shaded"]


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


@dataclass(frozen=True)
class Part:
    """Surfaces of one BSDF that photons are to tell apart.

    Parameters
    ----------
    bsdf : mi.BSDF
    material : SurfaceMaterial
    component : str
    quads : np.ndarray, shape (quad, 4, 3)
    closed : bool
        Nothing sees their backs.
    """

    bsdf: Any
    material: SurfaceMaterial
    component: str
    quads: np.ndarray
    closed: bool


@dataclass(frozen=True)
class ScatteringPanes:
    """Quadrilaterals (pane, 4, 3) of one diffusing material; the front faces the room."""

    quads: np.ndarray
    transmittance: float
    reflectance: float


@dataclass(frozen=True)
class FilmPanes:
    """Quadrilaterals (pane, 4, 3) of one measured material; the front faces the room."""

    quads: np.ndarray
    bsdf: Any
    """The plugin `tensor_tree` or `klems`."""


@dataclass(frozen=True)
class Enclosure:
    """A room that straight light can only enter through known openings.

    Parameters
    ----------
    size : np.ndarray, shape (3,)
        Extent of the room in its own frame [m].
    turn : np.ndarray, shape (3, 3)
        Matrix from the room's frame to the world's.
    openings : np.ndarray, shape (opening, 4, 3)
        Rectangles in the walls, fronts inward, world frame [m]: what lies outside them is closed.
        None at all where every opening is covered by panes that scatter.
    """

    size: np.ndarray
    turn: np.ndarray
    openings: np.ndarray

    def contains(self, points: mi.Float) -> bool:
        """Whether every point (three numbers each, world frame) lies in the room."""
        p = points.numpy().reshape(-1, 3) @ self.turn
        return bool(((p > -1e-5) & (p < self.size + 1e-5)).all())


@dataclass(frozen=True)
class Scene:
    """What transport traces.

    Parameters
    ----------
    full : mi.Scene
        All surfaces.
    opaque : mi.Scene
        Without the panes that let light straight through: any hit is a shadow.
    clear : mi.Scene or None
        Only those panes; None where there are none.
    scattering : tuple of ScatteringPanes
        Panes that scatter evenly, for the deposit by points on them.
    films : tuple of FilmPanes
        Panes that scatter as measured.
    corners : np.ndarray, shape (corner, 3)
        Of all surfaces [m].
    enclosure : Enclosure or None
        The room, where there is one.
    parts : tuple of Part
        All surfaces, by BSDF.
    ports : tuple of Port
        Where photons start.
    """

    full: mi.Scene
    opaque: mi.Scene
    clear: mi.Scene | None
    scattering: tuple[ScatteringPanes, ...]
    films: tuple[FilmPanes, ...]
    corners: np.ndarray
    enclosure: Enclosure | None = None
    parts: tuple[Part, ...] = ()
    ports: tuple[Port, ...] = ()

    @property
    def low(self) -> np.ndarray:
        """Lower bound of all surfaces [m]."""
        return self.corners.min(axis=0)

    @property
    def high(self) -> np.ndarray:
        """Upper bound of all surfaces [m]."""
        return self.corners.max(axis=0)


def _quad(corner: Any, u: Any, v: Any) -> np.ndarray:
    """Quadrilateral with its front in the direction u × v."""
    c, u, v = (np.asarray(x, float) for x in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def _box(corner: np.ndarray, size: np.ndarray) -> list[np.ndarray]:
    """Faces of a box, fronts outward; a box without height is one plate."""
    x, y, z = np.diag(size)
    top = _quad(corner + z, x, y)
    if size[2] == 0:
        return [top]
    return [
        top,
        _quad(corner, y, x),
        _quad(corner, x, z),
        _quad(corner + x, y, z),
        _quad(corner + x + y, -x, z),
        _quad(corner + y, -y, z),
    ]


def boxes(furniture: Furniture) -> list[tuple[np.ndarray, np.ndarray]]:
    """Corner and size of every repetition of a piece of furniture."""
    size = np.array(furniture.size)
    return [
        (np.array(furniture.corner) + [i * furniture.step[0], j * furniture.step[1], 0], size)
        for i in range(furniture.count[0])
        for j in range(furniture.count[1])
    ]


def _side(room: Room, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """Foot and direction of a wall, such that direction × up points out of the room."""
    width, depth, _ = room.size
    return {
        "south": (np.zeros(3), np.array([width, 0.0, 0.0])),
        "east": (np.array([width, 0.0, 0.0]), np.array([0.0, depth, 0.0])),
        "north": (np.array([width, depth, 0.0]), np.array([-width, 0.0, 0.0])),
        "west": (np.array([0.0, depth, 0.0]), np.array([0.0, -depth, 0.0])),
    }[side]


def _wall(
    room: Room, side: Side, facade: Facade
) -> tuple[list[np.ndarray], list[np.ndarray], dict[str, list[np.ndarray]]]:
    """Cut a side of the room into wall, frame and panes by material, fronts inward."""
    foot, along = _side(room, side)
    length = float(np.linalg.norm(along))
    along = along / length
    up = np.array([0.0, 0.0, 1.0])

    def rectangle(left: float, right: float, bottom: float, top: float) -> np.ndarray:
        start = foot + along * left + up * bottom
        return _quad(start, up * (top - bottom), along * (right - left))

    wall: list[np.ndarray] = []
    frame: list[np.ndarray] = []
    panes: dict[str, list[np.ndarray]] = {}
    segment, half = length / facade.segments, facade.frame / 2
    for column, strips in facade.columns():
        begin, end = column.start * segment, column.stop * segment
        top = 0.0
        for strip in strips:
            if strip.bottom > top:
                wall.append(rectangle(begin, end, top, strip.bottom))
            top = strip.top
            if strip.material == "wall":
                wall.append(rectangle(begin, end, strip.bottom, strip.top))
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
            wall.append(rectangle(begin, end, top, room.size[2]))
    return wall, frame, panes


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
    foot, along = _side(case.room, side)
    along, up = along / np.linalg.norm(along), np.array([0.0, 0.0, 1.0])
    quads = [
        _quad(foot + along * left + up * bottom, up * (top - bottom), along * (right - left))
        for left, right, bottom, top in rectangles
    ]
    return np.reshape(quads, (-1, 4, 3)) @ rotation(case).T


def rotation(case: Case) -> np.ndarray:
    """Matrix that turns the room's frame into the world's."""
    angle = np.radians(case.room.rotation) if case.room else 0.0
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def surfaces(case: Case, state: State = "open") -> list[Surface]:
    """List the surfaces of a case in the world frame.

    Parameters
    ----------
    case : Case
    state : {'open', 'shaded'}
        Shaded: the shade's material stands in place of every clear pane and open hole.

    Returns
    -------
    list of Surface
    """
    parts: list[tuple[str, SurfaceMaterial, list[np.ndarray]]] = []
    room = case.room
    if room is not None:
        x, y, z = np.diag(room.size)
        parts.append(("floor", Lambertian(room.floor), [_quad(np.zeros(3), x, y)]))
        parts.append(("ceiling", Lambertian(room.ceiling), [_quad(z, y, x)]))
        sides: tuple[Side, ...] = ("south", "east", "north", "west")
        for side in sides:
            facade = case.facade.get(side, Facade())
            wall, frame, panes = _wall(room, side, facade)
            parts.append((f"wall {side}", Lambertian(room.walls), wall))
            parts.append((f"frame {side}", Lambertian(facade.frame_reflectance), frame))
            for name, quads in panes.items():
                material = _pane_material(case, name, state)
                if material is not None:
                    parts.append((f"{name} {side}", material, quads))
    for piece in case.furniture:
        quads = [face for corner, size in boxes(piece) for face in _box(corner, size)]
        parts.append((piece.name, Lambertian(piece.reflectance), quads))
    turn = rotation(case)
    bodies = {piece.name for piece in case.furniture if piece.size[2] > 0}
    return [
        Surface(name, m, np.array(quads) @ turn.T, closed=name in bodies)
        for name, m, quads in parts
        if quads
    ]


def _pane_material(case: Case, name: str, state: State) -> SurfaceMaterial | None:
    """Material of a façade strip in a state; None for an open hole."""
    material = case.materials.get(name)
    covered = name == "open" or isinstance(material, GlazingMaterial)
    if state == "shaded" and case.shading is not None and covered:
        return case.materials[case.shading.material]
    return material


def mesh(name: str, vertices: np.ndarray, faces: np.ndarray, bsdf: mi.BSDF | None) -> mi.Mesh:
    """Triangle mesh of vertices (vertex, 3) and faces (face, 3)."""
    props = mi.Properties()
    if bsdf is not None:
        props["bsdf"] = bsdf
    made = mi.Mesh(name, vertex_count=len(vertices), face_count=len(faces), props=props)
    params = mi.traverse(made)
    params["vertex_positions"] = mi.Float(vertices.astype(np.float32).ravel())
    params["faces"] = mi.UInt32(faces.astype(np.uint32).ravel())
    params.update()
    return made


def quad_mesh(name: str, quads: np.ndarray, bsdf: mi.BSDF | None = None) -> mi.Mesh:
    """One mesh of quadrilaterals (quad, 4, 3); quad i is triangles 2i and 2i + 1."""
    corner = np.arange(len(quads))[:, None] * 4
    faces = np.concatenate([corner + [0, 1, 2], corner + [0, 2, 3]], axis=1)
    return mesh(name, quads.reshape(-1, 3), faces.reshape(-1, 3), bsdf)


def build(
    surfaces: list[Surface], channel: int = 0, enclosure: Enclosure | None = None,
    ports: tuple[Port, ...] = (),
) -> Scene:  # fmt: skip
    """Make the Mitsuba scenes of a list of surfaces.

    Parameters
    ----------
    surfaces : list of Surface
    channel : int
        Colour channel that is simulated.
    enclosure : Enclosure, optional
        The room, where there is one; spares shadow rays that cannot leave it.
    ports : tuple of Port
        Where photons start.

    Returns
    -------
    Scene
    """
    groups: dict[tuple[str, SurfaceMaterial, bool], list[Surface]] = {}
    for surface in surfaces:
        key = (surface.component, surface.material, surface.closed)
        groups.setdefault(key, []).append(surface)
    # One mesh a material and component: tracing slows with the number of shapes.
    parts, meshes = [], []
    for (component, m, closed), group in groups.items():
        quads = np.concatenate([s.quads for s in group])
        parts.append(Part(mi.load_dict(bsdf(m, channel)), m, component, quads, closed))
        meshes.append(quad_mesh(group[0].name, quads, parts[-1].bsdf))

    def scene(keep: Any) -> mi.Scene:
        shapes = {
            f"shape{i}": mesh
            for i, (part, mesh) in enumerate(zip(parts, meshes, strict=True))
            if keep(part)
        }
        return mi.load_dict({"type": "scene", **shapes}, optimize=False)

    def is_clear(part: Part) -> bool:
        return lets_through(part.material)

    scattering = tuple(
        ScatteringPanes(p.quads, p.material.transmittance, p.material.reflectance)
        for p in parts
        if isinstance(p.material, DiffuserMaterial) and not p.component
    )
    films = tuple(
        FilmPanes(p.quads, p.bsdf)
        for p in parts
        if isinstance(p.material, BsdfMaterial) and not p.component
    )
    points = np.concatenate([s.quads.reshape(-1, 3) for s in surfaces] or [np.zeros((1, 3))])
    return Scene(
        full=scene(lambda part: True),
        opaque=scene(lambda part: not is_clear(part)),
        clear=scene(is_clear) if any(map(is_clear, parts)) else None,
        scattering=scattering,
        films=films,
        corners=points,
        enclosure=enclosure,
        parts=tuple(parts),
        ports=ports,
    )


def load(case: Case, state: State = "open", channel: int = 0) -> Scene:
    """Build the scene of a case in a state of its shade, for one colour channel."""
    return build(surfaces(case, state), channel, _enclosure(case, state))


def _enclosure(case: Case, state: State) -> Enclosure | None:
    """The room with a rectangle around all openings of each façade that are clear or open."""
    if case.room is None:
        return None
    openings = []
    for side, facade in case.facade.items():
        clear = [strip for strip in facade.strips if _is_opening(case, strip.material, state)]
        if clear:
            foot, along = _side(case.room, side)
            inside = [i for i in range(facade.segments) if any(s.covers(i) for s in clear)]
            left, right = inside[0] / facade.segments, (inside[-1] + 1) / facade.segments
            bottom, top = min(s.bottom for s in clear), max(s.top for s in clear)
            start = foot + left * along + [0, 0, bottom]
            openings.append(_quad(start, [0, 0, top - bottom], (right - left) * along))
    turn = rotation(case)
    return Enclosure(np.array(case.room.size), turn, np.reshape(openings, (-1, 4, 3)) @ turn.T)


def _is_opening(case: Case, name: str, state: State) -> bool:
    """Whether straight light comes in by a strip of a façade."""
    if name == "wall":
        return False
    material = _pane_material(case, name, state)
    return material is None or lets_through(material)


def sensor_points(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of the sensors in the world frame, shape (sensor, 3) each.

    Raises
    ------
    InputError
        A sensor lies outside the room, inside furniture, or within 1 mm of a surface.
    """
    grid = case.sensors
    x = grid.corner[0] + (np.arange(grid.count[0]) + 0.5) * grid.spacing
    y = grid.corner[1] + (np.arange(grid.count[1]) + 0.5) * grid.spacing
    points = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
    points = np.column_stack([points, np.full(len(points), grid.corner[2])])
    _check_sensors(case, points)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return points @ rotation(case).T, normals


def _check_sensors(case: Case, points: np.ndarray) -> None:
    """Refuse sensors that see nothing because they stand in or on something."""
    margin = 1e-3

    def refuse(bad: Any, where: str) -> None:
        if bad.any():
            i = int(np.argmax(bad))
            place = ", ".join(f"{v:.4g}" for v in points[i])
            more = f" ({int(bad.sum())} in all)" if bad.sum() > 1 else ""
            raise InputError(
                case.source, "sensors", f"sensor {i} at ({place}) lies {where}{more}",
                f"move it at least {margin * 1000:g} mm off every surface",
            )  # fmt: skip

    if case.room is not None:
        size = np.array(case.room.size)
        outside = (points <= margin) | (points >= size - margin)
        refuse(outside.any(axis=1), "in, on or beyond a wall of the room")
    for piece in case.furniture:
        for corner, size in boxes(piece):
            near = (points > corner - margin) & (points < corner + size + margin)
            refuse(near.all(axis=1), f"in or on {piece.name!r}")


def is_coloured(case: Case) -> bool:
    """Whether any reflectance differs between colour channels, or a film is coloured."""
    values = [f.reflectance for f in case.furniture]
    if case.room is not None:
        values += [case.room.floor, case.room.ceiling, case.room.walls]
    values += [f.frame_reflectance for f in case.facade.values()]
    films = [m for m in case.materials.values() if isinstance(m, BsdfMaterial)]
    return any(isinstance(v, tuple) and len(set(v)) > 1 for v in values) or any(
        film(m.file).coloured for m in films
    )
