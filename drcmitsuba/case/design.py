"""The table `[design]` of a case: what may be turned, and what is wanted."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from drcmitsuba.case.toml import Table
from drcmitsuba.runtime.errors import InputError

Part = Annotated[float, Field(ge=0, le=1)]
Percent = Annotated[float, Field(ge=0, le=100)]
Tilt = Annotated[float, Field(gt=-90, lt=90)]

OF_TILT = ("tilt", "tilt_step")
"""Keys that say something of lamellae only."""
OF_BOTH = ("objective", "ase_limit", "sharpness")
"""Keys of both kinds of search; all others are those of a façade."""


class Design(Table):
    """What is to be optimised: a façade, its film has to be named; or the tilt of lamellae."""

    film: str | None = None
    """Material that may take the place of the clear one; the shade does not cover it."""
    component: str | None = None
    """Lamellae that are tilted, in place of a film: a structure of [components]."""
    tilt: tuple[Tilt, Tilt] = (-30.0, 30.0)
    """Least and most tilt of the lamellae [deg]."""
    tilt_step: Annotated[float, Field(gt=0, le=45)] = 1.0
    """What differences are taken over, and how finely the tilt is searched [deg]."""
    clear: str | None = None
    """Without it, the clear material of the façade as it is."""
    side: Literal["south", "east", "north", "west"] | None = None
    """Without it, the one side with panes."""
    band: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(gt=0)]] | None = None
    """Lowest and highest edge of panes [m]; without it, those of the façade as it is."""
    parameters: Literal["window", "strips"] = "window"
    """One window with one film in it, or every tile of its own."""
    rows: Annotated[int, Field(ge=1, le=100)] | None = None
    """Tiles one above the other; six without it and `row_height`."""
    row_height: Annotated[float, Field(gt=0, le=100)] | None = None
    """Their height, about [m], in place of `rows`."""
    segments: Annotated[int, Field(ge=1, le=200)] | None = None
    """Tiles side by side; without it, the façade's segments."""
    wwr: Literal["fixed"] | tuple[Part, Part] = "fixed"
    """Window-to-wall ratio: that of the façade as it is, or a range."""
    objective: Literal["sDA", "worst month"] = "sDA"
    film_cost: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Points of the objective that film in all of the band has to bring."""
    ase_limit: Percent = 10.0
    starts: Annotated[int, Field(ge=1, le=1000)] = 1
    """Beside the best of what is looked at first: the case's own start, then random ones."""
    pareto: Annotated[int, Field(ge=0, le=100)] = 8
    """Limits of ASE in the sweep for the Pareto front; 0: none."""
    sharpness: Annotated[
        tuple[Annotated[float, Field(ge=1, le=1e6)], ...], Field(min_length=1, max_length=20)
    ] = (4.0, 8.0, 16.0, 32.0)
    iterations: Annotated[int, Field(ge=1, le=1000)] = 20
    seed: Annotated[int, Field(ge=0, le=1 << 30)] = 0
    glazing_transmittance: tuple[Part, Part] | None = None
    """Range of that of the clear material; without it, it stays as it is."""
    shade_vlt: tuple[Part, Part] | None = None
    """Range of the shade's transmittance; without it, it stays as it is."""

    @model_validator(mode="after")
    def _one_kind(self) -> Design:
        if self.component is None:
            if self.film is None:
                got = "neither film nor component is named"
                raise InputError("design", "film", got, "name a material, or lamellae to be tilted")
            for key in OF_TILT:
                if key in self.model_fields_set:
                    got = "no component is named"
                    raise InputError("design", key, got, "name the lamellae: component = …")
            return self
        for key in sorted(self.model_fields_set - {"component", *OF_TILT, *OF_BOTH}):
            got = "the tilt of a component is searched, not a façade"
            raise InputError("design", key, got, "leave it out")
        low, high = self.tilt
        if high - low < 2 * self.tilt_step:
            got = f"{low:g} to {high:g}"
            remedy = f"give the lower value first, and at least {2 * self.tilt_step:g}° between"
            raise InputError("design", "tilt", got, remedy)
        return self

    @model_validator(mode="after")
    def _ranges(self) -> Design:
        if self.rows is not None and self.row_height is not None:
            raise InputError("design", "row_height", "rows are given too", "give one of them")
        for key in ("band", "wwr", "glazing_transmittance", "shade_vlt"):
            given = getattr(self, key)
            if isinstance(given, tuple) and given[1] < given[0] + (1e-3 if key == "band" else 0):
                got = f"{given[0]:g} to {given[1]:g}"
                raise InputError("design", key, got, "give the lower value first")
        return self
