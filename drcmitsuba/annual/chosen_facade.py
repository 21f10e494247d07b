"""A façade of known elements in its daylight: what stays, what moves, and the light of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.choice import ChosenFills
from drcmitsuba.annual.simulation import joined_channels
from drcmitsuba.annual.summed_year import luminances_of, replicates_of
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, OTHERS, GroupStates, State
from drcmitsuba.case.schedule import HOURS, Schedule, hour_of_year, schedule_of
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import sensor_coordinates
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements import LightByElement


@dataclass(frozen=True, eq=False)
class MovingGroup:
    """Opening whose fill changes in a year: by the case, or by a choice for every hour."""

    name: str
    states: tuple[str, ...]
    opening: int
    shares: np.ndarray
    """Shares of the fills in every state, (state, fill)."""
    by_hour: np.ndarray | None
    """State in the hours of a year, int, (8760,); None where the rule of the shade tells it."""


def moving_groups(
    case: Case, openings: GroupStates, chosen: ChosenFills, time: xr.DataArray, *, follows: bool
) -> list[MovingGroup]:
    """Groups of a façade that change their state.

    Parameters
    ----------
    openings : GroupStates
        Openings of the case and their fills: its groups come first, in their order.
    time : xr.DataArray
        Time stamps of the choice.
    follows : bool
        Whether groups that the choice does not name follow the case's rule and schedules.
    """
    moving = []
    if follows:
        panes = PaneGroups.of(case)
        own, schedule = panes.states, schedule_of(case.groups, panes.states)
        for g, (name, states) in enumerate(zip(own.names, own.states, strict=True)):
            if len(states) > 1 and panes.facings[g] and g not in chosen.named:
                whole = np.eye(len(states), len(openings.states[g]), dtype=np.float32)
                moving.append(MovingGroup(name, states, g, whole, schedule.of_group.get(g)))
    for g, mixtures in chosen.hourly.items():
        hour, by_hour = hour_of_year(time), np.zeros(HOURS, int)
        by_hour[hour] = mixtures.index
        if (by_hour[hour] != mixtures.index).any():
            got = "different fills within an hour"
            raise InputError("choice", openings.names[g], got, "keep one for the whole hour")
        name, states = openings.names[g], mixtures.names
        moving.append(MovingGroup(name, states, g, mixtures.shares, by_hour))
    return moving


@dataclass(frozen=True, eq=False)
class ChosenFacade:
    """A façade of known elements: a `StateSource` of the states that its groups take."""

    case: Case
    openings: GroupStates
    channels: tuple[LightByElement, ...]
    still: np.ndarray
    """Shares of all elements where no group moves, shape (element,)."""
    moving: tuple[MovingGroup, ...]
    attributes: dict[str, Any]
    """Attributes of C: origin, groups, rule and schedules."""

    @classmethod
    def of(
        cls, case: Case, openings: PaneGroups, channels: tuple[LightByElement, ...],
        daylight: Daylight, effects: EnabledEffects, chosen: ChosenFills, *, follows: bool = True,
    ) -> ChosenFacade:  # fmt: skip
        """Put a choice on a case; `follows` as for `moving_groups`."""
        names, starts = openings.states, openings.states.starts
        still = np.zeros(starts[-1], np.float32)
        still[list(starts[:-1])] = 1
        for g, row in chosen.constant.items():
            still[starts[g] : starts[g + 1]] = row
        moving = moving_groups(case, names, chosen, daylight.sky["time"], follows=follows)
        marked = attributes(case, daylight, effects)
        for name in ("groups", "schedule", "shade_threshold", "shade_area"):
            marked.pop(name, None)
        marked["has_shade"] = int(bool(moving))
        if moving:
            threshold, area = case.shade_rule
            groups = _states(names, moving)
            marked |= {"shade_threshold": threshold, "shade_area": area, **groups.attributes()}
            marked |= Schedule(_by_hour(moving), len(groups)).attributes()
        tables = [(g.opening, g.shares) for g in moving]
        marked["fingerprint"] = str(content_key(marked["fingerprint"], still, tables))
        return cls(case, names, channels, still, tuple(moving), marked)

    @property
    def groups(self) -> GroupStates:
        """Groups as the attributes of C hold them."""
        return _states(self.openings, self.moving)

    def indices(self, time: xr.DataArray) -> np.ndarray:
        """State of every group by the hour, 0 where none tells it, int, (time, group)."""
        return Schedule(_by_hour(self.moving), len(self.moving)).indices(time)

    def shares(self, indices: np.ndarray) -> np.ndarray:
        """Shares of all elements (…, element), from the state of every group (…, group)."""
        out = np.broadcast_to(self.still, (*indices.shape[:-1], len(self.still))).copy()
        for k, group in enumerate(self.moving):
            first = self.openings.starts[group.opening]
            out[..., first : first + group.shares.shape[1]] = group.shares[indices[..., k]]
        return out

    def state(self, state: State, labels: np.ndarray | None, progress: Progress) -> xr.Dataset:
        """C [sr] of a state for all suns; see `StateSource`."""
        indices = np.array(self.groups.indices(state) if self.moving else (), int)
        shares = self.shares(indices)
        C = joined_channels([light.coefficients(shares) for light in self.channels])
        C = C.assign_coords(sensor_coordinates(self.case).coords)
        progress(1)
        return self._with_group_of_sun(C, shares) if state == OPEN else C

    def year(self, daylight: Daylight, indices: np.ndarray, progress: Progress) -> xr.Dataset:
        """`illuminance` [lx] of a year; see `StateSource`."""
        return xr.Dataset({"illuminance": self.illuminance(daylight, self.shares(indices))})

    def illuminance(self, daylight: Daylight, shares: np.ndarray) -> xr.DataArray:
        """E (replicate, time, sensor) [lx] of shares (time, element), by channel where coloured."""
        L = luminances_of(daylight, self.channels[0].labels)
        years = [light.illuminance(L, shares) for light in self.channels]
        return replicates_of(daylight, years, self.channels[0].replicates)

    def _with_group_of_sun(self, C: xr.Dataset, shares: np.ndarray) -> xr.Dataset:
        """Add `pane_group` (sensor, bin), by which most of a sun comes straight, −1 for none."""
        groups, starts = self.groups, self.openings.starts
        if not self.moving or len(groups) < 2:
            return C
        group_of = {group.opening: k for k, group in enumerate(self.moving)}
        light = self.channels[1 if len(self.channels) > 1 else 0]  # green stands for all colours
        out = np.full((C.sizes["sensor"], C.sizes["bin"]), -1, np.float32)
        most = np.zeros(out.shape, np.float32)
        for k in range(len(groups)):
            straight = np.zeros_like(most)
            for opening in range(len(self.openings)):
                if group_of.get(opening, len(groups) - 1) != k:
                    continue
                for e in range(starts[opening], starts[opening + 1]):
                    if shares[e]:
                        own = light.elements[e]
                        straight[:, own.bins] += shares[e] * own.straight.mean(axis=0).T
            out[straight > most] = k
            most = np.maximum(most, straight)
        out[:, : light.sky_bins] = -1  # a sun alone closes a group
        return C.assign(pane_group=(("sensor", "bin"), out))


def _by_hour(moving: Sequence[MovingGroup]) -> dict[int, np.ndarray]:
    """States in the hours of a year of the groups that have one for every hour."""
    return {k: g.by_hour for k, g in enumerate(moving) if g.by_hour is not None}


def _states(openings: GroupStates, moving: Sequence[MovingGroup]) -> GroupStates:
    """Groups that move, and the panes of all other openings in one that does not."""
    states = GroupStates(tuple(g.name for g in moving), tuple(g.states for g in moving))
    if len(moving) == len(openings) or states == GroupStates.of_shade():
        return states
    return GroupStates((*states.names, OTHERS), (*states.states, (OPEN,)))
