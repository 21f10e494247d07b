"""Materials of the case as Mitsuba BSDFs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drcmitsuba.case import DiffuserMaterial, GlazingMaterial, Reflectance


@dataclass(frozen=True)
class Lambertian:
    """Opaque diffuse surface, the same on both sides."""

    reflectance: Reflectance


SurfaceMaterial = Lambertian | GlazingMaterial | DiffuserMaterial


def channel_of(reflectance: Reflectance, channel: int) -> float:
    """Reflectance in one colour channel; a grey one is the same in all."""
    return float(reflectance[channel] if isinstance(reflectance, tuple) else reflectance)


def bsdf(material: SurfaceMaterial, channel: int = 0) -> dict[str, Any]:
    """Mitsuba dictionary of a material.

    Parameters
    ----------
    material : Lambertian, GlazingMaterial or DiffuserMaterial
    channel : int
        Colour channel that is simulated: 0 for grey and red, 1 for green, 2 for blue.

    Returns
    -------
    dict
        For `mi.load_dict`. Panes reflect towards the room only: what a façade reflects to the
        outside can return to a sensor only by way of other buildings.
    """
    if isinstance(material, Lambertian):
        value = channel_of(material.reflectance, channel)
        inner = {"type": "diffuse", "reflectance": {"type": "uniform", "value": value}}
        return {"type": "twosided", "bsdf": inner}
    if isinstance(material, GlazingMaterial):
        return {
            "type": "glazing",
            "transmittance": material.transmittance,
            "exponent": material.exponent,
            "reflectance_front": material.reflectance,
            "reflectance_back": 0.0,
        }
    return {
        "type": "diffuser",
        "transmittance": material.transmittance,
        "reflectance_front": material.reflectance,
        "reflectance_back": 0.0,
    }
