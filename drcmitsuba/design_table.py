"""The table `[design]` of a case: what may be turned, and what is wanted."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from drcmitsuba.errors import InputError
from drcmitsuba.table import Table

Part = Annotated[float, Field(ge=0, le=1)]
Percent = Annotated[float, Field(ge=0, le=100)]


class Design(Table):
    """A façade to be optimised; only the film has to be named."""

    film: str
    """Material that may take the place of the clear one; the shade does not cover it."""
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
    def _ranges(self) -> Design:
        if self.rows is not None and self.row_height is not None:
            raise InputError("design", "row_height", "rows are given too", "give one of them")
        for key in ("band", "wwr", "glazing_transmittance", "shade_vlt"):
            given = getattr(self, key)
            if isinstance(given, tuple) and given[1] < given[0] + (1e-3 if key == "band" else 0):
                got = f"{given[0]:g} to {given[1]:g}"
                raise InputError("design", key, got, "give the lower value first")
        return self
