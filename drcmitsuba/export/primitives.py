"""Materials and surfaces as primitives of Radiance, each the nearest to the engine's own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drcmitsuba.model.glass import transmissivity
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    SurfaceMaterial,
)
from drcmitsuba.scene.geometry import normals, turn
from drcmitsuba.scene.materials import channel_of, lets_through

LONGEST = 40
"""Largest number of characters of a name that are kept in an identifier."""
GLAZING_FILE = "glazing.cal"
GLAZING = """{
Clear pane: arg(10) transmittance at normal incidence, arg(11) its exponent,
arg(12) reflectance at normal incidence of the side that faces the room (Rdot > 0).
}
opposite = 1 - abs(Rdot);
tau = arg(10) * (1 - opposite^arg(11));
rho = if(arg(12), if(Rdot, arg(12) + (1 - arg(12)) * opposite^5, 0), 0);
"""
"""Function file of clear panes: the engine's own formulas of `GlazingMaterial`."""
UNCOATED = 1.1e-3
"""Roughness of `metal` from which on Radiance adds no Fresnel reflection of its own; 0.06°."""


@dataclass(frozen=True)
class RadianceTwin:
    """A material in Radiance."""

    text: str
    """Primitive on one line."""
    difference: str = ""
    """How it differs from the engine's material; "" where it is the same."""


def identifier(name: str) -> str:
    """Name in letters, digits, `_`, `.` and `-` alone: names come from strangers."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:LONGEST] or "unnamed"


def _numbers(values: object) -> str:
    return " ".join(f"{v:.9g}" for v in np.ravel(np.asarray(values, float)).tolist())


def twin(
    modifier: str, material: SurfaceMaterial, quads: np.ndarray, file: str | Path = "",
    clockwise: float = 0.0,
) -> RadianceTwin:  # fmt: skip
    """Make the primitive of a material.

    Parameters
    ----------
    modifier : str
        Name of the primitive, an `identifier`.
    material : SurfaceMaterial
    quads : np.ndarray, shape (quad, 4, 3)
        Corners of its surface [m]; of a measured pane, all level or none, see `are_level`.
    file : str or Path
        BSDF file of a measured pane, as Radiance finds it.
    clockwise : float
        Angle of the room in the world [deg], with which horizontal measured panes turn.

    Returns
    -------
    Twin
    """
    if isinstance(material, Lambertian):
        colours = [_numbers([channel_of(side, i) for i in range(3)]) for side in material.sides]
        if material.behind is None:
            return RadianceTwin(f"void plastic {modifier} 0 0 5 {colours[0]} 0 0")
        front, back = (f"{modifier}_{side}" for side in ("front", "back"))
        lines = [
            f"void plastic {front} 0 0 5 {colours[0]} 0 0",
            f"void plastic {back} 0 0 5 {colours[1]} 0 0",
            # Rdot, the cosine at which the ray arrives, is positive on the front.
            f"void mixfunc {modifier} 4 {front} {back} if(Rdot,1,0) . 0 0",
        ]
        return RadianceTwin("\n".join(lines))
    if isinstance(material, PorousMaterial):
        return _porous(modifier, material)
    if isinstance(material, GlazingMaterial) and material.ior is not None:
        t = transmissivity(material.transmittance, material.ior)
        text = f"void glass {modifier} 0 0 4 {_numbers([t] * 3)} {_numbers(material.ior)}"
        return RadianceTwin(text, "glass mirrors the sun to no other surface")
    if isinstance(material, GlazingMaterial):
        shape = [material.transmittance, material.exponent, material.reflectance]
        names = f"rho rho rho tau tau tau 0 0 0 {GLAZING_FILE}"
        return RadianceTwin(f"void BRTDfunc {modifier} 10 {names} 0 12 {_numbers([0] * 9 + shape)}")
    if isinstance(material, DiffuserMaterial):
        return _diffuser(modifier, material)
    if isinstance(material, BsdfMaterial):
        return RadianceTwin(_film(modifier, material, quads, file, clockwise))
    if isinstance(material, MirrorMaterial):
        return _mirror(modifier, material)
    return _dielectric(modifier, material)


def _porous(modifier: str, material: PorousMaterial) -> RadianceTwin:
    """A porous surface as `trans` whose transmitted light goes straight: C t passes, C (1 − t) not.

    One t serves all channels: under a coloured C the light that passes is coloured, too.
    """
    gaps, rho = material.porosity, material.reflectance
    solid = (1 - gaps) * np.array([channel_of(rho, i) for i in range(3)])
    grey = (1 - gaps) * channel_of(rho, -1)
    share = gaps / (gaps + grey) if gaps else 0.0
    colour = solid / (1 - share) if grey else np.full(3, gaps)
    text = f"void trans {modifier} 0 0 7 {_numbers(colour)} 0 0 {_numbers([share, 1.0])}"
    coloured = gaps > 0 and isinstance(rho, tuple) and len(set(rho)) > 1
    return RadianceTwin(
        text, "the light that passes gaps of coloured bodies is coloured" * coloured
    )


def _diffuser(modifier: str, material: DiffuserMaterial) -> RadianceTwin:
    """A diffusing pane as `trans`, which reflects on both sides.

    What goes straight through is that of normal incidence, what is scattered the mean.
    """
    straight = float(np.ravel(material.straight)[-1])
    through = material.scattered + straight
    albedo = through + material.reflectance
    shares = through / albedo if albedo else 1.0, straight / through if straight else 0.0
    text = f"void trans {modifier} 0 0 7 {_numbers([albedo] * 3)} 0 0 {_numbers(shares)}"
    inner, outer = material.sides
    differs = ["a diffusing pane reflects alike to the outside"] * (inner != outer)
    if np.ptp(material.straight) > 0:
        differs.append("a fabric lets as much straight through as at normal incidence")
    if np.ptp(material.transmittance) > 0:
        differs.append("a pane scatters the same share of light from any direction")
    return RadianceTwin(text, "; ".join(differs))


def are_level(quads: np.ndarray) -> np.ndarray:
    """Whether quads (quad, 4, 3) are horizontal, bool, shape (quad,)."""
    return np.asarray(abs(normals(quads)[:, 2]) > 1 - 1e-8)


def _film(
    modifier: str, material: BsdfMaterial, quads: np.ndarray, file: str | Path, clockwise: float
) -> str:
    """A pane with a measured BSDF; the front of its polygons is the room's side, as in the file.

    `aBSDF` for a file with a straight-through peak, else `BSDF` without thickness. On a horizontal
    pane the file's y axis is the room's.
    """
    up = turn(clockwise) @ (0, 1, 0) if are_level(quads[:1])[0] else np.array([0, 0, 1])
    up = up * (-1 if material.turn else 1)
    if lets_through(material):
        return f'void aBSDF {modifier} 5 "{file}" {_numbers(up)} . 0 0'
    return f'void BSDF {modifier} 6 0 "{file}" {_numbers(up)} . 0 0'


def _mirror(modifier: str, material: MirrorMaterial) -> RadianceTwin:
    """A mirror as `metal`, because the back of Radiance's `mirror` is black.

    A polished one is smooth: Radiance then mirrors more at grazing incidence by the same formula.

    Ward's lobe is next to Beckmann's; GGX's of the same number is wider and has long tails.
    """
    reflectance, shine = material.reflectance, material.specular
    has_tails = material.roughness > 0 and material.distribution == "ggx"
    difference = "a rough mirror's lobe has another shape" if has_tails else ""
    least = 0.0 if material.polished else UNCOATED
    if material.coating is not None:
        fresnel = ((material.coating - 1) / (material.coating + 1)) ** 2
        coated = fresnel + (1 - fresnel) ** 2 * reflectance / (1 - fresnel * reflectance)
        matt = (1 - shine) * reflectance
        reflectance = shine * coated + matt
        shine = shine * coated / reflectance if reflectance else 1.0
        difference = "a coated mirror reflects at any incidence what it does at a normal one"
    finish = _numbers([shine, max(material.roughness, least)])
    return RadianceTwin(
        f"void metal {modifier} 0 0 5 {_numbers([reflectance] * 3)} {finish}", difference
    )


def _dielectric(modifier: str, material: DielectricMaterial) -> RadianceTwin:
    """A clear solid whose normals point outward."""
    colour = _numbers([np.exp(-material.absorption)] * 3)
    text = f"void dielectric {modifier} 0 0 5 {colour} {_numbers(material.ior)} 0"
    return RadianceTwin(text, "a rough solid is smooth" if material.roughness else "")


def polygon(modifier: str, name: str, corners: np.ndarray) -> str:
    """A polygon (corner, 3) [m]; the second of two equal corners is left out."""
    return _polygons(modifier, [name], corners[None])[0]


def polygons(modifier: str, material: SurfaceMaterial, quads: np.ndarray) -> list[str]:
    """Polygons of a surface, quads (quad, 4, 3) [m]; reversed where a measured pane is flipped.

    Quads of fewer than three distinct corners, which Radiance refuses, are left out.
    """
    if isinstance(material, BsdfMaterial) and material.flip:
        quads = quads[:, ::-1]
    return _polygons(modifier, [f"{modifier}.{k}" for k in range(len(quads))], quads)


def _polygons(modifier: str, names: Sequence[str], corners: np.ndarray) -> list[str]:
    kept = (corners != np.roll(corners, 1, axis=1)).any(axis=2)
    lines = []
    for name, points, keep in zip(names, corners, kept, strict=True):
        numbers = points[keep].ravel().tolist()
        if len(numbers) >= 9:
            form = " ".join(["%.9g"] * len(numbers))
            lines.append(f"{modifier} polygon {name} 0 0 {len(numbers)} {form % tuple(numbers)}")
    return lines
