"""The table `[sun]` of a case: which suns stand for the sun of every time stamp."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from drcmitsuba.case.effects import Effects
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Table, default_model


class TrueSun(Table):
    """Every time stamp has its own exact sun."""

    model: Literal["true_sun"] = "true_sun"
    """Name of the model."""


class Adaptive(Table):
    """Direct sun exact at every time stamp; other light interpolated in a refined mesh of suns."""

    model: Literal["adaptive"]
    """Name of the model."""
    tolerance: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Largest error between the mesh's suns: RMS over sensors, relative to that of all suns [–]."""
    finest: Annotated[int, Field(ge=4, le=7)] = 5
    """Largest number of halvings of the mesh; after 5 its suns are 2.8° apart."""


class ThreePhase(Table):
    """The sun is spread over the four nearest patches of the sky, as `gendaymtx` does."""

    model: Literal["three_phase"]
    """Name of the model."""


class FivePhase(Table):
    """The sun is moved to the centre of its patch in Reinhart's subdivision MF 6."""

    model: Literal["five_phase"]
    """Name of the model."""


class Daysim(Table):
    """DAYSIM's sun, between the four nearest of about 65 suns: those of the hours of five days."""

    model: Literal["daysim"]
    """Name of the model."""


Sun = Annotated[
    TrueSun | Adaptive | ThreePhase | FivePhase | Daysim,
    Field(discriminator="model"),
    default_model("true_sun"),
]


def check_sun(sun: Sun, effects: Effects, has_components: bool) -> None:
    """Raise InputError for a sun that the components or the chosen effects exclude.

    These are a mesh of suns with mirrored light, and a three-phase sun without suns or sky.
    """
    if isinstance(sun, Adaptive) and has_components:
        got = "a mesh of suns would blur what components mirror"
        raise InputError("case", "sun.model", got, 'take "true_sun"')
    if isinstance(sun, Adaptive) and effects.pane_to_pane == "all":
        got = "a mesh of suns would blur what panes mirror"
        raise InputError("case", "effects.pane_to_pane", got, 'take sun.model = "true_sun"')
    if isinstance(sun, ThreePhase):
        for name in ("sky", "suns"):
            if getattr(effects, name) == "off":
                got = "a three-phase sun is among the patches of the sky"
                remedy = 'leave it "auto", or take another sun.model'
                raise InputError("case", f"effects.{name}", got, remedy)
