"""The materials of a case: panes of its façades, mirrors and clear solids of its components."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from drcmitsuba.case.toml import Fraction, Table
from drcmitsuba.runtime.errors import InputError

Reflectance = Fraction | tuple[Fraction, Fraction, Fraction]
"""A grey reflectance, or one for red, green and blue."""


def check_energy(transmittance: float, reflectance: float, exponent: float = 0.0) -> None:
    """Refuse a pane that sends out more than it gets; glass (exponent > 0) at any incidence."""
    x = 1 - np.linspace(0, 1, 201)
    total = np.array([transmittance + reflectance])
    if exponent > 0:
        mirrored = reflectance + (1 - reflectance) * x**5 if reflectance > 0 else 0 * x
        total = transmittance * (1 - x**exponent) + mirrored
    if total.max() > 1 + 1e-9:
        got = f"{transmittance:g} + {reflectance:g} is above 1"
        if transmittance + reflectance <= 1:
            angle = np.degrees(np.arccos(1 - x[total.argmax()]))
            got = f"together {total.max():.3f} at an incidence of {angle:.0f}°"
        raise InputError("material", "transmittance + reflectance", got, "lower one of them")


class GlazingMaterial(Table):
    """Clear pane: τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ], mirrored share after Schlick."""

    type: Literal["glazing"]
    transmittance: Fraction
    exponent: Annotated[float, Field(gt=0, le=100)] = 4.5
    reflectance: Fraction = 0.0
    """Towards the room, at normal incidence."""

    @model_validator(mode="after")
    def _energy(self) -> GlazingMaterial:
        check_energy(self.transmittance, self.reflectance, self.exponent)
        return self


class DiffuserMaterial(Table):
    """Diffusing pane, such as a sun shade: Lambertian transmittance and reflectance."""

    type: Literal["diffuser"]
    transmittance: Fraction
    reflectance: Fraction = 0.0
    """Towards the room."""

    @model_validator(mode="after")
    def _energy(self) -> DiffuserMaterial:
        check_energy(self.transmittance, self.reflectance)
        return self


class BsdfMaterial(Table):
    """Pane with a measured BSDF: film, fabric, blind. The file describes all of it, glass too."""

    type: Literal["bsdf"]
    file: Path
    """LBNL XML: tensor tree or Klems; relative to the case file."""
    straight_through: Literal["auto", "on", "off"] = "auto"
    """Whether a straight-through peak counts as a view through; auto: where the file has one."""
    flip: bool = False
    """The file's front faces the room; by the format its back does."""
    turn: bool = False
    """Mounted upside down."""


class MirrorMaterial(Table):
    """Mirror of a component, the same on both sides."""

    type: Literal["mirror"]
    reflectance: Fraction
    """At any incidence; of a coated one, that of the mirror below its coating."""
    roughness: Annotated[float, Field(ge=0, le=1)] = 0.0
    """GGX's α; 0 is a perfect mirror."""
    coating: Annotated[float, Field(gt=1, le=4)] | None = None
    """Refractive index of a clear coating or of the glass before the mirror."""
    specular: Fraction = 1.0
    """Part of the reflected light that is mirrored; the rest is diffuse."""

    @model_validator(mode="after")
    def _clear_coating(self) -> MirrorMaterial:
        if self.coating is not None and self.roughness > 0:
            got = f"with a roughness of {self.roughness:g}"
            raise InputError(
                "material", "coating", got, "coatings are for smooth mirrors: drop one"
            )
        return self


class DielectricMaterial(Table):
    """Clear solid of a component, air outside; normals of its surface point outward."""

    type: Literal["dielectric"]
    ior: Annotated[float, Field(gt=1, le=4)]
    absorption: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    """Of light on its way through [1/m]: exp(−absorption · length) is left."""
    roughness: Annotated[float, Field(ge=0, le=1)] = 0.0
    """GGX's α; 0 is smooth."""


Material = Annotated[
    GlazingMaterial | DiffuserMaterial | BsdfMaterial | MirrorMaterial | DielectricMaterial,
    Field(discriminator="type"),
]
