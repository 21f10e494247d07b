"""Spaces of a gbXML building by name, use and storey, with the floors of its surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drcmitsuba.model.gbxml.entries import GbxmlEntry
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.model.space import Space, floors_of, numbered, volume_of

STEEP = 0.5
"""Least vertical part of the unit normal of a floor [–]: ramps are floors, walls are none."""
WITHOUT_FLOOR = "Spaces without a floor are left out"
CUBIC_METRES = {
    "CubicMeters": 1.0, "CubicFeet": 0.3048**3, "CubicInches": 0.0254**3, "CubicCentimeters": 1e-6,
    "CubicMillimeters": 1e-9,
}  # fmt: skip


def entries_of(root: GbxmlEntry) -> list[GbxmlEntry]:
    """Spaces of all buildings of a file; InputError where an identifier is missing or repeats."""
    spaces = [
        space
        for campus in root.children("Campus")
        for building in campus.children("Building")
        for space in building.children("Space")
    ]
    seen = set[str]()
    for space in spaces:
        name = space.attribute("id")
        if not name or name in seen:
            got = "missing" if not name else "twice"
            raise space.refuse("id", got, "give every Space its own identifier")
        seen.add(name)
    return spaces


def spaces_of(
    root: GbxmlEntry, faces: Mapping[str, Sequence[np.ndarray]], notes: Notes
) -> tuple[Space, ...]:
    """Spaces of a file.

    Parameters
    ----------
    root : GbxmlEntry
    faces : mapping of str to sequence of np.ndarray
        Polygons around every space by its identifier (corner, 3), counter-clockwise from outside
        of the space [m].
    notes : Notes
        Gets the spaces that have no floor.
    """
    storeys = {
        storey.attribute("id"): storey.text("Name")
        for campus in root.children("Campus")
        for building in campus.children("Building")
        for storey in building.children("BuildingStorey")
    }
    cubic = CUBIC_METRES.get(root.attribute("volumeUnit"))
    spaces = []
    for entry in entries_of(root):
        polygons = faces.get(entry.attribute("id"), ())
        floors = [(ring,) for ring in polygons if is_floor(ring)]
        name = entry.text("Name") or entry.attribute("id")
        ceiling = max((float(ring[:, 2].max()) for ring in polygons), default=0.0)
        levels = floors_of(floors, ceiling)
        if not levels:
            notes.add(WITHOUT_FLOOR, name)
            continue
        stated = entry.number("Volume")
        volume = volume_of([(ring,) for ring in polygons])
        spaces.append(
            Space(
                name=name,
                floors=levels,
                ceiling=ceiling,
                use=entry.attribute("spaceType"),
                storey=storeys.get(entry.attribute("buildingStoreyIdRef"), ""),
                volume=volume if stated is None or cubic is None else stated * cubic,
            )
        )
    return numbered(spaces)


def is_floor(ring: np.ndarray) -> bool:
    """Whether a polygon (corner, 3) that faces out of its space faces down."""
    normal = area_vector(ring)
    return bool(normal[2] < -STEEP * np.linalg.norm(normal))


def is_ceiling(ring: np.ndarray) -> bool:
    """Whether a polygon (corner, 3) that faces out of its space faces up."""
    return is_floor(ring[::-1])
