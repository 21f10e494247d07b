"""Surfaces in a band: materials whose amounts are those of one wavelength."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.spectra import of_rgb, smooth_mixes, spectrum_of
from drcmitsuba.model import glass
from drcmitsuba.model.materials import (
    BsdfInBand,
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    Reflectance,
    SurfaceMaterial,
)
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose
from drcmitsuba.schema import LUMINANCE_WEIGHTS

MOST_NAMES = 12
"""Largest number of surfaces that a note names."""
SIDES = ("south", "east", "north", "west")


@dataclass(frozen=True)
class _Shape:
    """Spectrum of a surface in one band, per its luminance under D65."""

    source: str
    field: str
    """Case file and its key."""
    values: np.ndarray
    """Transmittance or reflectance; of some panes the reflectances of front and back [–]."""


@dataclass(frozen=True)
class Tints:
    """Colours of a case's surfaces in all bands.

    A spectrum is scaled: under D65 it has the luminance that the case states for its surface.
    """

    case: Case
    bands: Bands

    @cached_property
    def _shapes(self) -> dict[str, np.ndarray]:
        """Values of each named spectrum per its luminance under D65 [–], (column, band)."""
        photopic, shapes = self.bands.weights("Y"), {}
        for name, tint in self.case.colour.spectra.items():
            spectrum = spectrum_of(tint, self.bands, self.case.source, f"colour.spectra.{name}")
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
    def _names(self) -> dict[int, str]:
        """Names of the case's materials, by the objects."""
        return {id(material): name for name, material in self.case.materials.items()}

    @cached_property
    def _mixes(self) -> np.ndarray:
        """Weights of a film's red, green and blue in each band, (band, 3)."""
        return smooth_mixes(self.bands)

    def check(self, surfaces: Iterable[str]) -> None:
        """Read all spectra, and raise InputError for one whose name no surface has.

        `surfaces` are the names of all surfaces in any state of the façade.
        """
        known = {alias for name in surfaces for alias in _aliases(name)}
        known |= {"ground", *self.case.materials}
        for name in self._shapes:
            if name not in known:
                raise self._error(name, "no surface of this name", choose(name, sorted(known)))

    def notes(self, surfaces: Mapping[str, SurfaceMaterial]) -> list[str]:
        """Sentences on the spectra that light has, and on the surfaces that are grey."""
        told, case = self.case.colour, self.case
        kinds = {str: "{}", float: "{:g} K"}
        sky, sun = (kinds.get(type(v), "{}").format(v) for v in (told.sky, told.sun))
        films = {n for n, m in case.materials.items() if isinstance(m, BsdfMaterial)}
        named = self._shapes.keys() | films
        grey = (n for n, m in surfaces.items() if not (named & {*_aliases(n)} or _has_rgb(m)))
        bare = sorted({_aliases(name)[-1] for name in grey})
        out = [f"colour: the sky's spectrum by {sky}, the sun's by {sun}"]
        if bare:
            words = ", ".join(bare[:MOST_NAMES]) + (", …" if len(bare) > MOST_NAMES else "")
            out.append(f"colour: {words}: grey, without a spectrum")
        return out

    def ground(self, band: int) -> float:
        """Reflectance of the ground in a band, per the one that the case states [–]."""
        shape = self._shapes.get("ground")
        return 1.0 if shape is None else float(shape[0, band])

    def of(self, band: int, name: str, material: SurfaceMaterial) -> SurfaceMaterial:
        """Material of a surface in a band.

        Raises
        ------
        InputError
            More than all light would be sent on, or the material takes no spectrum.
        """
        shape = self._shape(band, name, material)
        if isinstance(material, Lambertian):
            front, back = material.reflectance, material.behind
            of_back = None if back is None else self._reflectance(back, shape, band)
            return Lambertian(self._reflectance(front, shape, band), of_back, material.polish)
        if isinstance(material, PorousMaterial):
            value = self._reflectance(material.reflectance, shape, band)
            return material.model_copy(update={"reflectance": value})
        if isinstance(material, BsdfMaterial):
            return self._film(material, shape, band)
        return material if shape is None else material.model_copy(update=_pane(material, shape))

    def _shape(self, band: int, name: str, material: SurfaceMaterial) -> _Shape | None:
        """Spectrum of a surface: that of its own name, or of its material's.

        A shade that stands in a window's place does not take the window's.
        """
        aliases, own = _aliases(name), self._names.get(id(material))
        names = aliases if own is None or own in aliases else [own]
        for each in names:
            if each in self._shapes:
                values = self._shapes[each][:, band]
                return _Shape(self.case.source, f"colour.spectra.{each}", values)
        return None

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
        """Film whose file is grey, or has a colour of its own, in a band."""
        if shape is not None:
            mix = (float(shape.values[0]) / 3,) * 3
        else:
            red, green, blue = self._mixes[band].tolist()
            mix = red, green, blue
        return BsdfInBand(**film.model_dump(), mix=mix)

    def _error(self, name: str, got: str, remedy: str) -> InputError:
        return InputError(self.case.source, f"colour.spectra.{name}", got, remedy)


def _has_rgb(material: SurfaceMaterial) -> bool:
    """Whether a surface has a colour by red, green and blue."""
    if isinstance(material, Lambertian):
        return any(isinstance(rho, tuple) for rho in material.sides)
    return isinstance(getattr(material, "reflectance", None), tuple)


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
        got = f"a {what} of {stated:g} would be {value:.2f} in a band"
        raise InputError(
            shape.source, shape.field, got, f"lower the {what}, or take another spectrum"
        )
    return min(value, 1.0)


def _pane(material: Any, shape: _Shape) -> dict[str, Any]:
    """Changed fields of a pane or a mirror in a band."""
    if isinstance(material, DielectricMaterial):
        remedy = "leave it out: its light counts as grey"
        raise InputError(shape.source, shape.field, "a clear solid takes none", remedy)
    if isinstance(material, MirrorMaterial):
        return {"reflectance": _scaled(material.reflectance, shape, "reflectance")}
    if isinstance(material, DiffuserMaterial):
        factor = _scaled(material.most_through, shape, "transmittance") / material.most_through
        keys = ("transmittance", "straight")
        changed: dict[str, Any] = {key: _times(getattr(material, key), factor) for key in keys}
        through = factor * material.most_through
    else:
        assert isinstance(material, GlazingMaterial)
        most = 1.0 if material.ior is None else glass.most(material.ior)
        through = min(_scaled(material.transmittance, shape, "transmittance"), most)
        changed = {"transmittance": through}
    back = float(shape.values[2]) if len(shape.values) > 2 else 1.0
    return changed | {"reflectance": min(material.reflectance * back, 1 - through)}


def _times(share: float | tuple[float, ...], factor: float) -> float | tuple[float, ...]:
    """Share of the light by incidence, times a factor."""
    return tuple(factor * s for s in share) if isinstance(share, tuple) else factor * share
