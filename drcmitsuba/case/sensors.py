"""The table `[sensors]` of a case: points at which the illuminance is computed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from drcmitsuba.runtime.content_key import file_numbers
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Length, Name, OnMap, Point, Table

MOST_SENSORS = 250_000
"""Largest number of points in a case."""

MOST_GRIDS = 2000
"""Largest number of grids in a case."""
MARGINS = {"EN 17037": 0.5}
"""Width [m] of the margin of a standard, by its name."""

PerAxis = Annotated[int, Field(ge=1, le=2000)]


class Sensors(Table):
    """Horizontal grid of points that face up; the first is at corner + spacing/2, x fastest."""

    corner: Point
    """Lowest x and y of the grid, and its height z [m]; the first point stands half a spacing from
    it in x and y, so that a grid that fills a room begins at the room's corner."""
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


class GridsByRule(Table):
    """Rule by which rooms get their grids: points that face up above the floor; x fastest."""

    height: Annotated[float, Field(ge=0.001, le=10)] = 0.8
    """Height above the floor [m]."""
    spacing: Length = 0.3
    """Largest distance between neighbouring points [m]; LM-83 allows 0.61 m."""
    margin: Annotated[float, Field(ge=0, le=10, strict=True)] | Literal["EN 17037"] = 0.3
    """Width of the strip along walls and the floor's edge that has no points [m]; "EN 17037" stands
    for its 0.5 m."""

    @property
    def edge(self) -> float:
        """Width of the margin [m]."""
        return MARGINS[self.margin] if isinstance(self.margin, str) else self.margin


class FloorSensors(GridsByRule):
    """Grids of points that face up above a model's floors, one in each room; x fastest."""

    floors: Annotated[tuple[Name, ...], Field(min_length=1, max_length=1000)]
    """Names of the floors' materials in the model's files; `*` stands for any text."""


class SpaceSensors(GridsByRule):
    """Grids of points that face up above the floors of spaces, one in each; x fastest."""

    spaces: Annotated[tuple[Name, ...], Field(min_length=1, max_length=1000)]
    """Names of spaces of the model or the case; `*` stands for any text."""


OnePoint = Annotated[tuple[OnMap, ...], Field(min_length=3, max_length=6)]
"""x y z, or x y z dx dy dz."""


class PointSensors(Table):
    """Points with normals, from a file or in the case, or the grids of a model."""

    points: (
        Path | Annotated[tuple[OnePoint, ...], Field(min_length=1, max_length=MOST_SENSORS)] | None
    ) = None
    """File of one point and its normal a line, x y z dx dy dz [m], beside the case; or the points
    themselves, such as [[0, 1.5, 0.8]], which face up, or [[0, 1.5, 1.2, 0, 1, 0]]."""
    grids: Annotated[tuple[Name, ...], Field(max_length=1000)] = ()
    """Names of sensor grids of the model's files; `*` stands for any text."""

    @model_validator(mode="before")
    @classmethod
    def _rows(cls, table: Any) -> Any:
        """Refuse rows that are no points with the number of the first one."""
        rows = table.get("points") if isinstance(table, dict) else None
        for number, row in enumerate(rows if isinstance(rows, list | tuple) else ()):
            is_row = isinstance(row, list | tuple) and len(row) in (3, 6)
            sound = is_row and all(type(v) in (int, float) and abs(v) <= 1e8 for v in row)
            if not sound or (len(row) == 6 and not any(row[3:])):
                remedy = "give x, y, z, or x, y, z, dx, dy, dz, in metres"
                raise InputError("sensors", f"points.{number}", str(row)[:80], remedy)
        return table

    @model_validator(mode="after")
    def _one_source(self) -> PointSensors:
        if (self.points is None) == (not self.grids):
            got = "neither points nor grids" if self.points is None else "points and grids"
            raise InputError("sensors", "points", got, "give one of them")
        return self


def _kind(table: Any) -> str:
    """Kind of a table of sensors, by its keys or its class, in words that are no keys."""
    if isinstance(table, FloorSensors) or (isinstance(table, dict) and "floors" in table):
        return "grids above floors"
    if isinstance(table, SpaceSensors) or (isinstance(table, dict) and "spaces" in table):
        return "grids in spaces"
    listed = isinstance(table, dict) and ("points" in table or "grids" in table)
    return "single points" if isinstance(table, PointSensors) or listed else "box"


AnySensors = Annotated[
    Annotated[Sensors, Tag("box")]
    | Annotated[FloorSensors, Tag("grids above floors")]
    | Annotated[SpaceSensors, Tag("grids in spaces")]
    | Annotated[PointSensors, Tag("single points")],
    Discriminator(_kind),
]
"""Sensors of a case: a rectangular grid, grids above floors or in spaces, or points."""


def file_of_points(sensors: AnySensors) -> tuple[int, ...]:
    """Numbers of the file of points, which change with it; none of sensors without a file."""
    file = sensors.points if isinstance(sensors, PointSensors) else None
    return file_numbers(file) if isinstance(file, Path) and file.exists() else ()
