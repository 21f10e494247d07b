"""Room, façade, components and furniture of a case as surfaces, and these as Mitsuba scenes.

`surfaces` is plain geometry (NumPy quadrilaterals) that tests and exporters can read; `build` makes
the Mitsuba scenes that transport traces. Panes face the room: their normals point inward.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import mitsuba as mi
import numpy as np

from drcmitsuba.case import BsdfMaterial, Case, DiffuserMaterial, Facade, GlazingMaterial
from drcmitsuba.components import Placed, inside, place
from drcmitsuba.coplanar import settled
from drcmitsuba.errors import InputError
from drcmitsuba.geometry import (
    SIDES,
    Port,
    Surface,
    boxes,
    ceiling,
    origin,
    quad,
    recentred,
    rotation,
    side_of,
    wall,
)
from drcmitsuba.materials import Lambertian, SurfaceMaterial, bsdf, film, lets_through
from drcmitsuba.reach import reaches_in
from drcmitsuba.scope import Scope
from drcmitsuba.tally import Tally

State = Literal["open", "shaded"]
FULL = Scope()
"""All that a scene holds."""


@dataclass(frozen=True)
class Part:
    """Surfaces of one BSDF that photons are to tell apart.

    Parameters
    ----------
    name : str
    bsdf : mi.BSDF
    material : SurfaceMaterial
    component : str
    quads : np.ndarray, shape (quad, 4, 3)
    closed : bool
        Nothing sees their backs.
    """

    name: str
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
    narrowest : float
        Least width or height of a pane or hole that lets straight light in [m].
    spares : bool
        Whether shadow rays that pass no opening are spared.
    """

    size: np.ndarray
    turn: np.ndarray
    openings: np.ndarray
    narrowest: float = np.inf
    spares: bool = True

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
        All surfaces; of an `outline` this and the next two are None.
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
    scope : Scope
        What is followed.
    tally : Tally
        Counts the rays.
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
    scope: Scope = FULL
    tally: Tally = field(default_factory=Tally)

    @property
    def followed(self) -> bool:
        """Whether photons are traced."""
        return bool(self.ports) or self.scope.pane_to_pane

    @property
    def low(self) -> np.ndarray:
        """Lower bound of all surfaces [m]."""
        return self.corners.min(axis=0)

    @property
    def high(self) -> np.ndarray:
        """Upper bound of all surfaces [m]."""
        return self.corners.max(axis=0)


def surfaces(case: Case, state: State = "open", scope: Scope = FULL) -> list[Surface]:
    """List the surfaces of a case in the world frame, about the case's `geometry.origin`.

    Parameters
    ----------
    case : Case
    state : {'open', 'shaded'}
        Shaded: the shade's material stands in place of every clear pane and open hole; components
        stay uncovered.
    scope : Scope
        Black sheets stand for the panes that are out of it; obstructions are left out.

    Returns
    -------
    list of Surface
    """
    case = recentred(case)
    return _surfaces(case, state, place(case), scope)


def _surfaces(
    case: Case, state: State, components: tuple[Placed, ...], scope: Scope
) -> list[Surface]:
    """`surfaces`, with the components of the case."""
    parts: list[tuple[str, SurfaceMaterial, list[np.ndarray]]] = []
    turn, room = rotation(case), case.room
    if room is not None:
        x, y, _ = np.diag(room.size)
        parts.append(("floor", Lambertian(room.floor), [quad(np.zeros(3), x, y)]))
        holes = [c.hole for c in components if c.hole is not None]
        parts.append(("ceiling", Lambertian(room.ceiling), ceiling(room, holes)))
        for side in SIDES:
            facade = case.facade.get(side, Facade())
            opaque, frame, panes = wall(room, side, facade)
            parts.append((f"wall {side}", Lambertian(room.walls), opaque))
            parts.append((f"frame {side}", Lambertian(facade.frame_reflectance), frame))
            for name, quads in panes.items():
                material = _pane_material(case, name, state, scope)
                if material is not None:
                    parts.append((f"{name} {side}", material, quads))
    made = [Surface(name, m, np.array(quads)) for name, m, quads in parts if quads]
    for piece, all_faces in settled(case):
        faces = all_faces if scope.obstructions else all_faces[reaches_in(case, all_faces)]
        if len(faces) == 0:
            continue
        is_body, m = piece.size[2] > 0, Lambertian(piece.reflectance)
        made.append(Surface(piece.name, m, faces, closed=is_body))
    made += [surface for component in components for surface in component.surfaces]
    return [replace(surface, quads=surface.quads @ turn.T) for surface in made]


def _pane_material(case: Case, name: str, state: State, scope: Scope) -> SurfaceMaterial | None:
    """Material of a façade strip in a state; None for an open hole, or one for a component."""
    material = case.materials.get(name)
    clear = name == "open" or isinstance(material, GlazingMaterial)
    if state == "shaded" and case.shading is not None and clear:
        clear, material = False, case.materials[case.shading.material]
    if isinstance(material, BsdfMaterial) and scope.straight_through is not None:
        mode = "on" if scope.straight_through else "off"
        material = material.model_copy(update={"straight_through": mode})
    out = (
        (clear and not scope.clear_panes)
        or (isinstance(material, DiffuserMaterial) and not scope.scattering_panes)
        or (isinstance(material, BsdfMaterial) and not scope.films)
    )
    return Lambertian(0.0) if out else material


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
    made = _outlined(surfaces, lambda m: mi.load_dict(bsdf(m, channel)), enclosure, ports)
    meshes = [quad_mesh(part.name, part.quads, part.bsdf) for part in made.parts]

    def scene(keep: Any) -> mi.Scene:
        shapes = {
            f"shape{i}": mesh
            for i, (part, mesh) in enumerate(zip(made.parts, meshes, strict=True))
            if keep(part)
        }
        return mi.load_dict({"type": "scene", **shapes}, optimize=False)

    def is_clear(part: Part) -> bool:
        return lets_through(part.material)

    full, panes = scene(lambda part: True), any(map(is_clear, made.parts))
    return replace(
        made,
        full=full,
        opaque=scene(lambda part: not is_clear(part)) if panes else full,
        clear=scene(is_clear) if panes else None,
    )


def _outlined(
    surfaces: list[Surface], loaded: Callable[[SurfaceMaterial], Any],
    enclosure: Enclosure | None, ports: tuple[Port, ...],
) -> Scene:  # fmt: skip
    """All of a scene but what Mitsuba traces."""
    groups: dict[tuple[str, SurfaceMaterial, bool], list[Surface]] = {}
    for surface in surfaces:
        key = (surface.component, surface.material, surface.closed)
        groups.setdefault(key, []).append(surface)
    # One mesh a material and component: tracing slows with the number of shapes.
    parts = []
    for (component, m, closed), group in groups.items():
        quads = np.concatenate([s.quads for s in group])
        parts.append(Part(group[0].name, loaded(m), m, component, quads, closed))
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
        full=None,
        opaque=None,
        clear=None,
        scattering=scattering,
        films=films,
        corners=points,
        enclosure=enclosure,
        parts=tuple(parts),
        ports=ports,
    )


def load(case: Case, state: State = "open", channel: int = 0, scope: Scope = FULL) -> Scene:
    """Build the scene of a case in a state of its shade, for one colour channel.

    Channel −1 is luminance.
    """
    parts = _parts_of(case, state, scope)
    return replace(build(parts[0], channel, *parts[1:]), scope=scope)


def outline(
    case: Case, state: State, scope: Scope, loaded: Callable[[SurfaceMaterial], Any]
) -> Scene:
    """`load` without what Mitsuba traces: geometry, panes, ports, and `loaded` materials."""
    surfaces, enclosure, ports = _parts_of(case, state, scope)
    return replace(_outlined(surfaces, loaded, enclosure, ports), scope=scope)


def _parts_of(
    case: Case, state: State, scope: Scope
) -> tuple[list[Surface], Enclosure | None, tuple[Port, ...]]:
    """Surfaces, enclosure and ports of a case, about its `geometry.origin`."""
    case = recentred(case)
    components, turn = place(case), rotation(case)
    ports: tuple[Port, ...] = ()
    if scope.components:
        ports = tuple(replace(p, quad=p.quad @ turn.T) for c in components for p in c.ports)
    found = _surfaces(case, state, components, scope)
    return found, _enclosure(case, state, components, scope), ports


def _enclosure(
    case: Case, state: State, components: tuple[Placed, ...], scope: Scope
) -> Enclosure | None:
    """The room with a rectangle around all openings of each façade, and holes of the ceiling."""
    if case.room is None:
        return None
    openings, narrowest = [], np.inf
    for side, facade in case.facade.items():
        clear = [
            strip for strip in facade.strips if _is_opening(case, strip.material, state, scope)
        ]
        if clear:
            foot, along = side_of(case.room, side)
            inside = [i for i in range(facade.segments) if any(s.covers(i) for s in clear)]
            left, right = inside[0] / facade.segments, (inside[-1] + 1) / facade.segments
            bottom, top = min(s.bottom for s in clear), max(s.top for s in clear)
            start = foot + left * along + [0, 0, bottom]
            openings.append(quad(start, [0, 0, top - bottom], (right - left) * along))
            segment = float(np.linalg.norm(along)) / facade.segments
            sizes = (min(segment, s.top - s.bottom) - facade.frame for s in clear)
            narrowest = min(narrowest, *sizes)
    for component in components:
        if component.hole is not None and component.is_open:
            x0, x1, y0, y1 = component.hole
            corner = [x0, y0, case.room.size[2]]
            openings.append(quad(corner, [0, y1 - y0, 0], [x1 - x0, 0, 0]))
    turn = rotation(case)
    quads = np.reshape(openings, (-1, 4, 3)) @ turn.T
    return Enclosure(np.array(case.room.size), turn, quads, narrowest, scope.enclosed)


def _is_opening(case: Case, name: str, state: State, scope: Scope) -> bool:
    """Whether straight light may come in by a strip of a façade; structures have gaps."""
    if name == "wall":
        return False
    material = _pane_material(case, name, state, scope)
    return material is None or lets_through(material)


def sensor_points(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of the sensors in the world frame, shape (sensor, 3) each.

    Positions count from the case's `geometry.origin`, as all that is traced.

    Raises
    ------
    InputError
        A sensor lies outside the room, inside furniture, or within 1 mm of a surface.
    """
    case, start = recentred(case), origin(case)
    grid = case.sensors
    x = grid.corner[0] + (np.arange(grid.count[0]) + 0.5) * grid.spacing
    y = grid.corner[1] + (np.arange(grid.count[1]) + 0.5) * grid.spacing
    points = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
    points = np.column_stack([points, np.full(len(points), grid.corner[2])])
    _check_sensors(case, points, start)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return points @ rotation(case).T, normals


def _check_sensors(case: Case, points: np.ndarray, start: np.ndarray) -> None:
    """Refuse sensors that see nothing because they stand in or on something.

    `start` is what the user's coordinates have in addition.
    """
    margin = 1e-3 - 1e-9  # 1 mm itself is fine, whatever a sum of decimals rounds to

    def refuse(bad: Any, where: str) -> None:
        if bad.any():
            i = int(np.argmax(bad))
            place = ", ".join(f"{round(v, 4):.10g}" for v in points[i] + start)
            more = f" ({int(bad.sum())} in all)" if bad.sum() > 1 else ""
            raise InputError(
                case.source, "sensors", f"sensor {i} at ({place}) lies {where}{more}",
                "move it at least 1 mm off every surface",
            )  # fmt: skip

    if case.room is not None:
        size = np.array(case.room.size)
        outside = (points <= margin) | (points >= size - margin)
        refuse(outside.any(axis=1), "in, on or beyond a wall of the room")
    for piece in case.furniture:
        for corner, size in boxes(piece):
            near = (points > corner - margin) & (points < corner + size + margin)
            refuse(near.all(axis=1), f"in or on {piece.name!r}")
    for name, within in inside(case, points):
        refuse(within, f"in component {name!r}")


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
