"""The tables `[[furniture]]` of a case: boxes and plates, inside the room or outside of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from drcmitsuba.model.materials import Reflectance
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Coordinate, Length, Name, Point, Table

MOST_PIECES = 100_000
"""Largest number of boxes and plates in a case."""

Repetitions = Annotated[int, Field(ge=1, le=1000)]


class Furniture(Table):
    """Box, or horizontal plate where the height is 0, repeated on a grid."""

    name: Name = "furniture"
    """Name of the piece in messages."""
    corner: Point
    """Lowest x, y and z of the first piece [m]."""
    size: tuple[Length, Length, Annotated[float, Field(ge=0, le=100_000)]]
    """Extent along x, y and z [m]; a height of 0 makes a plate."""
    reflectance: Reflectance = 0.5
    """Reflectance [–]: one number, or [red, green, blue]."""
    count: tuple[Repetitions, Repetitions] = (1, 1)
    """Number of pieces along x and along y."""
    step: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    """Distance from one piece to the next along x and along y [m]."""


def check_furniture(furniture: Sequence[Furniture]) -> None:
    """Raise InputError where all tables together hold more than `MOST_PIECES` pieces."""
    pieces = sum(piece.count[0] * piece.count[1] for piece in furniture)
    if pieces > MOST_PIECES:
        raise InputError("case", "furniture", f"{pieces} pieces", f"at most {MOST_PIECES}")
