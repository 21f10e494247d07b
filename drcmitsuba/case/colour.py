"""The table `[colour]` of a case: bands of the light, spectra of sources and of surfaces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Illuminance, Name, Table

Bands = Literal["auto", "luminance", "rgb", 9, 27]


def _refuse_other_temperatures(value: object) -> object:
    """Refuse a number that is no temperature of a phase of daylight."""
    if isinstance(value, int | float) and not 4000 <= value <= 25_000:
        remedy = "give 4000 to 25000 K, the phases of daylight, or a file"
        raise InputError("case", "", f"got {value:g}", remedy)
    return value


_OfPhases = BeforeValidator(_refuse_other_temperatures)
Temperature = Annotated[float, Field(ge=4000, le=25_000)]
"""Correlated colour temperature of a phase of daylight [K]."""


class Lab(Table):
    """Colour of a surface in CIELAB under D65, as paint is measured."""

    lab: tuple[
        Annotated[float, Field(ge=0, le=100)],
        Annotated[float, Field(ge=-128, le=128)],
        Annotated[float, Field(ge=-128, le=128)],
    ]
    """L*, a*, b* [–]."""


Channel = Annotated[float, Field(ge=0, le=1, strict=True)]
Tint = tuple[Channel, Channel, Channel] | Lab | Path
"""Colour of a surface: linear RGB (sRGB primaries), CIELAB, or a file of its spectrum."""


class Colour(Table):
    """Colour of the light: how many bands, and the spectra of sources and surfaces."""

    bands: Bands = "auto"
    """Number of bands [–]: "auto", three where a reflectance is coloured; "luminance"; "rgb"; 9 or
    27 wavelengths, by which melanopic light and colour at sensors and views are computed."""
    sky: Annotated[Literal["chain", "takagi"] | Temperature | Path, _OfPhases] = "chain"
    """Colour temperature of the sky's patches, by a model of their luminance or one for all [K]; or
    a file of the sky's spectrum."""
    sun: Annotated[Literal["spectrl2"] | Temperature | Path, _OfPhases] = "spectrl2"
    """Spectrum of the sun: Bird's by air mass and turbidity, a phase of daylight [K], or a file."""
    spectra: Annotated[dict[Name, Tint], Field(max_length=1000)] = Field(default_factory=dict)
    """Spectra by name of a surface (floor, ceiling, walls, ground, furniture, a layer of the
    model) or of a material [–]: their shape counts, their amount is the one stated there."""
    melanopic_threshold: Illuminance = 250.0
    """Melanopic equivalent daylight illuminance that counts as enough by day [lx]."""

    @property
    def wavelengths(self) -> int:
        """Number of wavelengths; 0 for luminance or red, green and blue."""
        return self.bands if isinstance(self.bands, int) else 0

    @property
    def notes_without_bands(self) -> list[str]:
        """Note of a task that evaluates no bands, where a case asks for them."""
        note = f"colour: no {self.wavelengths} bands here; evaluate computes them"
        return [note] * bool(self.wavelengths)
