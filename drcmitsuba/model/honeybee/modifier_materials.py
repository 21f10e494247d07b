"""Radiance modifiers of an HBJSON file as materials, and the BSDF files that it holds."""

from __future__ import annotations

import base64
import binascii
import lzma
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drcmitsuba.model import radiance_materials
from drcmitsuba.model.honeybee.entries import Entry, by_identifier, read_entry
from drcmitsuba.model.materials import BsdfMaterial, Lambertian, SurfaceMaterial
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance_materials import Colour, Note
from drcmitsuba.runtime.errors import InputError

LARGEST_BSDF = 256 * 2**20
"""Largest BSDF file that is unpacked [B]."""
UP = (0.01, 0.01, 1.0)
"""Up direction of a BSDF that states none."""
UPRIGHT = np.cos(np.radians(2))
"""Smallest cosine between an up direction and the vertical."""
BESIDE = ("front_diffuse_reflectance", "back_diffuse_reflectance", "diffuse_transmittance")
"""Diffuse parts that a BSDF modifier has beside its file."""


def material_of(modifier: Entry, bsdf: Mapping[str, Path], notes: Notes) -> SurfaceMaterial | None:
    """Material of a modifier; None for void. What it simplifies is added to the notes.

    Raises
    ------
    InputError
        The modifier has no counterpart, or is a BSDF whose file `bsdf` does not name.
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
    try:
        return MAKERS[kind](modifier, lambda sentence: notes.add(sentence, modifier.place))
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        remedy = f"keep each below {100 * radiance_materials.SMALL:.0f} %, or give Glass or a BSDF"
        raise modifier.refuse("type", str(error), remedy) from None


def _colour(modifier: Entry, quantity: str, default: float) -> Colour:
    """Red, green and blue of a modifier's quantity [–]."""
    r, g, b = (modifier.fraction(f"{channel}_{quantity}", default) for channel in "rgb")
    return r, g, b


def _plastic(modifier: Entry, note: Note) -> SurfaceMaterial:
    s, alpha = modifier.fraction("specularity", 0.0), modifier.fraction("roughness", 0.0)
    return radiance_materials.plastic(_colour(modifier, "reflectance", 0.0), s, alpha, note)


def _metal(modifier: Entry, note: Note) -> SurfaceMaterial:
    s, alpha = modifier.fraction("specularity", 0.9), modifier.fraction("roughness", 0.0)
    return radiance_materials.metal(_colour(modifier, "reflectance", 0.0), s, alpha, note)


def _trans(modifier: Entry, note: Note) -> SurfaceMaterial:
    """`transmitted_diff` and `transmitted_spec` are Radiance's A6 and A7."""
    keys = ("specularity", "transmitted_diff", "transmitted_spec")
    s, t, straight = (modifier.fraction(key, 0.0) for key in keys)
    colour, rough = _colour(modifier, "reflectance", 0.0), modifier.fraction("roughness", 0.0)
    return radiance_materials.trans(colour, s, rough, t, straight, note)


def _glass(modifier: Entry, note: Note) -> SurfaceMaterial:
    index = modifier.number("refraction_index", radiance_materials.INDEX)
    if not 1 < index <= 4:
        raise modifier.refuse("refraction_index", f"{index:g}", "give a number above 1, up to 4")
    return radiance_materials.glass(_colour(modifier, "transmissivity", 0.0), index, note)


def _mirror(modifier: Entry, note: Note) -> SurfaceMaterial:
    note("Mirrors reflect on both sides")
    return radiance_materials.mirror(_colour(modifier, "reflectance", 1.0), note)


MAKERS = {
    "Plastic": _plastic,
    "Metal": _metal,
    "Trans": _trans,
    "Glass": _glass,
    "Mirror": _mirror,
}
"""Materials of the modifiers that numbers describe, by type."""


def _bsdf(modifier: Entry, bsdf: Mapping[str, Path], notes: Notes) -> SurfaceMaterial:
    """Pane of a file that the caller has written; its y axis is vertical."""
    name = modifier.identifier()
    if name not in bsdf:
        remedy = f"write bsdf_xml(file)[{name!r}] to a file of your own and name it in bsdf"
        raise modifier.refuse("bsdf_data", "a BSDF within the model", remedy)
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
    return BsdfMaterial(type="bsdf", file=bsdf[name], turn=bool(z < 0))


def bsdf_xml(file: Path) -> dict[str, bytes]:
    """Content of the BSDF files that an HBJSON file holds, by the modifier's identifier.

    `read` writes no file: write these where they shall stay, and give it their paths.

    Raises
    ------
    InputError
        The file is no HBJSON file, or its data is no XML, plain or packed by gzip, zlib or LZMA
        as base64, of at most 256 MiB together.
    """
    radiance = read_entry(file).inner("properties", "radiance")
    modifiers = radiance.entries("modifiers")
    modifiers += radiance.inner("global_modifier_set").entries("modifiers")
    files, left = {}, LARGEST_BSDF
    for name, modifier in by_identifier(m for m in modifiers if m.text("type") == "BSDF").items():
        files[name] = _unpacked(modifier, left)
        left -= len(files[name])
    return files


def _unpacked(modifier: Entry, most: int) -> bytes:
    """XML of a BSDF modifier, of at most so many bytes."""
    packed = (modifier.text("bsdf_data") or "").encode()
    try:
        content = packed if b"<" in packed[:100] else _inflated(base64.b64decode(packed), most)
    except (binascii.Error, zlib.error, lzma.LZMAError, EOFError):
        content = b""
    if b"<" not in content[:100] or len(content) > most:
        got = "larger than 256 MiB" if len(content) > most else "no XML, plain or packed"
        raise modifier.refuse("bsdf_data", got, "export the model again")
    return content


def _inflated(packed: bytes, most: int) -> bytes:
    """Bytes that gzip, zlib or LZMA packed, up to one above the most."""
    if packed[:3] == b"\xfd7z" or packed[:3] == b"\x5d\x00\x00":
        return lzma.LZMADecompressor(memlimit=LARGEST_BSDF).decompress(packed, most + 1)
    if packed[:2] == b"\x1f\x8b" or packed[:1] == b"\x78":
        return zlib.decompressobj(wbits=47).decompress(packed, most + 1)
    return packed
