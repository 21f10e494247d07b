"""The table `[sensors]` of a case: points at which the illuminance is computed."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Length, Point, Table

MOST_SENSORS = 250_000
"""Largest number of points in a case."""

PerAxis = Annotated[int, Field(ge=1, le=2000)]


class Sensors(Table):
    """Horizontal grid of points that face up; the first is at corner + spacing/2, x fastest."""

    corner: Point
    """Lowest x and y of the grid, and its height z [m]."""
    count: tuple[PerAxis, PerAxis]
    """Number of points along x and along y."""
    spacing: Length = 0.3
    """Distance between neighbouring points [m]."""

    @model_validator(mode="after")
    def _not_too_many(self) -> Sensors:
        points = self.count[0] * self.count[1]
        if points > MOST_SENSORS:
            raise InputError("sensors", "count", f"{points} points", f"at most {MOST_SENSORS}")
        return self
