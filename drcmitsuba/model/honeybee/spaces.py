"""Rooms of an HBJSON model as spaces: name, program, storey, floor."""

from __future__ import annotations

from collections.abc import Sequence

from drcmitsuba.model.honeybee.entries import JsonEntry
from drcmitsuba.model.honeybee.pieces import rings_of
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.space import Space, floors_of, numbered, volume_of


def spaces_of(rooms: Sequence[JsonEntry], metres: float, notes: Notes) -> tuple[Space, ...]:
    """Spaces of some `Room`, whose coordinates have a unit of so many metres.

    A room has the name that it shows, and as its use the last part of its program's identifier.
    """
    spaces = []
    for room in rooms:
        faces = room.entries("faces")
        polygons = [tuple(ring * metres for ring in rings_of(face)) for face in faces]
        floors = [
            polygon
            for face, polygon in zip(faces, polygons, strict=True)
            if face.text("face_type") == "Floor"
        ]
        ceiling = max((float(outline[:, 2].max()) for outline, *_ in polygons), default=0.0)
        levels = floors_of(floors, ceiling)
        if not levels:
            notes.add("Rooms without a floor are no spaces", room.place)
            continue
        program = room.inner("properties", "energy").text("program_type") or ""
        spaces.append(
            Space(
                name=room.text("display_name") or room.identifier(),
                floors=levels,
                ceiling=ceiling,
                use=program.rpartition("::")[2],
                storey=room.text("story") or "",
                volume=volume_of(polygons),
            )
        )
    return numbered(spaces)
