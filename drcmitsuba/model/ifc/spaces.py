"""Spaces of an IFC building by name, use and storey, with the floors of their solids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drcmitsuba.model.ifc.shapes import OPEN, IfcShape, area_vectors
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.polygon import closes
from drcmitsuba.model.space import Space, floors_of, numbered, volume_of

DOWN = -0.9
"""Largest vertical part of the unit normal of a floor [–]."""


def spaces_of(shapes: Sequence[IfcShape], notes: Notes) -> tuple[Space, ...]:
    """Spaces of their solids; those without a level floor get a note."""
    spaces = []
    for shape in shapes:
        triangles, element = shape.triangles, shape.element
        areas = area_vectors(triangles)
        level = areas[:, 2] < DOWN * np.linalg.norm(areas, axis=1)
        ceiling = float(triangles[..., 2].max())
        floors = floors_of([(triangle,) for triangle in triangles[level]], ceiling)
        name = " ".join(filter(None, (element.Name, element.LongName))) or element.GlobalId
        if not floors:
            notes.add("Spaces without a level floor are left out", name)
            continue
        spaces.append(
            Space(
                name=name,
                floors=floors,
                ceiling=ceiling,
                use=_use(element),
                storey=_storey(element),
                # None where the solid is open, whose triangles may face any way.
                volume=volume_of([(t,) for t in triangles]) if closes(areas, OPEN) else None,
            )
        )
    return numbered(spaces)


def _use(element: Any) -> str:
    """Type of occupancy of a space, else its object type, else its long name."""
    from ifcopenshell.util.element import get_pset

    occupancy = get_pset(element, "Pset_SpaceOccupancyRequirements", "OccupancyType")
    return str(occupancy or element.ObjectType or element.LongName or "")


def _storey(element: Any) -> str:
    """Name of the storey that a space is part of."""
    from ifcopenshell.util.element import get_aggregate

    whole = get_aggregate(element)
    while whole is not None and not whole.is_a("IfcBuildingStorey"):
        whole = get_aggregate(whole)
    return str(whole.Name or "") if whole is not None else ""
