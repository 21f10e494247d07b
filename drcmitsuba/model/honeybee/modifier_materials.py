"""Radiance modifiers of an HBJSON file as materials."""

from __future__ import annotations

import numpy as np

from drcmitsuba.model import radiance_materials
from drcmitsuba.model.honeybee.bsdf_files import BsdfFiles
from drcmitsuba.model.honeybee.entries import JsonEntry
from drcmitsuba.model.materials import FacedBsdf, Lambertian, SurfaceMaterial
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance_materials import Colour, Note

UP = (0.01, 0.01, 1.0)
"""Up direction of a BSDF that states none."""
UPRIGHT = np.cos(np.radians(2))
"""Smallest cosine between an up direction and the vertical."""
BESIDE = ("front_diffuse_reflectance", "back_diffuse_reflectance", "diffuse_transmittance")
"""Diffuse parts that a BSDF modifier has beside its file."""


def material_of(modifier: JsonEntry, bsdf: BsdfFiles, notes: Notes) -> SurfaceMaterial | None:
    """Material of a modifier; None for void. What it simplifies is added to the notes.

    Raises
    ------
    InputError
        The modifier has no counterpart, or is a BSDF whose data is no XML.
    """
    kind = modifier.text("type") or ""
    pattern = modifier.fields.get("modifier")
    if isinstance(pattern, dict) and pattern.get("type") != "Void":
        got = f"modified by a {pattern.get('type')}"
        raise modifier.refuse("modifier", got, "take the pattern or texture out")
    if kind == "Void":
        return None
    if kind in ("Light", "Glow"):
        notes.add("Daylight is the only light: lamps are black", modifier.place)
        return Lambertian(0.0)
    if kind == "BSDF":
        return _bsdf(modifier, bsdf, notes)
    if kind not in MAKERS:
        known = ", ".join([*MAKERS, "BSDF", "Light", "Glow", "Void"])
        raise modifier.refuse("type", kind or "missing", f"choose one of {known}")
    return MAKERS[kind](modifier, lambda sentence: notes.add(sentence, modifier.place))


def _colour(modifier: JsonEntry, quantity: str, default: float) -> Colour:
    """Red, green and blue of a modifier's quantity [–]."""
    r, g, b = (modifier.fraction(f"{channel}_{quantity}", default) for channel in "rgb")
    return r, g, b


def _plastic(modifier: JsonEntry, note: Note) -> SurfaceMaterial:
    s, alpha = modifier.fraction("specularity", 0.0), modifier.fraction("roughness", 0.0)
    return radiance_materials.plastic(_colour(modifier, "reflectance", 0.0), s, alpha, note)


def _metal(modifier: JsonEntry, note: Note) -> SurfaceMaterial:
    s, alpha = modifier.fraction("specularity", 0.9), modifier.fraction("roughness", 0.0)
    return radiance_materials.metal(_colour(modifier, "reflectance", 0.0), s, alpha, note)


def _trans(modifier: JsonEntry, note: Note) -> SurfaceMaterial:
    """`transmitted_diff` and `transmitted_spec` are Radiance's A6 and A7."""
    keys = ("specularity", "transmitted_diff", "transmitted_spec")
    s, t, straight = (modifier.fraction(key, 0.0) for key in keys)
    colour, rough = _colour(modifier, "reflectance", 0.0), modifier.fraction("roughness", 0.0)
    return radiance_materials.trans(colour, s, rough, t, straight, note)


def _glass(modifier: JsonEntry, note: Note) -> SurfaceMaterial:
    index = modifier.number("refraction_index", radiance_materials.INDEX)
    if not 1 < index <= 4:
        raise modifier.refuse("refraction_index", f"{index:g}", "give a number above 1, up to 4")
    return radiance_materials.glass(_colour(modifier, "transmissivity", 0.0), index, note)


def _mirror(modifier: JsonEntry, note: Note) -> SurfaceMaterial:
    alternate = modifier.fields.get("alternate_material")
    if alternate is not None:
        if not isinstance(alternate, dict) or alternate.get("type") == "Void":
            got = "void as its alternate material, so it is seen by the sun only"
            remedy = "take out the mirror or what it hides"
            raise modifier.refuse("alternate_material", got, remedy)
        note(radiance_materials.REPLACED)
    note(radiance_materials.BOTH_SIDES)
    return radiance_materials.mirror(_colour(modifier, "reflectance", 1.0), note)


MAKERS = {
    "Plastic": _plastic,
    "Metal": _metal,
    "Trans": _trans,
    "Glass": _glass,
    "Mirror": _mirror,
}
"""Materials of the modifiers that numbers describe, by type."""


def _bsdf(modifier: JsonEntry, bsdf: BsdfFiles, notes: Notes) -> SurfaceMaterial:
    """Pane whose file the model holds, or the caller has written; its y axis is vertical."""
    if modifier.number("thickness", 0.0) != 0:
        got = f"{modifier.number('thickness', 0.0):g}: it stands for geometry that it hides"
        raise modifier.refuse("thickness", got, "give the geometry, or a thickness of 0")
    for key in BESIDE:
        if modifier.fields.get(key) is not None and modifier.vector(key).any():
            raise modifier.refuse(key, "beside those of its file", "take it into the file")
    if modifier.text("transform") or (modifier.text("function_file") or ".") != ".":
        raise modifier.refuse("transform", "a function or a transform", "take it into the file")
    x, y, z = modifier.vector("up_orientation") if modifier.sequence("up_orientation") else UP
    if abs(z) < UPRIGHT * float(np.hypot(np.hypot(x, y), z)) or z == 0:
        remedy = "turn the file, so that its y axis is vertical"
        raise modifier.refuse("up_orientation", f"{x:g} {y:g} {z:g}", remedy)
    notes.add("BSDF files have their y axis upright; on horizontal panes, along y", modifier.place)
    return FacedBsdf(type="bsdf", file=bsdf.file(modifier), turn=bool(z < 0))
