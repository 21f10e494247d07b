"""Polygons of an HBJSON model: which there are, once each, and with which modifier."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drcmitsuba.model.honeybee.entries import Entry, by_identifier
from drcmitsuba.model.honeybee.modifiers import Modifiers
from drcmitsuba.model.model import Role

FAMILIES = {"Wall": "wall_set", "Floor": "floor_set", "RoofCeiling": "roof_ceiling_set"}
"""Key in a modifier set of each type of face that is a surface."""
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

    source: Entry
    modifier: str
    role: Role
    """Context, or surface where it may be a pane, too."""
    rings: tuple[np.ndarray, ...]
    """Corners of the outline, then of each hole, shape (corner, 3) each."""
    group: str = ""
    states: tuple[PieceState, ...] = ()


@dataclass(frozen=True)
class Walk:
    """Walk through a model's rooms, faces, panes and shades."""

    model: Entry
    modifiers: Modifiers
    twins: dict[str, dict[str, Entry]]
    """Objects that may touch another one, by their type and identifier."""

    def pieces(self) -> Iterator[Piece]:
        """Every polygon of the model; of two that touch, the one whose identifier comes first."""
        for room in self.model.entries("rooms"):
            if room.number("multiplier", 1) > 1:
                self.modifiers.notes.add("Multipliers of rooms are left out", room.place)
            name = self.modifiers.named(room.inner("properties", "radiance"), "modifier_set")
            if name is not None and name not in self.modifiers.sets:
                got = f"{name}, which the file lacks"
                raise room.refuse("modifier_set", got, "add it to modifier_sets")
            room_set = None if name is None else self.modifiers.sets[name]
            for face in room.entries("faces"):
                yield from self._face(face, room_set)
            yield from self._shades(room, room_set)
        for face in self.model.entries("orphaned_faces"):
            yield from self._face(face, None)
        for pane in self.model.entries("orphaned_apertures"):
            yield from self._pane(pane, "Aperture", "Wall", None)
        for door in self.model.entries("orphaned_doors"):
            yield from self._pane(door, "Door", "Wall", None)
        for shade in self.model.entries("orphaned_shades"):
            yield self._shade(shade, None, "", "context_modifier", "context")

    def _face(self, face: Entry, room_set: Entry | None) -> Iterator[Piece]:
        kind = face.text("face_type") or "missing"
        if kind not in FAMILIES and kind not in OPENINGS:
            raise face.refuse("face_type", kind, f"choose one of {', '.join(FAMILIES)}")
        panes = face.entries("apertures"), face.entries("doors")
        kept = self._is_kept(face, "Face")
        if kept and kind in FAMILIES:
            outdoors = self._condition(face) == "Outdoors"
            own = face.inner("properties", "radiance")
            name = self.modifiers.name(
                own, room_set, FAMILIES[kind], f"{'ex' if outdoors else 'in'}terior_modifier"
            )
            openings = [rings_of(pane)[0] for each in panes for pane in each]
            yield Piece(face, name, "surface", (*rings_of(face), *openings))
        for pane in panes[0]:
            yield from self._pane(pane, "Aperture", kind, room_set)
        for door in panes[1]:
            yield from self._pane(door, "Door", kind, room_set)
        yield from self._shades(face, room_set)

    def _pane(
        self, pane: Entry, element: str, parent: str, room_set: Entry | None
    ) -> Iterator[Piece]:
        """Aperture or door in a face of the parent's type."""
        if self._is_kept(pane, element):
            family, kind = self._kind(pane, element, parent)
            own = pane.inner("properties", "radiance")
            name = self.modifiers.name(own, room_set, family, kind)
            yield self._with_states(pane, own, name, "surface")
        yield from self._shades(pane, room_set)

    def _kind(self, pane: Entry, element: str, parent: str) -> tuple[str, str]:
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

    def _shades(self, parent: Entry, room_set: Entry | None) -> Iterator[Piece]:
        for shade in parent.entries("indoor_shades"):
            yield self._shade(shade, room_set, "shade_set", "interior_modifier", "surface")
        for shade in parent.entries("outdoor_shades"):
            yield self._shade(shade, room_set, "shade_set", "exterior_modifier", "context")

    def _shade(
        self, shade: Entry, room_set: Entry | None, family: str, kind: str, role: Role
    ) -> Piece:
        own = shade.inner("properties", "radiance")
        name = self.modifiers.name(own, room_set, family, kind)
        return self._with_states(shade, own, name, role)

    def _with_states(self, source: Entry, own: Entry, modifier: str, role: Role) -> Piece:
        """Polygon with the states of its group; its modifier is that of the first state."""
        group = own.text("dynamic_group_identifier") or ""
        states = tuple(
            PieceState(self.modifiers.named(state, "modifier") or modifier, self._added(state))
            for state in (own.entries("states") if group else ())
        )
        first = states[0].modifier if states else modifier
        return Piece(source, first, role, rings_of(source), group, states)

    def _added(self, state: Entry) -> tuple[Piece, ...]:
        """Shades that stand in one state only."""
        default = "generic_exterior_shade_0.35"
        return tuple(
            Piece(
                each, self.modifiers.named(each, "modifier") or default, "context", rings_of(each)
            )
            for each in state.entries("shades")
        )

    def _condition(self, source: Entry) -> str:
        """Type of the boundary condition; outdoors where there is none."""
        return source.inner("boundary_condition").text("type") or "Outdoors"

    def _is_kept(self, source: Entry, element: str) -> bool:
        """Whether an object stands for itself and for the one that touches it, if any does."""
        if self._condition(source) != "Surface":
            return True
        name, other = source.identifier(), _touched(source)
        if other not in self.twins[element]:
            got = f"{other}, which the file lacks"
            raise source.refuse("boundary_condition", got, "add it, or set another condition")
        twin = self.twins[element][other]
        if self._condition(twin) != "Surface" or _touched(twin) != name or other == name:
            got = f"{other}, which does not touch {name} in turn"
            raise source.refuse("boundary_condition", got, "let both name each other")
        return name < other


def walk_of(model: Entry, modifiers: Modifiers) -> Walk:
    """Walk through a model; InputError where identifiers of faces, panes or shades repeat."""
    rooms = model.entries("rooms")
    by_identifier(rooms)
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
    twins = {kind: by_identifier(each) for kind, each in kinds.items()}
    return Walk(model, modifiers, twins)


def rings_of(source: Entry) -> tuple[np.ndarray, ...]:
    """Corners of the outline and the holes of an object's `Face3D`."""
    face = source.entry("geometry")
    if face is None:
        raise source.refuse("geometry", "missing", "give it a Face3D")
    holes = (face.corners("holes", hole) for hole in face.sequence("holes"))
    return face.corners("boundary"), *holes


def _touched(source: Entry) -> str:
    """Identifier of the object that one with the boundary condition "Surface" touches."""
    names = source.inner("boundary_condition").sequence("boundary_condition_objects")
    if not names or not isinstance(names[0], str):
        raise source.refuse("boundary_condition_objects", "none", "name what it touches")
    return names[0]
