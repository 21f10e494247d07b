"""Room, façade, components and furniture of a case as plain geometry: NumPy quadrilaterals.

Panes face the room: their normals point inward.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.model.materials import (
    Lambertian,
    PorousMaterial,
    SurfaceMaterial,
)
from drcmitsuba.scene.components import PlacedComponent, place
from drcmitsuba.scene.coplanar import settled
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.exits import exits_of
from drcmitsuba.scene.geometry import (
    SIDES,
    Port,
    Surface,
    ceiling,
    clockwise,
    heading,
    near_bounds,
    origin,
    overhead,
    quad,
    recentred,
    rotation,
    side_of,
    turn,
)
from drcmitsuba.scene.like_panes import NO_GROUP
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import PanesInState
from drcmitsuba.scene.panes_of_model import by_side, panes_of_model
from drcmitsuba.scene.sun_visibility import reaches_in

NEAR = 1e-5
"""Distance within which points lie in a face of the room [m]."""


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
    exits: np.ndarray | None = None
    """Rectangles that straight light passes on its way out of the rooms of a model, world frame
    [m], shape (exit, 4, 3); None for boxes, and where there are too many of them."""
    passages: np.ndarray | None = None
    """Quads that straight light passes on its way into or out of the rooms of a model, world frame
    [m], shape (quad, 4, 3); None for boxes."""
    exits_by_room: tuple[np.ndarray, ...] | None = None
    """Exits of every room, by its number from 1 on, fronts inward; None where no rooms are told
    apart, which then have all exits."""

    def may_hide(self, quads: np.ndarray) -> np.ndarray:
        """Whether quads (quad, 4, 3) may hide what points of a box see by its openings, (quad,).

        The faces of the box do not, save for what stands within an opening: light that passes an
        opening meets the box nowhere else.
        """
        corners, openings = quads @ self.turn, self.openings @ self.turn
        low, high = corners.min(axis=1), corners.max(axis=1)
        on_face = ((high < NEAR) | (low > self.size - NEAR)).any(axis=1)
        on_face &= ((low > -NEAR) & (high < self.size + NEAR)).all(axis=1)
        first, last = openings.min(axis=1), openings.max(axis=1)
        common = np.minimum(high[:, None], last) - np.maximum(low[:, None], first)
        within = (common > -NEAR).all(axis=2) & ((common > NEAR).sum(axis=2) > 1)
        return np.asarray(~on_face | within.any(axis=1))

    def contains(self, points: np.ndarray) -> bool:
        """Whether every point (point, 3) of the world frame lies in the room."""
        return bool(self.holds(points).all())

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether each point (point, 3) of the world frame lies in the room, bool, (point,)."""
        p = points @ self.turn
        return np.asarray(((p > -NEAR) & (p < self.size + NEAR)).all(axis=1))


def surfaces_of(
    case: Case, state: State = OPEN, effects: EnabledEffects = ALL_EFFECTS
) -> list[Surface]:
    """List the surfaces of a case in the world frame [m], relative to its `geometry.origin`.

    In a state of its group the state's material stands in place of a pane or an open hole, so
    its transmittance has to be that of glass and shade together. Components stay uncovered. Panes
    of a disabled kind become black sheets; disabled obstructions are left out.
    """
    return geometry_of(case, state, effects)[0]


def geometry_of(
    case: Case, state: State, effects: EnabledEffects, groups: PaneGroups | None = None
) -> tuple[list[Surface], Enclosure | None, tuple[Port, ...]]:
    """Surfaces, as `surfaces_of`; the enclosure of a room; the ports of enabled components.

    The state is one of `groups`, by default of those of the case.
    """
    case = recentred(case)
    components, turn = place(case), rotation(case)
    front = PanesInState.of(case, state, effects, groups)
    ports: tuple[Port, ...] = ()
    if effects.components:
        ports = tuple(replace(p, quad=p.quad @ turn.T) for c in components for p in c.ports)
    surfaces = _surfaces(front, components)
    if case.building.layers:
        return surfaces, _enclosure_of_model(front, surfaces), ports
    return surfaces, _enclosure(front, components), ports


def _surfaces(front: PanesInState, components: tuple[PlacedComponent, ...]) -> list[Surface]:
    """Surfaces of a case and of its placed components, in the world frame."""
    parts: list[tuple[str, SurfaceMaterial, list[np.ndarray]]] = []
    case, effects = front.case, front.effects
    turn, room = rotation(case), case.room
    if room is not None:
        x, y, _ = np.diag(room.size)
        parts.append(("floor", Lambertian(room.floor), [quad(np.zeros(3), x, y)]))
        holes = [c.hole for c in components if c.hole is not None]
        parts.append(("ceiling", Lambertian(room.ceiling), ceiling(room, holes)))
        for side in SIDES:
            facade = case.facade.get(side, Facade())
            opaque, frame, panes = front.wall(side)
            parts.append((f"wall {side}", Lambertian(room.walls), opaque))
            parts.append((f"frame {side}", Lambertian(facade.frame_reflectance), frame))
            for name, quads in panes.items():
                material = front.strip(name, side)
                if material is not None:
                    parts.append((f"{name} {side}", material, quads))
    made = [Surface(name, m, np.array(quads)) for name, m, quads in parts if quads]
    made += _model_surfaces(case, front)
    for piece, all_faces in settled(case):
        faces = all_faces if effects.obstructions else all_faces[reaches_in(case, all_faces)]
        if len(faces) == 0:
            continue
        is_body, m = piece.size[2] > 0, Lambertian(piece.reflectance)
        made.append(Surface(piece.name, m, faces, closed=is_body))
    made += [surface for component in components for surface in component.surfaces]
    return [replace(surface, quads=surface.quads @ turn.T) for surface in made]


def _model_surfaces(case: Case, front: PanesInState) -> list[Surface]:
    """Surfaces of a case's model, relative to the case's `geometry.origin`, before rotation.

    Mirrors and clear solids are components.
    """
    made, start, layers = [], origin(case), case.building.layers
    panes = panes_of_model(case.building)
    for i, quads in enumerate(panes.quads):
        layer = layers[i]
        if layer.deviates:  # a component
            continue
        if layer.role == "context" and not front.effects.obstructions:
            continue
        if front.index_of(layer.stands_in) != 0:
            continue
        groups = front.groups.of_quads[i]
        indoors = np.isin(layer.polygon, panes.polygon[~panes.outside & (panes.layer == i)])
        for group, within in sorted({*zip(groups.tolist(), indoors.tolist(), strict=True)}):
            is_grouped = group != NO_GROUP
            own = front.layer(layer, group) if is_grouped else front.rest(layer)
            for side, (material,) in by_side((own,), panes.turned[i]):
                mine = quads[(groups == group) & (indoors == within) & side] - start
                if material is not None and len(mine):
                    made.append(
                        Surface(layer.name, material, mine, behind=layer.behind, indoors=within)
                    )
    for layer in layers:
        index = front.index_of(layer.group)
        if index > 0 and front.follows_model(layer.group):
            shades = layer.states[min(index, len(layer.states) - 1)].shades
            made += [Surface(s.name, s.material, s.quads - start) for s in shades]
    return made


def bounds_of_rooms(case: Case) -> np.ndarray | None:
    """Bounds of a model without its context, along most of its walls [m], shape (2, 3).

    They are relative to the origin, in the world frame turned by `geometry.heading`.
    """
    askew = clockwise(case) - heading(case)
    bounds = near_bounds(case.building, askew)
    return None if bounds is None else bounds - turn(askew) @ origin(case)


def _enclosure_of_model(front: PanesInState, surfaces: list[Surface]) -> Enclosure | None:
    """Enclosure with the rectangles around the panes that let straight light in, and the exits."""
    case = front.case
    assert case.model is not None
    if case.model.leaks == "allow":
        return None
    layers, panes, turn = case.building.layers, panes_of_model(case.building), rotation(case)
    first = [int(np.argmax(layers[i].polygon == p)) for i, p in zip(panes.layer, panes.polygon,
             strict=True)]  # fmt: skip
    clear = [
        _is_opening(front.layer(layers[i], front.groups.of_quads[i][q]))
        for i, q in zip(panes.layer, first, strict=True)
    ]
    lit = panes.outside & np.array(clear, bool)
    bounds = bounds_of_rooms(case)
    assert bounds is not None
    size = bounds[1] - bounds[0]
    openings = (panes.frame[lit] - origin(case)) @ turn.T
    narrowest = float(panes.width[lit].min(initial=np.inf))
    holes = [
        quads[groups == group]
        for layer, quads, groups in zip(layers, panes.quads, front.groups.of_quads, strict=True)
        for group in (np.unique(groups) if layer.role == "pane" else ())
        if front.layer(layer, group) is None
    ]
    through = [(quads - origin(case)) @ turn.T for quads in holes]
    through += [
        surface.quads
        for surface in surfaces
        if lets_through(surface.material) and not isinstance(surface.material, PorousMaterial)
    ]
    passages = np.concatenate([np.zeros((0, 4, 3)), *through])
    return Enclosure(
        size, turn, openings, narrowest, front.effects.enclosed, is_box=False,
        exits=exits_of(passages), passages=passages,
    )  # fmt: skip


def _enclosure(front: PanesInState, components: tuple[PlacedComponent, ...]) -> Enclosure | None:
    """Enclosure with a rectangle around the openings of each façade, and the ceiling's holes."""
    case = front.case
    if case.room is None:
        return None
    openings, narrowest = [], np.inf
    for side, facade in case.facade.items():
        clear = [
            s
            for s in facade.strips
            if s.material != "wall" and _is_opening(front.strip(s.material, side))
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
    for side in front.groups.sides:
        tiles = front.wall(side)[2].items()
        lit = [q for name, quads in tiles if _is_opening(front.strip(name, side)) for q in quads]
        if lit:
            openings.append(_around(np.array(lit)))
            edges = np.diff(np.array(lit)[:, [0, 1, 2]], axis=1)
            narrowest = min(narrowest, float(np.linalg.norm(edges, axis=2).min()))
    for component in components:
        if component.hole is not None and component.is_open:
            openings.append(overhead(component.hole, case.room.size[2]))
    turn = rotation(case)
    quads = np.reshape(openings, (-1, 4, 3)) @ turn.T
    return Enclosure(np.array(case.room.size), turn, quads, narrowest, front.effects.enclosed)


def _around(quads: np.ndarray) -> np.ndarray:
    """Rectangle (4, 3) around upright rectangles (quad, 4, 3) of one side, its front as theirs."""
    corner, up, _, along = quads[0]
    axes = [(edge - corner) / np.linalg.norm(edge - corner) for edge in (up, along)]
    places = np.stack([(quads - corner).reshape(-1, 3) @ axis for axis in axes], axis=1)
    low, high = places.min(axis=0), places.max(axis=0)
    start = corner + low @ np.array(axes)
    return quad(start, (high[0] - low[0]) * axes[0], (high[1] - low[1]) * axes[1])


def _is_opening(material: SurfaceMaterial | None) -> bool:
    """Whether straight light may enter by a pane; a hole and a structure's gaps let it in."""
    return material is None or lets_through(material)
