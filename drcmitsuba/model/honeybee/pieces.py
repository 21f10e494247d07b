"""Polygons of an HBJSON model: which there are, once each, and with which modifier."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely

from drcmitsuba.model.honeybee.entries import JsonEntry, by_identifier
from drcmitsuba.model.honeybee.modifiers import Modifiers
from drcmitsuba.model.honeybee.overlap import Overlap
from drcmitsuba.model.model import Role
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.shared_walls import (
    COVERED,
    UNSTATED,
    RoomFace,
    sheets_of,
    single_panes,
    uncovered,
)

FAMILIES = {"Wall": "wall_set", "Floor": "floor_set", "RoofCeiling": "roof_ceiling_set"}
"""Key in a modifier set of each type of face that is a surface."""
OF_ROOMS = ("Face", "Aperture", "Door")
"""Types of objects around rooms."""
OPENINGS = ("AirBoundary", "AirWall")
"""Types of faces that are no surface; the second is the name in files before 2020."""


@dataclass(frozen=True)
class PieceState:
    """State of a polygon whose group changes its state."""

    modifier: str
    shades: tuple[Piece, ...]


@dataclass(frozen=True)
class Piece:
    """Polygon of the model, in the units of the file."""

    source: JsonEntry
    modifier: str
    role: Role
    """Context, or surface where it may be a pane, too."""
    rings: tuple[np.ndarray, ...]
    """Corners of the outline, then of each hole, shape (corner, 3) each."""
    group: str = ""
    states: tuple[PieceState, ...] = ()
    behind: str = ""
    """Modifier of the back, where it differs."""


class TouchingObject(NamedTuple):
    """Object that may touch another one."""

    source: JsonEntry
    room_set: JsonEntry | None
    """Modifier set of its room."""


@dataclass(frozen=True)
class Walk:
    """Walk through a model's rooms, faces, panes and shades."""

    model: JsonEntry
    modifiers: Modifiers
    twins: dict[str, dict[str, TouchingObject]]
    """Objects that may touch another one, by their type and identifier."""
    tolerance: float
    """Largest distance at which two points of the file count as one, in its units."""

    def pieces(self) -> list[Piece]:
        """Every polygon of the model; what two rooms share is there once, with two sides.

        Parts of context that lie on faces and panes of rooms are left out: rooms would see them.
        """
        every = self._with_single_panes(list(self._pieces()))
        covers = [piece.rings for piece in every if piece.source.text("type") in OF_ROOMS]
        context = [piece for piece in every if piece.role == "context"]
        parts = iter(uncovered([piece.rings for piece in context], covers, self.tolerance))
        return [
            piece if rings is piece.rings else replace(piece, rings=rings)
            for piece in every
            for rings in (next(parts) if piece.role == "context" else (piece.rings,))
        ]

    def _with_single_panes(self, every: list[Piece]) -> list[Piece]:
        """Polygons without the parts of panes that a pane or the face of another room covers."""
        keys = ("orphaned_faces", "orphaned_apertures", "orphaned_doors")
        orphans = {each.identifier() for key in keys for each in self.model.entries(key)}

        def is_in_room(piece: Piece, *kinds: str) -> bool:
            source = piece.source
            return source.text("type") in kinds and source.identifier() not in orphans

        walls = [piece.rings for piece in every if is_in_room(piece, "Face")]
        panes = [piece for piece in every if is_in_room(piece, "Aperture", "Door")]
        parts = iter(single_panes([piece.rings for piece in panes], walls, self.tolerance))
        out = []
        for piece in every:
            own = next(parts) if is_in_room(piece, "Aperture", "Door") else [piece.rings]
            if len(own) == 1 and own[0] is piece.rings:
                out.append(piece)
                continue
            self.modifiers.notes.add(COVERED, piece.source.place)
            out += [replace(piece, rings=rings) for rings in own]
        return out

    def _pieces(self) -> Iterator[Piece]:
        touching = self._touching()
        for room in self.model.entries("rooms"):
            if room.number("multiplier", 1) > 1:
                self.modifiers.notes.add("Multipliers of rooms are left out", room.place)
            room_set = self.modifiers.set_of(room)
            for face in room.entries("faces"):
                yield from self._face(face, room_set, touching)
            yield from self._shades(room, room_set)
        for face in self.model.entries("orphaned_faces"):
            yield from self._face(face, None, touching)
        for pane in self.model.entries("orphaned_apertures"):
            yield from self._pane(pane, "Aperture", "Wall", None)
        for door in self.model.entries("orphaned_doors"):
            yield from self._pane(door, "Door", "Wall", None)
        for shade in self.model.entries("orphaned_shades"):
            yield self._shade(shade, None, "", "context_modifier", "context")

    def _touching(self) -> dict[str, list[Piece]]:
        """Pieces of faces that touch others, which the file does not say, by their identifiers."""
        alone = [
            (room.identifier(), TouchingObject(face, self.modifiers.set_of(room)))
            for room in self.model.entries("rooms")
            for face in room.entries("faces")
            if face.text("face_type") in FAMILIES and self._condition(face) != "Surface"
        ]
        faces = [RoomFace(opened_rings(face.source), room) for room, face in alone]
        out = {}
        every = zip(alone, faces, sheets_of(faces, self.tolerance), strict=True)
        for (_, own), face, sheets in every:
            if len(sheets) == 1 and sheets[0].rings is face.rings:
                continue
            pieces, name = list[Piece](), self._modifier(own.source, own.room_set)
            for rings, other in sheets:
                behind = ""
                if other is not None:
                    twin = alone[other][1]
                    behind = self._modifier(twin.source, twin.room_set)
                    self.modifiers.notes.add(
                        UNSTATED, f"{own.source.place} and {twin.source.place}"
                    )
                pieces.append(
                    Piece(
                        own.source, name, "surface", rings, behind=behind if behind != name else ""
                    )
                )
            out[own.source.identifier()] = pieces
        return out

    def _face(
        self, face: JsonEntry, room_set: JsonEntry | None, touching: Mapping[str, list[Piece]]
    ) -> Iterator[Piece]:
        kind = face.text("face_type") or "missing"
        if kind not in FAMILIES and kind not in OPENINGS:
            raise face.refuse("face_type", kind, f"choose one of {', '.join(FAMILIES)}")
        panes = face.entries("apertures"), face.entries("doors")
        if self._is_kept(face, "Face") and kind in FAMILIES:
            name, rings = self._modifier(face, room_set), opened_rings(face)
            if self._condition(face) != "Surface":
                own = [Piece(face, name, "surface", rings)]
                yield from touching.get(face.identifier(), own)
            else:
                yield from self._shared(face, name, rings)
            for hole in walls_in_panes(face):
                yield Piece(face, name, "surface", hole)
        for pane in panes[0]:
            yield from self._pane(pane, "Aperture", kind, room_set)
        for door in panes[1]:
            yield from self._pane(door, "Door", kind, room_set)
        yield from self._shades(face, room_set)

    def _modifier(self, face: JsonEntry, room_set: JsonEntry | None) -> str:
        """Name of the modifier of a face that is a surface."""
        outdoors = self._condition(face) == "Outdoors"
        return self.modifiers.name(
            face.inner("properties", "radiance"), room_set,
            FAMILIES[face.text("face_type") or ""], f"{'ex' if outdoors else 'in'}terior_modifier",
        )  # fmt: skip

    def _shared(self, face: JsonEntry, name: str, rings: tuple[np.ndarray, ...]) -> Iterator[Piece]:
        """Face and the one of another room that touches it: one sheet, and what either has more."""
        other = self.twins["Face"][_touched(face)]
        if (other.source.text("face_type") or "") not in FAMILIES:  # open from its other side
            return
        behind = self._modifier(other.source, other.room_set)
        theirs = opened_rings(other.source)
        shared = Overlap.of(rings, theirs, self.tolerance)
        for both in shared.both:
            yield Piece(face, name, "surface", both, behind=behind if behind != name else "")
        for own in shared.first:
            yield Piece(face, name, "surface", own)
        for own in shared.second:
            yield Piece(other.source, behind, "surface", own)

    def _pane(
        self, pane: JsonEntry, element: str, parent: str, room_set: JsonEntry | None
    ) -> Iterator[Piece]:
        """Aperture or door in a face of the parent's type."""
        if self._is_kept(pane, element):
            family, kind = self._kind(pane, element, parent)
            own = pane.inner("properties", "radiance")
            name = self.modifiers.name(own, room_set, family, kind)
            yield self._with_states(pane, own, name, "surface")
        yield from self._shades(pane, room_set)

    def _kind(self, pane: JsonEntry, element: str, parent: str) -> tuple[str, str]:
        """Keys in a modifier set of an aperture or a door."""
        inside = self._condition(pane) == "Surface"
        level = parent in ("RoofCeiling", "Floor")
        if element == "Door":
            glass = "_glass" if pane.flag("is_glass") else ""
            if level and not inside and not glass:
                return "door_set", "overhead_modifier"
            return "door_set", f"{'in' if inside else 'ex'}terior{glass}_modifier"
        if inside:
            return "aperture_set", "interior_modifier"
        if pane.flag("is_operable"):
            return "aperture_set", "operable_modifier"
        return "aperture_set", "skylight_modifier" if level else "window_modifier"

    def _shades(self, parent: JsonEntry, room_set: JsonEntry | None) -> Iterator[Piece]:
        for shade in parent.entries("indoor_shades"):
            yield self._shade(shade, room_set, "shade_set", "interior_modifier", "surface")
        for shade in parent.entries("outdoor_shades"):
            yield self._shade(shade, room_set, "shade_set", "exterior_modifier", "context")

    def _shade(
        self, shade: JsonEntry, room_set: JsonEntry | None, family: str, kind: str, role: Role
    ) -> Piece:
        own = shade.inner("properties", "radiance")
        name = self.modifiers.name(own, room_set, family, kind)
        return self._with_states(shade, own, name, role)

    def _with_states(self, source: JsonEntry, own: JsonEntry, modifier: str, role: Role) -> Piece:
        """Polygon with the states of its group; its modifier is that of the first state."""
        group = own.text("dynamic_group_identifier") or ""
        states = tuple(
            PieceState(self.modifiers.named(state, "modifier") or modifier, self._added(state))
            for state in (own.entries("states") if group else ())
        )
        first = states[0].modifier if states else modifier
        return Piece(source, first, role, rings_of(source), group, states)

    def _added(self, state: JsonEntry) -> tuple[Piece, ...]:
        """Shades that stand in one state only."""
        default = "generic_exterior_shade_0.35"
        return tuple(
            Piece(
                each, self.modifiers.named(each, "modifier") or default, "context", rings_of(each)
            )
            for each in state.entries("shades")
        )

    def _condition(self, source: JsonEntry) -> str:
        """Type of the boundary condition; outdoors where there is none."""
        return source.inner("boundary_condition").text("type") or "Outdoors"

    def _is_kept(self, source: JsonEntry, element: str) -> bool:
        """Whether an object stands for itself and for the one that touches it, if any does."""
        if self._condition(source) != "Surface":
            return True
        name, other = source.identifier(), _touched(source)
        if other not in self.twins[element]:
            got = f"{other}, which the file lacks"
            raise source.refuse("boundary_condition", got, "add it, or set another condition")
        twin = self.twins[element][other].source
        if self._condition(twin) != "Surface" or _touched(twin) != name or other == name:
            got = f"{other}, which does not touch {name} in turn"
            raise source.refuse("boundary_condition", got, "let both name each other")
        return name < other


def walk_of(model: JsonEntry, modifiers: Modifiers, tolerance: float) -> Walk:
    """Walk through a model; InputError where identifiers of faces, panes or shades repeat."""
    rooms = model.entries("rooms")
    by_identifier(rooms)
    sets: dict[str, JsonEntry | None] = {}
    for room in rooms:
        room_set = modifiers.set_of(room)
        sets |= {face.identifier(): room_set for face in room.entries("faces")}
    faces = [face for room in rooms for face in room.entries("faces")]
    faces += model.entries("orphaned_faces")
    apertures = [each for face in faces for each in face.entries("apertures")]
    apertures += model.entries("orphaned_apertures")
    doors = [each for face in faces for each in face.entries("doors")]
    doors += model.entries("orphaned_doors")
    shades = model.entries("orphaned_shades")
    for parent in (*rooms, *faces, *apertures, *doors):
        shades += parent.entries("indoor_shades") + parent.entries("outdoor_shades")
    by_identifier(shades)
    kinds = {"Face": faces, "Aperture": apertures, "Door": doors}
    twins = {
        kind: {
            name: TouchingObject(each, sets.get(name))
            for name, each in by_identifier(alike).items()
        }
        for kind, alike in kinds.items()
    }
    return Walk(model, modifiers, twins, tolerance)


def opened_rings(face: JsonEntry) -> tuple[np.ndarray, ...]:
    """Corners of the outline of a face, then of its holes, apertures and doors.

    What stands in the hole of another aperture opens the face no further.
    """
    panes = _panes(face)
    outlines = [rings[0] for rings in panes]
    if any(len(rings) > 1 for rings in panes):
        plane = Plane.of(rings_of(face)[0])
        whole = shapely.union_all([plane.shape([ring]) for ring in outlines])
        outlines = [rings[0] for rings in plane.rings(whole)]
    return (*rings_of(face), *outlines)


def walls_in_panes(face: JsonEntry) -> list[tuple[np.ndarray, ...]]:
    """Corners of the outline and the holes of what is wall in the holes of apertures and doors."""
    panes = _panes(face)
    holes = [hole for rings in panes for hole in rings[1:]]
    if not holes:
        return []
    plane = Plane.of(rings_of(face)[0])
    shape = shapely.union_all([plane.shape([hole]) for hole in holes])
    return plane.rings(shape - shapely.union_all([plane.shape(rings) for rings in panes]))


def _panes(face: JsonEntry) -> list[tuple[np.ndarray, ...]]:
    """Corners of the outline and the holes of every aperture and door of a face."""
    return [rings_of(pane) for pane in (*face.entries("apertures"), *face.entries("doors"))]


def rings_of(source: JsonEntry) -> tuple[np.ndarray, ...]:
    """Corners of the outline and the holes of an object's `Face3D`."""
    face = source.entry("geometry")
    if face is None:
        raise source.refuse("geometry", "missing", "give it a Face3D")
    holes = (face.corners("holes", hole) for hole in face.sequence("holes"))
    return face.corners("boundary"), *holes


def _touched(source: JsonEntry) -> str:
    """Identifier of the object that one with the boundary condition "Surface" touches."""
    names = source.inner("boundary_condition").sequence("boundary_condition_objects")
    if not names or not isinstance(names[0], str):
        raise source.refuse("boundary_condition_objects", "none", "name what it touches")
    return names[0]
