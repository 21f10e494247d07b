"""The tables `[views.NAME]` of a case: where an eye is and what it looks at."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drcmitsuba.model.model import View
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Coordinate, Point, Table

LETTERS = {"perspective": "v", "hemispherical": "h", "equidistant": "a", "equisolid": "e"}
"""Letters of `View.kind`; Radiance has no equisolid view."""
WIDEST = {"perspective": 179.0, "hemispherical": 180.0, "equidistant": 360.0, "equisolid": 360.0}
"""Largest angle across a picture by its kind [deg]."""

Vector = tuple[Coordinate, Coordinate, Coordinate]
Angle = Annotated[float, Field(gt=0, le=360)]


class ViewTable(Table):
    """View from a point, as a picture shows it and an eye is glared."""

    position: Point
    """Place of the eye, before a [room] is turned by `rotation` [m]."""
    direction: Vector
    """Vector to the centre of the picture, of any length, turned with the room [–]."""
    up: Vector = (0.0, 0.0, 1.0)
    """Vector that points up in the picture, of any length [–]."""
    kind: Literal["perspective", "hemispherical", "equidistant", "equisolid"] = "equidistant"
    """Projection; `equidistant` is Radiance's `-vta`, `hemispherical` its `-vth`."""
    angle: Angle | tuple[Angle, Angle] = 180.0
    """Angle across the picture, or angles across and up [deg]."""

    @property
    def angles(self) -> tuple[float, float]:
        """Angles across and up the picture [deg]."""
        return self.angle if isinstance(self.angle, tuple) else (self.angle, self.angle)

    def view(self, name: str) -> View:
        """Return the view by its name."""
        return View(name, LETTERS[self.kind], self.position, self.direction, self.up, self.angles)

    def check(self, name: str) -> None:
        """Refuse vectors along each other or without a length, and angles beyond the projection."""
        lengths = np.linalg.norm([self.direction, self.up], axis=1)
        for key, length in zip(("direction", "up"), lengths, strict=True):
            if not length > 0:
                raise InputError("case", f"views.{name}.{key}", "no length", "give another vector")
        if not np.linalg.norm(np.cross(self.direction, self.up)) > 1e-6 * lengths.prod():
            got = f"{list(self.up)} along the direction {list(self.direction)}"
            raise InputError("case", f"views.{name}.up", got, "give one across it, as [0, 1, 0]")
        if max(self.angles) > WIDEST[self.kind]:
            remedy = f"give at most {WIDEST[self.kind]:g} where the view is {self.kind}"
            raise InputError("case", f"views.{name}.angle", f"{max(self.angles):g}", remedy)
