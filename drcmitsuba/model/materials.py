"""Materials of surfaces: the tables `[materials.NAME]` of a case, and what users' models hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from drcmitsuba.model import glass
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Fraction, Table

Reflectance = Fraction | tuple[Fraction, Fraction, Fraction]
"""One reflectance (grey), or three for red, green and blue [–]."""


ByIncidence = Fraction | Annotated[tuple[Fraction, ...], Field(min_length=2, max_length=2049)]
"""Share of the light at any incidence, or at equal steps of its cosine from 0 to 1 [–]."""


def mean_by_incidence(share: float | tuple[float, ...]) -> float:
    """Mean of a `ByIncidence` over light that arrives evenly from a hemisphere [–].

    It is 2 ∫ share(c) c dc over the cosine c from 0 to 1, with the share linear between its steps.
    """
    values = np.ravel(share)
    if len(values) == 1:
        return float(values[0])
    c = np.linspace(0, 1, len(values))
    low, high = values[:-1], values[1:]
    step = c[1]
    return float((step * (c[:-1] * (low + high) + step * (low + 2 * high) / 3)).sum())


def check_energy(transmittance: float, reflectance: float, exponent: float = 0.0) -> None:
    """Raise InputError for a pane whose transmittance and reflectance [–] together exceed 1.

    Both are those at normal incidence. The exponent p of a glazing [–] is checked at 201
    incidences; it is 0 for other panes.
    """
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
    """Clear pane: transmittance τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ], reflectance after Schlick.

    With a refractive index, both follow Fresnel's formulas for one pane, as Radiance's `glass`.
    """

    type: Literal["glazing"]
    """Kind of the material."""
    transmittance: Fraction
    """Transmittance τ₀ at normal incidence [–]."""
    exponent: Annotated[float, Field(gt=0, le=100)] = 4.5
    """Exponent p [–]: a larger p keeps the transmittance near τ₀ up to larger incidences."""
    reflectance: Fraction = 0.0
    """Reflectance towards the room, at normal incidence [–]."""
    ior: Annotated[float, Field(gt=1, le=4)] | None = None
    """Refractive index of a single pane [–], which gives reflectance and exponent: leave them."""

    @model_validator(mode="before")
    @classmethod
    def _by_index(cls, table: Any) -> Any:
        """Give a pane with a refractive index its reflectance at normal incidence."""
        if not isinstance(table, dict) or not isinstance(table.get("ior"), float | int):
            return table
        tau, ior = table.get("transmittance"), float(table["ior"])
        if not isinstance(tau, float | int) or not 1 < ior <= 4 or not 0 <= tau <= 1:
            return table
        if tau > glass.most(ior) + 1e-9:
            got = f"{tau:g}, and a clear pane of this index has {glass.most(ior):.3f}"
            raise InputError("material", "transmittance", got, "lower it, or leave out ior")
        t = glass.transmissivity(min(tau, glass.most(ior)), ior)
        rho = float(glass.pane(np.array([t]), ior, np.ones(1))[1][0, 0])
        for name, own in (("reflectance", rho), ("exponent", 4.5)):
            if table.get(name, own) != own:
                got = f"{table[name]} beside the refractive index, from which it follows"
                raise InputError("material", name, got, "give one of them")
        return {**table, "reflectance": rho}

    @property
    def sides(self) -> tuple[float, float]:
        """Reflectances of the room's side and of the other one, at normal incidence [–]."""
        return self.reflectance, self.reflectance if self.ior is not None else 0.0

    @model_validator(mode="after")
    def _energy(self) -> GlazingMaterial:
        if self.ior is None:
            check_energy(self.transmittance, self.reflectance, self.exponent)
        return self

    def multiple_of(self, other: SurfaceMaterial | None) -> float | None:
        """Factor of another pane whose light this one lets through times it; None without such.

        Panes by an exponent that reflect nothing are multiples of one another, at all incidences,
        of light that passes them once.
        """
        if not isinstance(other, GlazingMaterial) or self.ior is not None or self.reflectance:
            return None
        if other.transmittance == 0:
            return None
        same = self.model_copy(update={"transmittance": other.transmittance}) == other
        return self.transmittance / other.transmittance if same else None

    def tables(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Transmittance and reflectance at `count` equal steps of cos θ from 0 to 1, by the index.

        Returns
        -------
        transmittance, reflectance : np.ndarray, shape (count,)
        """
        assert self.ior is not None
        t = glass.transmissivity(min(self.transmittance, glass.most(self.ior)), self.ior)
        tau, rho = glass.pane(np.array([t]), self.ior, np.linspace(0, 1, count))
        return tau[:, 0], rho[:, 0]


class DiffuserMaterial(Table):
    """Diffusing pane, such as a sun shade: Lambertian transmittance and reflectance.

    A fabric lets a part of the light through its holes, straight on.
    """

    type: Literal["diffuser"]
    """Kind of the material."""
    transmittance: ByIncidence
    """Share of the light that is scattered through [–]; several numbers are shares at equal steps
    of the cosine of the incidence, from 0 to 1."""
    reflectance: Fraction = 0.0
    """Reflectance towards the room [–]."""
    outer_reflectance: Fraction = 0.0
    """Reflectance of the other side [–]."""
    straight: ByIncidence = 0.0
    """Share of the light that goes straight through [–]; several numbers are as above."""

    @property
    def sides(self) -> tuple[float, float]:
        """Reflectances of the room's side and of the other one [–]."""
        return self.reflectance, self.outer_reflectance

    @property
    def scattered(self) -> float:
        """Share of light from everywhere alike that is scattered through [–]."""
        return mean_by_incidence(self.transmittance)

    @property
    def most_straight(self) -> float:
        """Largest share of the light that goes straight through [–]."""
        return max(np.ravel(self.straight).tolist())

    @property
    def most_through(self) -> float:
        """Largest share of the light that goes through at any incidence, in either way [–]."""
        c = np.linspace(0, 1, 2049)
        ways = (np.ravel(each) for each in (self.transmittance, self.straight))
        through = sum(np.interp(c, np.linspace(0, 1, len(w)), w) for w in ways)
        return float(np.max(through))

    @model_validator(mode="after")
    def _energy(self) -> DiffuserMaterial:
        check_energy(self.most_through, max(self.sides))
        return self


class BsdfMaterial(Table):
    """Pane with a measured BSDF: film, fabric, blind. The file describes pane and glass."""

    type: Literal["bsdf"]
    """Kind of the material."""
    file: Path
    """LBNL XML file, tensor tree or Klems matrix; relative to the case file."""
    straight_through: Literal["auto", "on", "off"] = "auto"
    """Whether light goes through undeviated, as a view; "auto": where the file has such a peak."""
    flip: bool = False
    """Whether the file's front faces the room; by the format its back does."""
    turn: bool = False
    """Whether the pane is mounted upside down."""


class FacedBsdf(BsdfMaterial):
    """Pane with a measured BSDF of a model's own: the corners of its polygons tell its front."""


class BsdfInBand(BsdfMaterial):
    """Pane with a measured BSDF in a band of the spectrum."""

    mix: tuple[float, ...]
    """Weights of red, green and blue in the band, or one weight of the luminance alone."""


class FacedBsdfInBand(FacedBsdf, BsdfInBand):
    """Such a pane of a model's own."""


class MirrorMaterial(Table):
    """Mirror of a component, the same on both sides."""

    type: Literal["mirror"]
    """Kind of the material."""
    reflectance: Fraction
    """Reflectance at any incidence [–]; under a coating, the reflectance of the mirror alone."""
    roughness: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Roughness α of the distribution; 0 is a perfect mirror [–]."""
    distribution: Literal["ggx", "beckmann"] = "ggx"
    """Distribution of the facets of a rough mirror; Beckmann's is next to Ward's, of Radiance."""
    coating: Annotated[float, Field(gt=1, le=4)] | None = None
    """Refractive index of a clear coating, or of the glass in front of the mirror [–]."""
    specular: Fraction = 1.0
    """Fraction of the reflected light that is mirrored; the rest is diffuse [–]."""
    polished: bool = False
    """Whether more is mirrored at grazing incidence, as of Radiance's smooth plastic and metal;
    reflectance and fraction are then those at normal incidence."""

    @property
    def mirrored(self) -> float:
        """Share of the light that is mirrored, at normal incidence and without a coating [–]."""
        return self.specular * self.reflectance

    @property
    def matt(self) -> float:
        """Share of the light that is reflected diffusely, at normal incidence [–]."""
        return (1 - self.specular) * self.reflectance

    @model_validator(mode="after")
    def _smooth(self) -> MirrorMaterial:
        if self.polished and (self.roughness > 0 or self.coating is not None):
            got = "true, for a surface that is rough or coated"
            raise InputError("material", "polished", got, "leave out roughness and coating")
        return self

    @model_validator(mode="after")
    def _clear_coating(self) -> MirrorMaterial:
        if self.coating is not None and self.roughness > 0:
            got = f"with a roughness of {self.roughness:g}"
            remedy = "coatings are for smooth mirrors: drop one"
            raise InputError("material", "coating", got, remedy)
        return self


class DielectricMaterial(Table):
    """Clear solid of a component, air outside; normals of its surface point outward."""

    type: Literal["dielectric"]
    """Kind of the material."""
    ior: Annotated[float, Field(gt=1, le=4)]
    """Refractive index [–]."""
    absorption: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    """Absorption coefficient [1/m]; the share exp(−absorption · length) of the light remains."""
    roughness: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Roughness α of the GGX distribution; 0 is smooth [–]."""


class PorousMaterial(Table):
    """Foliage, grid or mesh outside, the same on both sides: gaps that light passes straight."""

    type: Literal["porous"]
    """Kind of the material."""
    porosity: Fraction
    """Share of the light that passes each surface straight, at any incidence [–]."""
    reflectance: Reflectance = 0.0
    """Diffuse reflectance of what is not a gap [–]."""


Material = Annotated[
    GlazingMaterial
    | DiffuserMaterial
    | BsdfMaterial
    | MirrorMaterial
    | DielectricMaterial
    | PorousMaterial,
    Field(discriminator="type"),
]


@dataclass(frozen=True)
class Lambertian:
    """Opaque diffuse surface: room, furniture, context."""

    reflectance: Reflectance
    """Reflectance of the front [–], and of the back where that has none of its own."""
    behind: Reflectance | None = None
    """Reflectance of the back [–], where it differs: a wall between two rooms, a slab."""
    polish: float = 0.0
    """Share of the light that a smooth surface mirrors at normal incidence, part of its
    reflectance [–]; a surface in few planes mirrors it, and more at grazing incidence."""

    @property
    def sides(self) -> tuple[Reflectance, Reflectance]:
        """Reflectances of front and back [–]."""
        return self.reflectance, self.reflectance if self.behind is None else self.behind


def two_sided(front: Lambertian, back: Lambertian) -> Lambertian:
    """Sheet with the front of one material before and that of another behind."""
    rho, other = front.reflectance, back.reflectance
    return Lambertian(rho, None if other == rho else other)


SurfaceMaterial = (
    Lambertian
    | GlazingMaterial
    | DiffuserMaterial
    | BsdfMaterial
    | MirrorMaterial
    | DielectricMaterial
    | PorousMaterial
)
