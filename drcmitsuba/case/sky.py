"""The tables `[sky]` and `[outside]` of a case: luminances of the sky and of the ground."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from drcmitsuba.runtime.toml import Fraction, Table, default_model


class SkyTable(Table):
    """Keys that every sky has."""

    subdivision: Annotated[int, Field(ge=1, le=6)] = 1
    """Reinhart's factor MF: each of Tregenza's 145 patches is divided into about MF² patches."""


class PerezSky(SkyTable):
    """Perez's all-weather sky from the weather file."""

    model: Literal["perez"] = "perez"
    """Name of the model."""
    patch_values: Literal["mean", "centre"] = "mean"
    """Luminance of a patch: the mean over it, or the value at its centre as in `gendaymtx`."""


class CieTable(SkyTable):
    """A static CIE sky: a sky of gensky, or a type of ISO 15469 at a given illuminance."""

    model: Literal["cie"]
    """Name of the model."""
    type: (
        Literal["clear", "clear_with_sun", "intermediate", "intermediate_with_sun", "overcast"]
        | Annotated[int, Field(ge=1, le=16)]
    )
    """Name of a sky of gensky, or type 1 to 15 of ISO 15469; 16 is the traditional overcast sky."""
    diffuse_horizontal_illuminance: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Horizontal illuminance by a sky of ISO 15469 on open ground [lx]."""


class SunshineTable(SkyTable):
    """CIE skies drawn at random from the monthly probability of sunshine."""

    model: Literal["sunshine"]
    """Name of the model."""
    probability: Annotated[tuple[Fraction, ...], Field(min_length=12, max_length=12)]
    """Probability of sunshine in each month, January first [–]."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the random numbers."""


Sky = Annotated[
    PerezSky | CieTable | SunshineTable, Field(discriminator="model"), default_model("perez")
]


class Outside(Table):
    """Ground below the horizon and the size of the sun."""

    ground_reflectance: Fraction = 0.2
    """Reflectance of the ground [–]; all of the sky lights the ground."""
    sun_diameter: Annotated[float, Field(ge=0.01, le=10)] = 0.5
    """Angular diameter of the sun [deg]."""
