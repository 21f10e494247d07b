"""gbXML files as models."""

from __future__ import annotations

from pathlib import Path

from drcmitsuba.model.gbxml.entries import GbxmlEntry, is_gbxml, read_entry
from drcmitsuba.model.gbxml.materials import window_types
from drcmitsuba.model.gbxml.spaces import entries_of, spaces_of
from drcmitsuba.model.gbxml.surfaces import INWARD, GbxmlSurfaces, inside_out
from drcmitsuba.model.model import Location, Model
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.unstated import note_reflectances

__all__ = ["is_gbxml", "read"]

METRES = {
    "Meters": 1.0, "Kilometers": 1e3, "Centimeters": 1e-2, "Millimeters": 1e-3,
    "Miles": 1609.344, "Yards": 0.9144, "Feet": 0.3048, "Inches": 0.0254,
}  # fmt: skip
"""Length of each unit [m]."""
TURNED = "The y axis of the model points so many degrees clockwise of north by CADModelAzimuth"


def read(file: Path) -> Model:
    """Read a building in gbXML.

    A surface is one sheet, with a side for each of its spaces: floor, wall or ceiling as it lies in
    the space, with the reflectances of LM-83 [1]_. Openings with a window type are panes of its
    visible transmittance, doors without one are part of their wall, and air is no surface. Surfaces
    without a space are shades outside. Plane gaps between the surfaces of a space are closed, with
    a note on their area.

    Parameters
    ----------
    file : Path
        XML file, at most 100 MB.

    Returns
    -------
    Model
        The model in metres, with its spaces.

    Raises
    ------
    InputError
        The file is no gbXML or too large, states no unit of length, has no space or surface, or an
        element in it is unfit; the error names the element.

    References
    ----------
    .. [1] IES LM-83-12, "Spatial Daylight Autonomy (sDA) and Annual Sunlight Exposure (ASE)".
    """
    root = read_entry(Path(file))
    unit = root.attribute("lengthUnit")
    if unit not in METRES:
        got = unit or "missing"
        raise root.refuse("lengthUnit", got, f"choose one of {', '.join(METRES)}")
    spaces = entries_of(root)
    if not spaces:
        raise root.refuse("Space", "none", "export the building with its rooms or spaces")
    notes = Notes()
    identifiers = frozenset(space.attribute("id") for space in spaces)
    entries = [each for campus in root.children("Campus") for each in campus.children("Surface")]
    turned = inside_out(entries)
    for space in spaces:
        if space.attribute("id") in turned:
            notes.add(INWARD, space.text("Name") or space.attribute("id"))
    surfaces = GbxmlSurfaces(window_types(root), identifiers, METRES[unit], notes, turned)
    for surface in entries:
        surfaces.add(surface)
    surfaces.close(spaces)
    layers = tuple(surfaces.layers())
    if not layers:
        raise root.refuse("Surface", "none", "export the building with its surfaces")
    note_reflectances({name for layer in layers for name in layer.names}, notes)
    place = root.child("Campus", "Location")
    return Model(
        layers=layers,
        location=None if place is None else _location(place),
        north=0.0 if place is None else _north(place, notes),
        spaces=spaces_of(root, surfaces.faces, notes),
        notes=notes.sentences(),
    )


def _location(place: GbxmlEntry) -> Location | None:
    """Place that a file states; None where it has no coordinates."""
    latitude, longitude = place.number("Latitude"), place.number("Longitude")
    if latitude is None or longitude is None:
        return None
    if abs(latitude) > 90 or abs(longitude) > 180:
        got = f"{latitude:g}, {longitude:g}"
        raise place.refuse("Location", got, "give degrees of latitude and longitude")
    return Location(latitude, longitude, place.text("Name"))


def _north(place: GbxmlEntry, notes: Notes) -> float:
    """Direction of true north, clockwise from the y axis [deg]."""
    azimuth = place.number("CADModelAzimuth") or 0.0
    if azimuth:
        notes.add(TURNED, f"{azimuth:g}")
    return (-azimuth) % 360
