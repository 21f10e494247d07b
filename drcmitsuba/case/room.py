"""The table `[room]` of a case: a box, whose frame all coordinates of the case refer to."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drcmitsuba.model.materials import Reflectance
from drcmitsuba.runtime.toml import Length, Side, Table


class Room(Table):
    """Box of a room; its origin is the south-west corner of the floor, x east, y north, z up."""

    size: tuple[Length, Length, Length]
    """Width from west to east, depth from south to north, height [m]."""
    rotation: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Rotation of the whole room about its origin, clockwise seen from above [deg]."""
    floor: Reflectance = 0.2
    """Reflectance of the floor [–]: one number, or [red, green, blue]."""
    ceiling: Reflectance = 0.8
    """Reflectance of the ceiling [–]: one number, or [red, green, blue]."""
    walls: Reflectance = 0.5
    """Reflectance of the walls [–]: one number, or [red, green, blue]."""

    def wall(self, side: Side) -> tuple[float, float]:
        """Length and height of a wall [m]."""
        width, depth, height = self.size
        return (width if side in ("south", "north") else depth), height
