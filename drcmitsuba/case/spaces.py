"""The tables `[spaces.NAME]` of a case: rooms of a building, where its model does not tell them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Annotated

import shapely
from pydantic import Field

from drcmitsuba.case.uses import TaskTable, UseTable, clock_hours
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.model.space import Space, SpaceFloor, overlaps
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Illuminance, Length, Name, OnMap, choose, shortened

Corner = tuple[OnMap, OnMap]


class SpaceTable(TaskTable):
    """Room of a building; what a space of the model has already may be left out."""

    outline: Annotated[tuple[Corner, ...], Field(min_length=3, max_length=10_000)] | None = None
    """Corners x, y of its floor in plan, in turn [m]; by default those of the model's space."""
    floor: OnMap = 0.0
    """Height of the floor of an `outline` [m]."""
    height: Length | None = None
    """Height of the room of an `outline` [m]; by default up to the next floor of another space."""
    use: Name | None = None
    """Use of the room, such as "office": one of [uses], of the program's uses, or any other."""
    storey: Name | None = None
    """Name of its storey."""
    threshold: Illuminance | None = None
    """Illuminance that its task wants [lx]; by default the target of its use."""
    groups: Annotated[tuple[Name, ...], Field(max_length=100)] = ()
    """Names of [groups] that belong to it: the rule of [shading] closes them by the sun on sensors
    of these spaces alone."""

    def space(self, name: str, known: Space | None, source: str) -> Space:
        """Space of this table.

        Raises
        ------
        InputError
            The outline crosses itself or has no area, or there is none and the model has no space
            of this name.
        """
        keys = {n: getattr(self, n) for n in ("use", "storey", "hours", "power", "groups")}
        keys = {n: value for n, value in (keys | {"target": self.threshold}).items() if value}
        if self.outline is None:
            if known is None:
                got = "no outline, and the model has no space of this name"
                remedy = "give the corners of its floor: outline = [[0, 0], [5, 0], [5, 4]]"
                raise InputError(source, f"spaces.{name}.outline", got, remedy)
            return replace(known, **keys)
        shape = shapely.Polygon(self.outline)
        if not shape.is_valid or not shape.area > 0:
            got = shapely.is_valid_reason(shape) if shape.area > 0 else "no area"
            remedy = "give its corners in turn"
            raise InputError(source, f"spaces.{name}.outline", got, remedy)
        ceiling = float("inf") if self.height is None else self.floor + self.height
        volume = None if self.height is None else float(shape.area) * self.height
        floor = SpaceFloor(self.floor, shape)
        return replace(Space(name, (floor,), ceiling, volume=volume), **keys)


def check_box(spaces: Mapping[str, SpaceTable], name: str) -> None:
    """Refuse spaces other than the box itself, which has the `name` of its case."""
    for stated, space in spaces.items():
        if stated != name:
            got, remedy = (
                "a box is one space, which has the name of the case",
                choose(stated, [name]),
            )
            raise InputError("case", f"spaces.{stated}", got, remedy)
        if space.outline is not None:
            got, remedy = "the floor of a box is that of [room]", "leave it out"
            raise InputError("case", f"spaces.{stated}.outline", got, remedy)


def check_spaces(
    spaces: Mapping[str, SpaceTable], uses: Mapping[str, UseTable], groups: Collection[str],
    period: PeriodTable,
) -> None:  # fmt: skip
    """Refuse hours of which the period has none, and groups that a case does not have."""
    if period.timestamps is None and (known := clock_hours(period.hours)):
        tasks: dict[str, TaskTable] = {f"spaces.{name}": table for name, table in spaces.items()}
        for name, task in (tasks | {f"uses.{name}": use for name, use in uses.items()}).items():
            hours = task.hours
            if hours is not None and not known & clock_hours(hours):
                got = f"{hours[0]} to {hours[1]} h, of which the period has none"
                first, last = period.hours
                remedy = f"give hours in [period] beside {first} to {last} h"
                raise InputError("case", f"{name}.hours", got, remedy)
    for name, space in spaces.items():
        for group in space.groups:
            if group not in groups:
                got, remedy = f"there is no group {shortened(group)}", choose(group, list(groups))
                raise InputError("case", f"spaces.{name}.groups", got, remedy)


def with_tables(
    known: tuple[Space, ...], tables: Mapping[str, SpaceTable], source: str
) -> tuple[Space, ...]:
    """Spaces of a model with those of a case in place of the ones of their names, others behind.

    Raises
    ------
    InputError
        As `SpaceTable.space`; or two spaces overlap of which a table states one.
    """
    by_name = {space.name: space for space in known}
    for name, table in tables.items():
        by_name[name] = table.space(name, by_name.get(name), source)
    every = tuple(by_name.values())
    if any(table.outline is not None for table in tables.values()):
        _refuse_overlap(every, tables, source)
    return every


def _refuse_overlap(
    spaces: tuple[Space, ...], tables: Mapping[str, SpaceTable], source: str
) -> None:
    for first, second, at in overlaps(spaces):
        if first.name not in tables:
            first, second = second, first
        if first.name in tables:
            got = f"it overlaps {shortened(second.name)} at ({at[0]:.2f}, {at[1]:.2f})"
            field = f"spaces.{first.name}.outline"
            raise InputError(source, field, got, "give every space its own floor")
