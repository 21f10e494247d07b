"""The tables of when, where and under which sky: site, weather, period, sky, sun, outside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from drcmitsuba.case.toml import Fraction, Name, Table


def _usually(model: str) -> BeforeValidator:
    """Make the model of a table this one where none is named."""
    return BeforeValidator(
        lambda given: {"model": model, **given} if type(given) is dict else given
    )


class Site(Table):
    """Place, used only where there is no weather file (CIE and sunshine skies)."""

    name: Name = "site"
    latitude: Annotated[float, Field(ge=-90, le=90)]
    longitude: Annotated[float, Field(ge=-180, le=180)]
    timezone: Annotated[float, Field(ge=-12, le=14)]
    elevation: Annotated[float, Field(ge=-500, le=9000)] = 0.0


class WeatherFile(Table):
    """Weather file (EPW, TMY3, WEA); without one the TMY3 year of Greensboro is used."""

    file: Path | None = None


class PeriodTable(Table):
    """Hours that are evaluated; `calendar` sets the days, every other key overrides it."""

    calendar: Literal["EvalDRC", "LM-83"] = "EvalDRC"
    months: Annotated[tuple[Annotated[int, Field(ge=1, le=12)], ...], Field(min_length=1)] = tuple(
        range(1, 13)
    )
    hours: tuple[Annotated[int, Field(ge=0, le=24)], Annotated[int, Field(ge=0, le=24)]] = (8, 18)
    days_per_week: Annotated[int, Field(ge=1, le=7)] | None = None
    daylight_saving: tuple[str, str] | None = None
    timestamps: Path | None = None


class SkyTable(Table):
    """What every sky has."""

    subdivision: Annotated[int, Field(ge=1, le=6)] = 1
    """Reinhart's factor MF: each of Tregenza's 145 patches is cut into about MF² ones."""


class PerezSky(SkyTable):
    """Perez's all-weather sky from the weather file."""

    model: Literal["perez"] = "perez"
    patch_values: Literal["mean", "centre"] = "mean"


class CieTable(SkyTable):
    """A static CIE sky: one of gensky's, or a type of ISO 15469 at a given illuminance."""

    model: Literal["cie"]
    type: (
        Literal["clear", "clear_with_sun", "intermediate", "intermediate_with_sun", "overcast"]
        | Annotated[int, Field(ge=1, le=16)]
    )
    diffuse_horizontal_illuminance: Annotated[float, Field(gt=0, le=1e6)] | None = None


class SunshineTable(SkyTable):
    """CIE skies drawn at random from the monthly probability of sunshine."""

    model: Literal["sunshine"]
    probability: Annotated[tuple[Fraction, ...], Field(min_length=12, max_length=12)]
    seed: Annotated[int, Field(ge=0)] = 0


Sky = Annotated[
    PerezSky | CieTable | SunshineTable, Field(discriminator="model"), _usually("perez")
]


class TrueSun(Table):
    """Every time stamp has its own exact sun."""

    model: Literal["true_sun"] = "true_sun"


class Adaptive(Table):
    """Straight sun exact at every time stamp; the rest between suns of a mesh, refined by need."""

    model: Literal["adaptive"]
    tolerance: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Largest error between the mesh's suns, RMS over the sensors, of the RMS over all suns."""
    finest: Annotated[int, Field(ge=4, le=7)] = 5
    """Halvings of the mesh at most; 5 sets its suns 2.8° apart."""


class ThreePhase(Table):
    """The sun is spread over the four nearest patches of the sky, as `gendaymtx` does."""

    model: Literal["three_phase"]


class FivePhase(Table):
    """The sun is moved to the centre of its patch in Reinhart's subdivision MF 6."""

    model: Literal["five_phase"]


class Daysim(Table):
    """Between the four nearest of about 65 suns: the hours of five days, DAYSIM's choice."""

    model: Literal["daysim"]


Sun = Annotated[
    TrueSun | Adaptive | ThreePhase | FivePhase | Daysim,
    Field(discriminator="model"),
    _usually("true_sun"),
]


class Outside(Table):
    """Ground below the horizon and the size of the sun."""

    ground_reflectance: Fraction = 0.2
    sun_diameter: Annotated[float, Field(ge=0.01, le=10)] = 0.5
