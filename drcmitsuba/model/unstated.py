"""Materials that building models do not state: reflectances by kind of surface, and glass.

BIM files have surfaces without reflectances; defaults are those of LM-83-12 [1]_ for rooms whose
finishes are not known.

References
----------
.. [1] IES LM-83-12, "Spatial Daylight Autonomy (sDA) and Annual Sunlight Exposure (ASE)", 2.2.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.model.notes import Notes

REFLECTANCES = {
    "floor": 0.2, "wall": 0.5, "ceiling": 0.7, "door": 0.5, "frame": 0.5, "furniture": 0.5,
    "outside": 0.3, "shade": 0.3,
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


def note_reflectances(sides: Iterable[str], notes: Notes) -> None:
    """Note the reflectances that some sides of surfaces were given."""
    told = set(sides)
    for side, reflectance in REFLECTANCES.items():
        if side in told:
            notes.add(ASSUMED, f"{side} {reflectance:g}")


def without_stated(notes: Iterable[str], stated: Collection[str]) -> tuple[str, ...]:
    """Notes, whose reflectances leave out those that a case states, by their names."""
    kept = []
    for note in notes:
        sentence, _, listed = note.removesuffix(".").partition(": ")
        if sentence != ASSUMED:
            kept.append(note)
            continue
        names = [name for name in listed.split(", ") if name.split()[0] not in stated]
        kept += [f"{sentence}: {', '.join(names)}."] if names else []
    return tuple(kept)


def glass(transmittance: float | None, name: str, notes: Notes) -> GlazingMaterial:
    """Clear glass of a visible transmittance; of `TRANSMITTANCE`, with a note, where it is None."""
    if transmittance is None:
        notes.add(ASSUMED_GLASS, name)
    tau = TRANSMITTANCE if transmittance is None else transmittance
    return GlazingMaterial(type="glazing", transmittance=tau)
