"""IFC files as models."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.model.facets import facet_quads, join
from drcmitsuba.model.ifc.panes import sheets_of
from drcmitsuba.model.ifc.shapes import IfcShape, area_vectors, opened, shapes_of
from drcmitsuba.model.ifc.spaces import spaces_of
from drcmitsuba.model.model import Layer, Location, Model, Role
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.unstated import GLASS, glass, note_reflectances, surface_material
from drcmitsuba.runtime import process
from drcmitsuba.runtime.errors import InputError, printable

GLAZED = ("IfcWindow", "IfcDoor", "IfcCurtainWall", "IfcPlate", "IfcMember")
"""Elements whose transparent faces are glass."""
LEVEL = ("IfcSlab", "IfcRoof", "IfcCovering", "IfcBuildingElementProxy")
"""Elements that are floor above and ceiling below."""
PARTS = {
    "IfcWindow": "frame", "IfcMember": "frame", "IfcPlate": "frame", "IfcCurtainWall": "frame",
    "IfcDoor": "door", "IfcFurnishingElement": "furniture", "IfcRailing": "furniture",
    "IfcStair": "floor", "IfcStairFlight": "floor", "IfcRamp": "floor", "IfcSite": "outside",
}  # fmt: skip
"""Names of the layers of other elements; walls are those of all that are not named."""
STEEP = 0.5
"""Least vertical part of the unit normal of a floor or a ceiling [–]."""
WHOLE = "Windows without a transparent part are glass as a whole"
OPAQUE = "Plates and curtain walls without a transparent part are opaque"
LONGEST = 1800.0
"""Longest time that a file may take to be read [s]."""
CONVERGENCE = 5.0
"""Largest angle between a map's grid and true north, with room for rounding [deg]."""
NO_SPACES = (
    "The file has no IfcSpace: grids lie above its floors; rooms can be named in [spaces.NAME]"
)


def read(file: Path) -> Model:
    """Read a building in IFC 2x3 or 4.

    A process of its own reads it: a damaged file can bring down ifcopenshell. Elements are their
    solids, without openings; installations are left out. Faces of slabs, roofs and coverings are
    `floor` where they face up and `ceiling` where they face down. Glass of windows, doors and
    curtain walls is a sheet in the middle of its panes. Files state no reflectances or visible
    transmittances in terms that programs share: those of LM-83 and of clear double glazing are
    taken, with a note.

    Parameters
    ----------
    file : Path
        File in STEP format, at most 500 MB.

    Returns
    -------
    Model
        The model in metres, with its spaces.

    Raises
    ------
    InputError
        ifcopenshell is not installed; the file is damaged, too large, of another schema, takes
        longer than `LONGEST`, or holds no surface.
    """
    file, deadline = Path(file).absolute(), time.monotonic() + LONGEST
    try:
        return process.run(partial(_read, file), deadline)
    except process.JobError as error:
        got = f"ifcopenshell cannot read it ({printable(str(error))[:120]})"
        raise InputError(file, "IFC", got, "check the file, or export it again") from None
    except TimeoutError:
        got = f"reading takes longer than {LONGEST:.0f} s"
        raise InputError(file, "IFC", got, "leave out furniture and installations") from None


def _read(file: Path) -> Model:
    source = opened(file)
    notes, spaces, solids = Notes(), list[IfcShape](), list[IfcShape]()
    for shape in shapes_of(file, source):
        (spaces if shape.is_any("IfcSpace") else solids).append(shape)
    layers = tuple(_layers(solids, notes))
    if not layers:
        got = "no element with a shape"
        raise InputError(file, "IFC", got, "check that it is whole, or export its geometry")
    if not spaces:
        notes.add(NO_SPACES)
    note_reflectances((name for layer in layers for name in layer.names), notes)
    return Model(
        layers=layers, location=_location(source), north=_north(source, notes),
        spaces=spaces_of(spaces, notes), notes=notes.sentences(),
    )  # fmt: skip


def _layers(solids: Iterable[IfcShape], notes: Notes) -> Iterator[Layer]:
    """Layers of the opaque faces by their kind, then the glass."""
    opaque: dict[str, list[tuple[str, np.ndarray]]] = {}
    panes: list[tuple[str, np.ndarray]] = []
    for shape in solids:
        clear = shape.is_clear & shape.is_any(*GLAZED)
        if shape.is_any("IfcWindow") and not clear.any():
            notes.add(WHOLE, shape.place)
            clear = np.ones_like(clear)
        if shape.is_any("IfcPlate", "IfcCurtainWall") and not clear.any():
            notes.add(OPAQUE, shape.place)
        if clear.any():
            panes.append((shape.place, sheets_of(shape.triangles[clear])))
        for name, triangles in _sides(shape, shape.triangles[~clear]):
            opaque.setdefault(name, []).append((shape.place, join(*facet_quads(triangles))[0]))
    for name, pieces in opaque.items():
        role: Role = "context" if name == "outside" else "surface"
        yield from _layer(name, surface_material(name), role, pieces)
    yield from _layer(GLASS, glass(None, GLASS, notes), "pane", panes) if panes else ()


def _layer(
    name: str, material: Any, role: Role, pieces: list[tuple[str, np.ndarray]]
) -> Iterator[Layer]:
    """Layer of the quads of some places; none without a quad."""
    quads = np.concatenate([quads for _, quads in pieces])
    polygon = np.repeat(np.arange(len(pieces)), [len(quads) for _, quads in pieces])
    if len(quads):
        yield Layer(name, material, role, quads, polygon, tuple(place for place, _ in pieces))


def _sides(shape: IfcShape, triangles: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Triangles of an element by the names of their layers."""
    if not len(triangles):
        return
    kind = next((name for ifc, name in PARTS.items() if shape.is_any(ifc)), "wall")
    if not shape.is_any(*LEVEL):
        yield kind, triangles
        return
    normal = area_vectors(triangles)
    up = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    for name, chosen in (
        ("floor", up > STEEP), ("ceiling", up < -STEEP), (kind, np.abs(up) <= STEEP),
    ):  # fmt: skip
        if chosen.any():
            yield name, triangles[chosen]


def _location(source: Any) -> Location | None:
    """Place of the first site that states one."""
    for site in source.by_type("IfcSite"):
        if site.RefLatitude and site.RefLongitude:
            latitude, longitude = map(_degrees, (site.RefLatitude, site.RefLongitude))
            if abs(latitude) <= 90 and abs(longitude) <= 180:
                return Location(latitude, longitude, str(site.LongName or site.Name or ""))
    return None


def _degrees(parts: tuple[int, ...]) -> float:
    """Angle of degrees, minutes, seconds and millionths of seconds [deg]."""
    return float(sum(p / scale for p, scale in zip(parts, (1, 60, 3600, 3.6e9), strict=False)))


def _north(source: Any, notes: Notes) -> float:
    """Direction of true north, clockwise from the y axis [deg].

    The axes of a map that are turned take precedence over a stated true north, as IFC 4 has it,
    where both differ by more than the grid of a map does from true north.
    """
    stated = on_map = None
    for context in source.by_type("IfcGeometricRepresentationContext", include_subtypes=False):
        if context.TrueNorth is not None and stated is None:
            x, y = context.TrueNorth.DirectionRatios[:2]
            stated = math.degrees(math.atan2(x, y)) % 360
    for map_ in source.by_type("IfcMapConversion") if source.schema != "IFC2X3" else ():
        if map_.XAxisAbscissa is not None and map_.XAxisOrdinate is not None:
            on_map = math.degrees(math.atan2(map_.XAxisOrdinate, map_.XAxisAbscissa)) % 360
    if on_map is None or stated is None:
        return on_map or stated or 0.0
    if abs((on_map - stated + 180) % 360 - 180) <= CONVERGENCE:
        return stated
    if on_map == 0:  # many programs write the axes of a map without turning them
        notes.add(f"True north is stated at {stated:.1f}°, the axes of the map are not turned")
        return stated
    notes.add(f"North is that of the map, at {on_map:.1f}°; true north is stated at {stated:.1f}°")
    return on_map
