"""Room, façade, components and furniture of a case as plain geometry: NumPy quadrilaterals.

Panes face the room: their normals point inward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, Lambertian, SurfaceMaterial
from drcmitsuba.scene.components import PlacedComponent, place
from drcmitsuba.scene.coplanar import settled
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.geometry import (
    SIDES,
    Port,
    Surface,
    ceiling,
    origin,
    overhead,
    quad,
    recentred,
    rotation,
    side_of,
    wall,
)
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.sun_visibility import reaches_in

State = Literal["open", "shaded"]


@dataclass(frozen=True)
class Enclosure:
    """A room that straight light can only enter through known openings."""

    size: np.ndarray
    """Extent of the room in its own frame [m], shape (3,)."""
    turn: np.ndarray
    """Matrix from the room's frame to the world's, shape (3, 3)."""
    openings: np.ndarray
    """Rectangles in the walls, fronts inward, world frame [m], shape (opening, 4, 3): everything
    outside them is closed. The array is empty where scattering panes cover every opening."""
    narrowest: float = np.inf
    """Least width or height of a pane or hole that lets straight light in [m]."""
    spares: bool = True
    """Whether shadow rays that pass no opening are left out."""
    is_box: bool = True
    """Whether the walls of a box bound the room; the rooms of a model have any shape."""

    def contains(self, points: mi.Float) -> bool:
        """Whether every point (three numbers each, world frame) lies in the room."""
        p = points.numpy().reshape(-1, 3) @ self.turn
        return bool(((p > -1e-5) & (p < self.size + 1e-5)).all())


def surfaces_of(
    case: Case, state: State = "open", effects: EnabledEffects = ALL_EFFECTS
) -> list[Surface]:
    """List the surfaces of a case in the world frame [m], relative to its `geometry.origin`.

    In the state "shaded" the shade's material stands in place of every clear pane and open hole, so
    its transmittance has to be that of glass and shade together. Components stay uncovered. Panes
    of a disabled kind become black sheets; disabled obstructions are left out.
    """
    return geometry_of(case, state, effects)[0]


def geometry_of(
    case: Case, state: State, effects: EnabledEffects
) -> tuple[list[Surface], Enclosure | None, tuple[Port, ...]]:
    """Surfaces, as `surfaces_of`; the enclosure of a room; the ports of enabled components."""
    case = recentred(case)
    components, turn = place(case), rotation(case)
    ports: tuple[Port, ...] = ()
    if effects.components:
        ports = tuple(replace(p, quad=p.quad @ turn.T) for c in components for p in c.ports)
    surfaces = _surfaces(case, state, components, effects)
    return surfaces, _enclosure(case, state, components, effects), ports


def _surfaces(
    case: Case, state: State, components: tuple[PlacedComponent, ...], effects: EnabledEffects
) -> list[Surface]:
    """Surfaces of a case and of its placed components, in the world frame."""
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
                material = _pane_material(case, name, state, effects)
                if material is not None:
                    parts.append((f"{name} {side}", material, quads))
    made = [Surface(name, m, np.array(quads)) for name, m, quads in parts if quads]
    made += model_surfaces(case, state, effects)
    for piece, all_faces in settled(case):
        faces = all_faces if effects.obstructions else all_faces[reaches_in(case, all_faces)]
        if len(faces) == 0:
            continue
        is_body, m = piece.size[2] > 0, Lambertian(piece.reflectance)
        made.append(Surface(piece.name, m, faces, closed=is_body))
    made += [surface for component in components for surface in component.surfaces]
    return [replace(surface, quads=surface.quads @ turn.T) for surface in made]


def model_surfaces(case: Case, state: State, effects: EnabledEffects) -> list[Surface]:
    """Surfaces of a case's model, relative to the case's `geometry.origin`, before rotation.

    Mirrors and clear solids are components.
    """
    made, start = [], origin(case)
    for layer, quads in zip(case.building.layers, panes_of_model(case.building).quads, strict=True):
        material: SurfaceMaterial | None = layer.material
        if layer.deviates:  # a component
            continue
        if layer.role == "pane":
            material = _pane_material(case, layer.name, state, effects)
        elif layer.role == "context" and not effects.obstructions:
            continue
        if material is not None:
            made.append(Surface(layer.name, material, quads - start))
    return made


def bounds_of_rooms(case: Case) -> np.ndarray | None:
    """Bounds of a model without its context, relative to the origin, world frame [m], (2, 3)."""
    rooms = [x.quads.reshape(-1, 3) for x in case.building.layers if x.role != "context"]
    if not rooms:
        return None
    corners = (np.concatenate(rooms) - origin(case)) @ rotation(case).T
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def _enclosure_of_model(case: Case, state: State, effects: EnabledEffects) -> Enclosure | None:
    """Enclosure with the rectangles around the panes that let straight light in.

    Rays that miss the panes are traced, too: no shape tells which points lie in a room.
    """
    assert case.model is not None
    if case.model.leaks == "allow":
        return None
    layers, panes, turn = case.building.layers, panes_of_model(case.building), rotation(case)
    clear = [_is_opening(case, layers[i].name, state, effects) for i in panes.layer]
    lit = panes.outside & np.array(clear, bool)
    bounds = bounds_of_rooms(case)
    assert bounds is not None
    size = bounds[1] - bounds[0]
    openings = (panes.frame[lit] - origin(case)) @ turn.T
    narrowest = float(panes.width[lit].min(initial=np.inf))
    return Enclosure(size, turn, openings, narrowest, spares=False, is_box=False)


def _pane_material(
    case: Case, name: str, state: State, effects: EnabledEffects
) -> SurfaceMaterial | None:
    """Material of a façade strip in a state; None where the strip is open or holds a component."""
    material = case.materials.get(name)
    clear = case.is_clear(name)
    if state == "shaded" and case.shading is not None and clear:
        clear, material = False, case.materials[case.shading.material]
    if isinstance(material, BsdfMaterial) and effects.straight_through is not None:
        mode = "on" if effects.straight_through else "off"
        material = material.model_copy(update={"straight_through": mode})
    out = (
        (clear and not effects.clear_panes)
        or (isinstance(material, DiffuserMaterial) and not effects.scattering_panes)
        or (isinstance(material, BsdfMaterial) and not effects.films)
    )
    return Lambertian(0.0) if out else material


def _enclosure(
    case: Case, state: State, components: tuple[PlacedComponent, ...], effects: EnabledEffects
) -> Enclosure | None:
    """Enclosure with a rectangle around the openings of each façade, and the ceiling's holes."""
    if case.building.layers:
        return _enclosure_of_model(case, state, effects)
    if case.room is None:
        return None
    openings, narrowest = [], np.inf
    for side, facade in case.facade.items():
        clear = [s for s in facade.strips if _is_opening(case, s.material, state, effects)]
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
            openings.append(overhead(component.hole, case.room.size[2]))
    turn = rotation(case)
    quads = np.reshape(openings, (-1, 4, 3)) @ turn.T
    return Enclosure(np.array(case.room.size), turn, quads, narrowest, effects.enclosed)


def _is_opening(case: Case, name: str, state: State, effects: EnabledEffects) -> bool:
    """Whether straight light may enter by a strip of a façade; a structure's gaps let it in."""
    if name == "wall":
        return False
    material = _pane_material(case, name, state, effects)
    return material is None or lets_through(material)
