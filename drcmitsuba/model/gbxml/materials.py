"""Materials of a gbXML building: reflectances by kind of surface, glass by its window type.

gbXML has surfaces without reflectances in nearly all files; defaults are those of LM-83-12 [1]_ for
rooms whose finishes are not known.

References
----------
.. [1] IES LM-83-12, "Spatial Daylight Autonomy (sDA) and Annual Sunlight Exposure (ASE)", 2.2.
"""

from __future__ import annotations

from collections.abc import Mapping

from drcmitsuba.model.gbxml.entries import GbxmlEntry
from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.model.notes import Notes

REFLECTANCES = {
    "floor": 0.2, "wall": 0.5, "ceiling": 0.7, "door": 0.5, "outside": 0.3, "shade": 0.3,
}  # fmt: skip
"""Diffuse reflectances by what a side of a surface is [–]."""
GLASS = "glass"
"""Name of the glass of windows without a type."""
TRANSMITTANCE = 0.6
"""Visible transmittance of windows that state none [–]."""
ASSUMED = "Reflectances that the file does not state are those of LM-83"
ASSUMED_GLASS = f"Windows without a visible transmittance have {TRANSMITTANCE:g}"


def surface_material(side: str) -> Lambertian:
    """Material of a side of a surface."""
    return Lambertian(REFLECTANCES[side])


def note_reflectances(sides: set[str], notes: Notes) -> None:
    """Note the reflectances that some sides of surfaces were given."""
    for side, reflectance in REFLECTANCES.items():
        if side in sides:
            notes.add(ASSUMED, f"{side} {reflectance:g}")


def window_types(root: GbxmlEntry) -> Mapping[str, tuple[str, float | None]]:
    """Name and visible transmittance of every window type, by its identifier; None where unstated.

    Raises
    ------
    InputError
        A transmittance is no number from 0 to 1.
    """
    types = {}
    for entry in root.children("WindowType"):
        name = entry.text("Name") or entry.attribute("id")
        types[entry.attribute("id")] = name, _visible(entry)
    return types


def glass(transmittance: float | None, name: str, notes: Notes) -> GlazingMaterial:
    """Clear glass of a visible transmittance; of `TRANSMITTANCE`, with a note, where it is None."""
    if transmittance is None:
        notes.add(ASSUMED_GLASS, name)
    tau = TRANSMITTANCE if transmittance is None else transmittance
    return GlazingMaterial(type="glazing", transmittance=tau)


def _visible(entry: GbxmlEntry) -> float | None:
    """Visible transmittance at normal incidence [–]; None where it is not stated."""
    for each in entry.children("Transmittance"):
        normal = each.attribute("solarIncidentAngle") or "0"
        if each.attribute("type") != "Visible" or float(normal or 0) != 0:
            continue
        value = each.number()
        if value is not None and each.attribute("unit") == "Percent":
            value /= 100
        if value is not None and not 0 <= value <= 1:
            raise entry.refuse("Transmittance", f"{value:g}", "give a fraction from 0 to 1")
        return value
    return None
