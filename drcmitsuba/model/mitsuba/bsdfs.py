"""BSDFs of Mitsuba as materials of the engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from drcmitsuba.model import glass
from drcmitsuba.model.materials import (
    DielectricMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.mitsuba.entries import DEEPEST, SceneEntries, SceneEntry
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance_materials import greyed, luminance

MATT = "Plastics are diffuse, without their clear coat"
BOTH_SIDES = "Surfaces reflect on both sides"
UNBUMPED = "Bumps are left out"
INDICES = {"vacuum": 1.0, "air": 1.000277, "water": 1.333, "acrylic glass": 1.49, "bk7": 1.5046}
"""Refractive indices of materials by name [–]."""
NAMED = "give it in [materials] under its id"


def _index(entry: SceneEntry) -> float:
    """Refractive index inside relative to air outside [–]."""
    indices = []
    for name, default in (("int_ior", "bk7"), ("ext_ior", "air")):
        value = entry.values.get(name, default)
        if isinstance(value, str):
            if value.lower() not in INDICES:
                raise entry.error(name, f"{value:.60}", "give a number")
            value = INDICES[value.lower()]
        else:
            value = entry.number(name, 1)
        indices.append(value)
    inside, outside = indices
    if not 0.999 < outside < 1.001 or not 1 < inside <= 4:
        got = f"{inside:g} within {outside:g}"
        raise entry.error("int_ior", got, "give an index of 1 to 4 in air")
    return inside


def _diffuse(entry: SceneEntry, notes: Notes) -> SurfaceMaterial:
    notes.add(BOTH_SIDES)
    return Lambertian(entry.reflectance("reflectance", 0.5))


def _plastic(entry: SceneEntry, notes: Notes) -> SurfaceMaterial:
    notes.add(MATT, entry.id)
    return Lambertian(entry.reflectance("diffuse_reflectance", 0.5))


def _alpha(entry: SceneEntry) -> float:
    if not entry.type.startswith("rough"):
        return 0.0
    value = entry.number("alpha", 0.1)
    if not 0 <= value <= 1:
        raise entry.error("alpha", f"{value:g}", "give 0 to 1")
    return value


def _conductor(entry: SceneEntry, notes: Notes) -> SurfaceMaterial:
    if entry.values.get("material") != "none":
        got = f"the metal {entry.values.get('material', 'by eta and k')!r:.60}"
        raise entry.error("material", got, NAMED)
    rho = entry.reflectance("specular_reflectance", 1.0)
    if isinstance(rho, tuple):
        notes.add(greyed(np.array(rho)), entry.id)
        rho = float(luminance(np.array(rho)))
    alpha = _alpha(entry)
    if alpha == 0:
        return MirrorMaterial(type="mirror", reflectance=rho)
    shape = str(entry.values.get("distribution", "beckmann"))
    if shape not in ("beckmann", "ggx"):
        raise entry.error("distribution", f"{shape!r:.60}", "give beckmann or ggx")
    lobe: dict[str, Any] = {"roughness": alpha, "distribution": shape}
    return MirrorMaterial(type="mirror", reflectance=rho, **lobe)


def _dielectric(entry: SceneEntry, notes: Notes) -> SurfaceMaterial:
    return DielectricMaterial(type="dielectric", ior=_index(entry), roughness=_alpha(entry))


def _pane(entry: SceneEntry, notes: Notes) -> SurfaceMaterial:
    ior = _index(entry)
    return GlazingMaterial(type="glazing", transmittance=glass.most(ior), ior=ior)


BSDFS: dict[str, Callable[[SceneEntry, Notes], SurfaceMaterial]] = {
    "diffuse": _diffuse,
    **dict.fromkeys(("plastic", "roughplastic"), _plastic),
    **dict.fromkeys(("conductor", "roughconductor"), _conductor),
    **dict.fromkeys(("dielectric", "roughdielectric"), _dielectric),
    "thindielectric": _pane,
}
"""BSDFs that are read."""
AROUND = ("twosided", "bumpmap", "normalmap")
"""BSDFs that hold another one."""


def innermost(entry: SceneEntry, scene: SceneEntries, notes: Notes) -> SceneEntry:
    """BSDF within those that only wrap it."""
    for _ in range(DEEPEST):
        if entry.type not in AROUND:
            return entry
        every = (scene.resolved(child) for child in entry.children.values())
        inner = [e for e in every if e.kind == "bsdf" or e.type in (*BSDFS, *AROUND)]
        if not inner:
            raise entry.error("bsdf", "none within", "give one")
        if len(inner) > 1:
            raise entry.error("bsdf", "one for each side", "give one for both")
        if entry.type != "twosided":
            notes.add(UNBUMPED, entry.id)
        entry = inner[0]
    raise entry.error("bsdf", f"more than {DEEPEST} around each other", "take some out")


def material_of(entry: SceneEntry, notes: Notes) -> SurfaceMaterial:
    """Material of a BSDF that wraps no other.

    Raises
    ------
    InputError
        The BSDF has no counterpart, or a texture.
    """
    if entry.type not in BSDFS:
        remedy = f"only {', '.join((*BSDFS, *AROUND))} are read; {NAMED}"
        raise entry.error("type", entry.type, remedy)
    return BSDFS[entry.type](entry, notes)
