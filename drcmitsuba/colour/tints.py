"""Surfaces in a band: materials whose amounts are those of one wavelength."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from drcmitsuba_plugins.energy import EXCESS

from drcmitsuba.case.case import Case
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.spectra import Spectrum, of_rgb, smooth_mixes, spectrum_of
from drcmitsuba.model import glass
from drcmitsuba.model.materials import (
    BsdfInBand,
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    FacedBsdf,
    FacedBsdfInBand,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    Reflectance,
    SurfaceMaterial,
)
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose
from drcmitsuba.scene.geometry import SIDES, Surface
from drcmitsuba.scene.materials import albedo
from drcmitsuba.schema import LUMINANCE_WEIGHTS

MOST_NAMES = 12
"""Largest number of surfaces that a note names."""
BY_RGB = "by red, green and blue, of which a smooth spectrum is made"
"""Words for surfaces whose case states a colour and no spectrum."""
APART = 0.05
"""Difference of a spectrum's luminance from the stated one that a note tells [–]."""


@dataclass(frozen=True)
class _Shape:
    """Spectrum of a surface in one band, per its luminance under D65."""

    source: str
    field: str
    """Case file and its key."""
    values: np.ndarray
    """Transmittance or reflectance; of some panes the reflectances of front and back [–]."""
    wavelength: float
    """Wavelength of the band [nm]."""
    largest: float
    """Largest of these amounts in any band [–]."""


@dataclass(frozen=True)
class Tints:
    """Colours of a case's surfaces in all bands.

    A spectrum is scaled: under D65 it has the luminance that the case states for its surface.
    """

    case: Case
    bands: Bands

    @cached_property
    def _spectra(self) -> dict[str, Spectrum]:
        """Spectra of the case by name, as they are given."""
        bands, source = self.bands, self.case.source
        return {
            name: spectrum_of(tint, bands, source, f"colour.spectra.{name}")
            for name, tint in self.case.colour.spectra.items()
        }

    @cached_property
    def _shapes(self) -> dict[str, np.ndarray]:
        """Values of each named spectrum per its luminance under D65 [–], (column, band)."""
        photopic, shapes = self.bands.weights("Y"), {}
        for name, spectrum in self._spectra.items():
            each = [spectrum.at(self.bands, i) for i in range(spectrum.values.shape[1])]
            if not photopic @ each[0] > 0:
                raise self._error(name, "no visible light", "leave it out, or check its file")
            shapes[name] = np.stack([v / max(photopic @ v, 1e-9) for v in each])
        return shapes

    @property
    def content(self) -> dict[str, list[list[float]]]:
        """Values of each named spectrum, on which materials depend beside those of the case."""
        return {name: values.tolist() for name, values in self._shapes.items()}

    @cached_property
    def _luminances(self) -> dict[str, float]:
        """Luminance of each named spectrum under D65, as it is given [–]."""
        photopic = self.bands.weights("Y")
        return {name: float(photopic @ s.at(self.bands)) for name, s in self._spectra.items()}

    @cached_property
    def _names(self) -> dict[int, str]:
        """Names of the case's materials, by the objects."""
        return {id(material): name for name, material in self.case.materials.items()}

    @cached_property
    def _mixes(self) -> np.ndarray:
        """Weights of a film's red, green and blue in each band, (band, 3)."""
        return smooth_mixes(self.bands)

    def check(self, surfaces: Iterable[Surface]) -> list[str]:
        """Read all spectra, and find what surfaces take in all bands.

        Parameters
        ----------
        surfaces : iterable of Surface
            Surfaces in all states of the façade.

        Returns
        -------
        list of str
            Sentences on the spectra that light has, on amounts that differ from those of spectra,
            and on the surfaces that are grey.

        Raises
        ------
        InputError
            A file is unfit, no surface has the name of a spectrum, or a surface would send on more
            than all light.
        """
        every = {name: surface for surface in surfaces for name in surface.names}
        known = {alias for name in every for alias in _aliases(name)}
        known |= {"ground", *self.case.materials}
        for name in self._shapes:
            if name not in known:
                raise self._error(name, "no surface of this name", choose(name, sorted(known)))
        for surface in every.values():
            for band in range(len(self.bands)):
                self.of(band, surface)
        notes = [*self._amounts(every), *self._grey_sides(every), *self._greys(every)]
        return [*self._of_sources(), *notes]

    def _of_sources(self) -> list[str]:
        told = self.case.colour
        sky, sun = (f"{v:g} K" if isinstance(v, float) else v for v in (told.sky, told.sun))
        return [f"colour: the sky's spectrum by {sky}, the sun's by {sun}"]

    def _amounts(self, every: Mapping[str, Surface]) -> list[str]:
        """Notes on surfaces whose spectrum has another luminance than the case states."""
        out = []
        for name, surface in every.items():
            spectrum, stated = self._named(surface, name), _amount(surface, name)
            if spectrum is None or stated is None:
                continue
            its = self._luminances[spectrum]
            if abs(its - stated) > APART:
                told = f"{stated:g} as the case states, not the {its:.2f} of its spectrum"
                out.append(f"colour: {name}: {told}")
        return out[:MOST_NAMES]

    def _grey_sides(self, every: Mapping[str, Surface]) -> list[str]:
        """Notes on panes whose spectrum says nothing of the light that they reflect."""
        names = [
            name for name, surface in every.items()
            if isinstance(surface.material, GlazingMaterial)
            and (spectrum := self._named(surface, name)) is not None
            and len(self._shapes[spectrum]) < 3 and surface.material.reflectance > 0
        ]  # fmt: skip
        words = "its spectrum has no reflectances, so that it reflects light as grey"
        return [f"colour: {name}: {words}" for name in names[:MOST_NAMES]]

    def _greys(self, every: Mapping[str, Surface]) -> list[str]:
        """Notes on the surfaces without a spectrum: grey ones, and those by red, green and blue."""
        bare = {name: surface for name, surface in every.items() if not self._named(surface, name)}
        out = []
        for words, wanted in (("grey, without a spectrum", True), (BY_RGB, False)):
            names = sorted({_aliases(n)[-1] for n, s in bare.items() if _is_grey(s) is wanted})
            told = ", ".join(names[:MOST_NAMES]) + (", …" if len(names) > MOST_NAMES else "")
            out += [f"colour: {told}: {words}"] if names else []
        return out

    def ground(self, band: int) -> float:
        """Reflectance of the ground in a band, per the one that the case states [–]."""
        shape = self._shapes.get("ground")
        return 1.0 if shape is None else float(shape[0, band])

    def of(self, band: int, surface: Surface) -> SurfaceMaterial:
        """Material of a surface in a band.

        Raises
        ------
        InputError
            More than all light would be sent on, or the material takes no spectrum.
        """
        material = surface.material
        shape, behind = (self._shape(band, surface, name) for name in _both(surface.names))
        if isinstance(material, Lambertian):
            front, back = (
                self._reflectance(rho, side, band)
                for rho, side in zip(material.sides, (shape, behind), strict=True)
            )
            return Lambertian(front, None if back == front else back, material.polish)
        if isinstance(material, PorousMaterial):
            value = self._reflectance(material.reflectance, shape, band)
            return material.model_copy(update={"reflectance": value})
        if isinstance(material, BsdfMaterial):
            return self._film(material, shape, band)
        return material if shape is None else material.model_copy(update=_pane(material, shape))

    def _shape(self, band: int, surface: Surface, name: str) -> _Shape | None:
        """Spectrum of a side of a surface in a band."""
        spectrum = self._named(surface, name)
        if spectrum is None:
            return None
        shape = self._shapes[spectrum]
        field, at = f"colour.spectra.{spectrum}", self.bands.wavelengths[band]
        return _Shape(self.case.source, field, shape[:, band], at, float(shape[0].max()))

    def _named(self, surface: Surface, name: str) -> str | None:
        """Name of the spectrum of a side: that of its own name, or of its material's.

        A shade that stands in a window's place does not take the window's.
        """
        aliases, own = _aliases(name), self._names.get(id(surface.material))
        names = aliases if own is None or own in aliases else [own]
        return next((each for each in names if each in self._shapes), None)

    def _reflectance(self, stated: Reflectance, shape: _Shape | None, band: int) -> float:
        """Diffuse reflectance in a band."""
        if shape is None:
            if not isinstance(stated, tuple):
                return stated
            return float(np.clip(of_rgb(stated).at(self.bands)[band], 0, 1))
        if isinstance(stated, tuple):
            stated = float(np.dot(list(LUMINANCE_WEIGHTS.values()), stated))
        return _scaled(stated, shape, "reflectance")

    def _film(self, film: BsdfMaterial, shape: _Shape | None, band: int) -> BsdfInBand:
        """Film in a band: the colour of its file, or a spectrum that stands for it."""
        if shape is None:
            mix = tuple(self._mixes[band].tolist())
        else:
            if (most := albedo(film) * float(shape.values[0])) > 1 + EXCESS:
                got = f"the film would send on {most:.2f} of the light at {shape.wavelength:g} nm"
                raise InputError(shape.source, shape.field, got, "give a flatter spectrum")
            mix = (float(shape.values[0]),)
        kind = FacedBsdfInBand if isinstance(film, FacedBsdf) else BsdfInBand
        return kind(**film.model_dump(), mix=mix)

    def _error(self, name: str, got: str, remedy: str) -> InputError:
        return InputError(self.case.source, f"colour.spectra.{name}", got, remedy)


def _both(names: tuple[str, ...]) -> tuple[str, str]:
    """Names of front and back."""
    return names[0], names[-1]


def _is_grey(surface: Surface) -> bool | None:
    """Whether a surface has no red, green and blue; None where its BSDF's file decides."""
    material = surface.material
    if isinstance(material, BsdfMaterial):
        return None
    if isinstance(material, Lambertian):
        return not any(isinstance(rho, tuple) for rho in material.sides)
    return not isinstance(getattr(material, "reflectance", None), tuple)


def _amount(surface: Surface, name: str) -> float | None:
    """Luminance of a side as the case states it: what it reflects or, a pane, transmits."""
    material = surface.material
    if isinstance(material, Lambertian):
        rho = material.sides[1] if name != surface.name else material.sides[0]
        return None if isinstance(rho, tuple) else rho
    if isinstance(material, GlazingMaterial):
        return material.transmittance
    return None


def _aliases(name: str) -> list[str]:
    """Names by which a spectrum may call a surface: its own, without its side, of all walls."""
    for side in SIDES:
        if name.endswith(f" {side}"):
            bare = name.removesuffix(f" {side}")
            return [name, bare, *(["walls"] if bare == "wall" else [])]
    return [name]


def _scaled(stated: float, shape: _Shape, what: str) -> float:
    """Share of the light in a band; InputError where it is more than all."""
    value = stated * float(shape.values[0])
    if value > 1 + 1e-6:
        got = f"a {what} of {stated:g} would be {value:.2f} at {shape.wavelength:g} nm"
        remedy = f"at most {np.floor(100 / shape.largest) / 100:g} goes with this spectrum"
        raise InputError(shape.source, shape.field, got, remedy)
    return min(value, 1.0)


def _pane(material: Any, shape: _Shape) -> dict[str, Any]:
    """Changed fields of a pane or a mirror in a band."""
    if isinstance(material, DielectricMaterial):
        remedy = "leave it out: its light counts as grey"
        raise InputError(shape.source, shape.field, "a clear solid takes none", remedy)
    if isinstance(material, MirrorMaterial):
        return {"reflectance": _scaled(material.reflectance, shape, "reflectance")}
    if isinstance(material, DiffuserMaterial):
        most = material.most_through
        factor = _scaled(most, shape, "transmittance") / most if most else 1.0
        both = ("transmittance", "straight")
        changed: dict[str, Any] = {key: _times(getattr(material, key), factor) for key in both}
        through = factor * most
    else:
        assert isinstance(material, GlazingMaterial)
        most = 1.0 if material.ior is None else glass.most(material.ior)
        through = min(_scaled(material.transmittance, shape, "transmittance"), most)
        changed = {"transmittance": through}
    front, back = shape.values[1:3].tolist() if len(shape.values) > 2 else (1.0, 1.0)
    sides = {"reflectance": back}  # a file's back faces the room
    if isinstance(material, DiffuserMaterial):
        sides |= {"outer_reflectance": front}
    return changed | {k: min(getattr(material, k) * by, 1 - through) for k, by in sides.items()}


def _times(share: float | tuple[float, ...], factor: float) -> float | tuple[float, ...]:
    """Share of the light by incidence, times a factor."""
    return tuple(factor * s for s in share) if isinstance(share, tuple) else factor * share
