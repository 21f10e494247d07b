"""State of the façade at every time stamp: by the rule of the shade, group by group, or a schedule.

LM-83 closes groups of panes until less than a fraction of a space's sensors lies in the sun. Every
grid of sensors is a space: each asks for those groups first through which most of its own sensors
are in the sun, and a group closes where any grid asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, VARYING, GroupStates, State
from drcmitsuba.case.schedule import Schedule, schedule_of
from drcmitsuba.metrics.grids import count_by_grid, grid_of_sensors
from drcmitsuba.metrics.shade import closing_sensors
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import luminance

FEW = 12
"""Number of states of the façade that are simulated one by one whatever groups there are; more of
them than elements, a group in one state each, are recombined from these."""


@dataclass(frozen=True)
class ShadeRule:
    """Rule by which groups of panes take their last state, and the schedules of the others."""

    groups: GroupStates
    threshold: float = 1000.0
    """Direct sun from which on a sensor counts [lx]."""
    area: float = 0.02
    """Fraction of a grid's sensors in the sun from which on groups close [–]."""
    schedule: Schedule = field(default_factory=Schedule)

    @classmethod
    def of(cls, attributes: Mapping[str, Any]) -> ShadeRule | None:
        """Read the rule from the attributes of C or E; None where nothing ever closes.

        Raises
        ------
        InputError
            There is a shade, but no rule.
        """
        if not attributes.get("has_shade", 0):
            return None
        if not {"shade_threshold", "shade_area"} <= attributes.keys():
            got = "the coefficients do not say when the shade closes"
            remedy = "compute them anew"
            raise InputError("coefficients", "shade_threshold, shade_area", got, remedy)
        threshold, area = attributes["shade_threshold"], attributes["shade_area"]
        groups = GroupStates.of_attributes(attributes)
        return cls(groups, threshold, area, Schedule.of_attributes(attributes, groups))

    @classmethod
    def of_case(cls, case: Case, groups: GroupStates) -> ShadeRule:
        """Rule and schedules of a case for its groups of panes."""
        return cls(groups, *case.shade_rule, schedule_of(case.groups, groups))

    def required(self, sensors: np.ndarray) -> np.ndarray:
        """Number of sensors in the sun that closes a group, of grids with so many `sensors`."""
        return np.array([closing_sensors(self.area, n) for n in sensors.tolist()], int)

    def closed(self, sunlit: np.ndarray, sensors: np.ndarray) -> np.ndarray:
        """Whether groups close.

        Parameters
        ----------
        sunlit : np.ndarray of int, shape (…, grid, group)
            Number of each grid's sensors in the sun by way of each group.
        sensors : np.ndarray of int, shape (grid,)
            Number of all sensors of each grid.

        Returns
        -------
        np.ndarray of bool, shape (…, group)
        """
        by_rule = self.by_rule
        sunlit = np.where(by_rule, sunlit, 0)
        order = np.argsort(-sunlit, axis=-1, kind="stable")
        falling = np.take_along_axis(sunlit, order, axis=-1)
        # The sensors that are left in the sun when all groups before in the order are closed.
        left = falling[..., ::-1].cumsum(axis=-1)[..., ::-1]
        closed = np.empty(sunlit.shape, bool)
        np.put_along_axis(closed, order, left >= self.required(sensors)[:, None], axis=-1)
        return closed.any(axis=-2) & by_rule

    @property
    def by_rule(self) -> np.ndarray:
        """Whether each group closes by this rule, bool, shape (group,)."""
        return np.array(self.groups.closable) & ~self.schedule.given

    def indices(self, closed: np.ndarray, time: xr.DataArray) -> np.ndarray:
        """Index of the state of every group, int, (time, …, group), from `closed` of this shape."""
        by_rule = closed * np.array(self.groups.last)
        if not self.schedule.of_group:
            return by_rule
        scheduled = self.schedule.indices(time)
        middle = (1,) * (closed.ndim - 2)
        scheduled = scheduled.reshape(len(scheduled), *middle, scheduled.shape[-1])
        return np.where(self.schedule.given, scheduled, by_rule)


def sunlit(direct: xr.Dataset, rule: ShadeRule) -> np.ndarray:
    """Number of each grid's sensors in the sun by way of every group, (time, grid, group).

    `direct` is from `illuminance.direct_sun` [lx].
    """
    grid = grid_of_sensors(direct)
    E = luminance(direct["direct_sun"]).transpose("time", "sensor").values
    reached = rule.threshold <= E
    if len(rule.groups) == 1 and "sun_group" not in direct:
        return count_by_grid(reached, grid)[..., None]
    group = sun_group(direct)
    each = [count_by_grid(reached & (group == g), grid) for g in range(len(rule.groups))]
    return np.stack(each, axis=-1)


def sun_group(direct: xr.Dataset) -> np.ndarray:
    """Group through which the direct sun comes, int, shape (time, sensor), −1 for none."""
    if "sun_group" not in direct:
        got = "the direct sun does not say through which group of panes it comes"
        raise InputError("coefficients", "pane_group", got, "compute them anew")
    return np.asarray(direct["sun_group"].transpose("time", "sensor").values).astype(np.int16)


@dataclass(frozen=True)
class FacadeStates:
    """State of the façade at every time stamp."""

    states: tuple[State, ...]
    """States that occur; the open one comes first, whether it occurs or not."""
    index: np.ndarray
    """Index of the state of every time stamp, int, shape (time,)."""
    of_group: np.ndarray
    """Index of the state of every group at every time stamp, int, shape (time, group)."""

    @classmethod
    def of(cls, attributes: Mapping[str, Any], direct: xr.Dataset) -> FacadeStates:
        """States by the rule in the attributes of C and the direct sun, all groups open [lx]."""
        rule = ShadeRule.of(attributes)
        if rule is None:
            stamps = direct.sizes["time"]
            return cls((OPEN,), np.zeros(stamps, int), np.zeros((stamps, 0), int))
        closed = rule.closed(sunlit(direct, rule), np.bincount(grid_of_sensors(direct)))
        indices = rule.indices(closed, direct["time"])
        return cls(*numbered(rule.groups, indices), indices)


def shares_of_states(indices: np.ndarray, groups: GroupStates) -> dict[str, dict[str, float]]:
    """Share of the time stamps in each state of every group that has several [%].

    `indices` (time, group) are those of the states.
    """
    return {
        name: {s: 100 * float((indices[:, g] == i).mean()) for i, s in enumerate(states)}
        for g, (name, states) in enumerate(zip(groups.names, groups.states, strict=True))
        if len(states) > 1
    }


def most_states(groups: GroupStates) -> int:
    """Largest number of states of the façade that are simulated one by one."""
    return max(FEW, sum(map(len, groups.states)))


def numbered(groups: GroupStates, indices: np.ndarray) -> tuple[tuple[State, ...], np.ndarray]:
    """States that occur among indices (…, group), the open one first; the state of each (…).

    Where they are too many, all but the open one are `VARYING`.
    """
    every = indices.reshape(-1, len(groups))
    number = np.zeros(len(every), np.int64)
    for column in every.T:  # by the first group, then by the second, …
        _, number = np.unique(number * (1 + every.max()) + column, return_inverse=True)
    _, first = np.unique(number, return_index=True)
    rows, of_indices = every[first], number.reshape(indices.shape[:-1])
    if len(rows) > most_states(groups):
        return (OPEN, VARYING), indices.any(axis=-1).astype(int)
    states = [groups.label(row) for row in rows]
    if OPEN not in states:
        return (OPEN, *states), of_indices + 1
    return tuple(states), of_indices  # (0, …, 0) is the least row
