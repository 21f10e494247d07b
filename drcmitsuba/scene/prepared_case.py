"""A case made ready: groups of panes, spaces, receivers, views, each found once in a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import file_of_points
from drcmitsuba.model.model import View
from drcmitsuba.model.space import Space, space_at
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import origin, rotation
from drcmitsuba.scene.like_panes import tells_spaces
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import (
    PlacedSensors,
    placed_sensors,
    sensor_coordinates,
    sensor_points,
)
from drcmitsuba.scene.spaces import spaces_of
from drcmitsuba.scene.views import views

UNREAD = ("accuracy",)
"""Tables that no part depends on: each state of a year of glare has samples of its own."""
KEPT = 8
"""Number of cases that are kept ready."""


@dataclass(frozen=True, eq=False)
class Receivers:
    """Points at which illuminance is computed."""

    points: np.ndarray
    """Positions in the world frame, relative to the case's `geometry.origin` [m], (sensor, 3)."""
    normals: np.ndarray
    """Unit normals, shape (sensor, 3)."""
    coordinates: xr.Dataset
    """Coordinates of the sensors, as `sensors.sensor_coordinates` gives them."""

    def __len__(self) -> int:
        """Count the sensors."""
        return len(self.points)

    def at(
        self, some: slice | np.ndarray | list[int] = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions and normals of some sensors, by default of all."""
        return self.points[some], self.normals[some]


@dataclass(frozen=True, eq=False)
class PreparedCase:
    """A case with what follows from its tables alone; a part is found when it is first asked for.

    Errors are those of the functions that find it.
    """

    case: Case

    @cached_property
    def groups(self) -> PaneGroups:
        """Panes that change together, see `PaneGroups.of`."""
        return PaneGroups.of(self.case)

    @cached_property
    def windows(self) -> PaneGroups:
        """Panes that count as one window, see `PaneGroups.of_windows`."""
        return PaneGroups.of_windows(self.case)

    @cached_property
    def sensors(self) -> PlacedSensors:
        """Sensors in the frame of the case's file, see `sensors.placed_sensors`."""
        return placed_sensors(self.case)

    @cached_property
    def receivers(self) -> Receivers:
        """Sensors, see `sensors.sensor_points`."""
        points, normals = sensor_points(self.case, self.sensors)
        for array in (points, normals):
            array.flags.writeable = False  # every room reads the same ones
        return Receivers(points, normals, sensor_coordinates(self.case, self.sensors))

    @cached_property
    def views(self) -> tuple[View, ...]:
        """Views of the case and of its model, see `views.views`."""
        return views(self.case)

    @cached_property
    def spaces(self) -> tuple[Space, ...]:
        """Rooms of the building by name, see `spaces.spaces_of`, with the groups of their panes."""
        spaces, groups = spaces_of(self.case), dict[str, list[str]]()
        if not tells_spaces(self.case):
            return spaces
        for group, own in zip(self.groups.states.names, self.groups.spaces, strict=False):
            for space in own:
                groups.setdefault(space, []).append(group)
        named = ((s, (*s.groups, *groups.get(s.name, ()))) for s in spaces)
        return tuple(replace(space, groups=(*dict.fromkeys(every),)) for space, every in named)

    def rooms_of(self, points: np.ndarray) -> np.ndarray | None:
        """Space of points (point, 3) in the frame of the receivers: its index, −1 for none.

        It is None where the case does not tell several spaces apart.
        """
        if len(self.spaces) < 2:
            return None
        return space_at(self.spaces, points @ rotation(self.case) + origin(self.case))

    def check(self) -> None:
        """Refuse unfit sensors and groups before any work begins."""
        _ = self.receivers, self.groups


class _SameTables:
    """Key of a case that only the same objects equal: tables are frozen, and large to compare.

    Named tables stand in dicts, which a user may change, and a file of points is read anew. Sensors
    of models are found by rays, so a variant of Mitsuba has its own.
    """

    def __init__(self, case: Case) -> None:
        read = [getattr(case, name) for name in type(case).model_fields if name not in UNREAD]
        named = [(*of.items(),) for of in read if isinstance(of, dict)]
        ids = [(name, id(table)) for of in named for name, table in of]
        self.case, self.named = case, named  # kept, so that no other object has their ids
        written = file_of_points(case.sensors)
        self.key = (*map(id, (case.building, *read)), *ids, written, case.source, mi.variant())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _SameTables) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@lru_cache(maxsize=KEPT)
def _prepared(key: _SameTables) -> PreparedCase:
    return PreparedCase(key.case)


def prepared(case: Case) -> PreparedCase:
    """Make a case ready, once for each case; cases that differ in `UNREAD` tables share it.

    Raises
    ------
    InputError
        The files of `[model]` were not read, as of a case that is made of tables.
    """
    if case.model is not None and not case.building.layers:
        got, remedy = "its files were not read", "take load_case; with_tables changes its tables"
        raise InputError(case.source, "model", got, remedy)
    if case.model is not None and mi.variant() is None:  # rays find the sensors of a model
        backend.select()
    return _prepared(_SameTables(case))
