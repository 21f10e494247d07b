"""A façade of known elements in its daylight: what stays, what moves, and the light of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.choice import ChosenFills
from drcmitsuba.annual.moving_groups import MovingGroups, moving_groups
from drcmitsuba.annual.simulation import joined_channels
from drcmitsuba.annual.summed_year import luminances_of, replicates_of
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, GroupStates, State
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import Member, PaneGroups
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements import LightByElement, compute
from drcmitsuba.transport.elements.simulate import MOST_BYTES


def light_of_channels(
    case: Case, panes: PaneGroups, suns: Suns, accuracy: Accuracy, effects: EnabledEffects,
    progress: Progress, kept: int | None = None,
) -> tuple[LightByElement, ...]:  # fmt: skip
    """Light by element of every colour channel of a case; one of a grey case.

    Arguments and errors are those of `transport.elements.compute`.
    """
    numbers = scene.channels_of(case, effects)
    return tuple(
        compute(
            case, panes, suns, accuracy, effects, channel=number, kept=kept,
            most_bytes=MOST_BYTES // len(numbers),
            progress=part(progress, i / len(numbers), (i + 1) / len(numbers)),
        )
        for i, number in enumerate(numbers)
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ChosenFacade:
    """A façade of known elements: a `StateSource` of the states that its groups take."""

    case: Case
    openings: GroupStates
    channels: tuple[LightByElement, ...]
    still: np.ndarray
    """Shares of all elements where no group moves, shape (element,)."""
    moving: MovingGroups
    attributes: dict[str, Any]
    """Attributes of C: origin, groups, rule and schedules."""

    @classmethod
    def of(
        cls, case: Case, panes: PaneGroups, channels: tuple[LightByElement, ...],
        daylight: Daylight, effects: EnabledEffects, chosen: ChosenFills,
        drawn: Mapping[int, np.ndarray], members: Mapping[int, Member] | None = None,
    ) -> ChosenFacade:  # fmt: skip
        """Put a choice on a case; arguments as for `moving_groups`."""
        starts = panes.states.starts
        still = np.zeros(starts[-1], np.float32)
        still[list(starts[:-1])] = 1
        for g, row in {**drawn, **chosen.constant}.items():
            still[starts[g] : starts[g + 1]] = row
        moving = moving_groups(case, panes, chosen, drawn, daylight.sky["time"], members)
        marked = attributes(case, daylight, effects)
        for name in ("groups", "schedule", "shade_threshold", "shade_area"):
            marked.pop(name, None)
        marked["has_shade"] = int(bool(moving.groups))
        if moving.groups:
            threshold, area = case.shade_rule
            marked |= {"shade_threshold": threshold, "shade_area": area}
            marked |= moving.states.attributes() | moving.schedule.attributes()
        tables = [group.parts for group in moving.groups]
        marked["fingerprint"] = str(content_key(marked["fingerprint"], still, tables))
        return cls(case, panes.states, channels, still, moving, marked)

    def shares(self, indices: np.ndarray) -> np.ndarray:
        """Shares of all elements (…, element), from the state of every group (…, group)."""
        return self.moving.shares(self.still, indices)

    def state(self, state: State, labels: np.ndarray | None, progress: Progress) -> xr.Dataset:
        """C [sr] of a state for all suns; see `StateSource`."""
        indices = np.array(self.moving.states.indices(state), int)
        shares = self.shares(indices)
        C = joined_channels([light.coefficients(shares) for light in self.channels])
        C = C.assign_coords(prepared(self.case).receivers.coordinates.coords)
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
        groups, starts = self.moving.states, self.openings.starts
        if not self.moving.groups or len(groups) < 2:
            return C
        light = self.channels[1 if len(self.channels) > 1 else 0]  # green stands for all colours
        out = np.full((C.sizes["sensor"], C.sizes["bin"]), -1, np.float32)
        most = np.zeros(out.shape, np.float32)
        group = np.repeat(list(map(self.moving.number_of, range(len(starts) - 1))), np.diff(starts))
        for k in range(len(groups)):
            straight = np.zeros_like(most)
            for e in np.flatnonzero((group == k) & (shares != 0)):
                own = light.elements[e]
                straight[:, own.bins] += shares[e] * own.straight.mean(axis=0).T
            out[straight > most] = k
            most = np.maximum(most, straight)
        out[:, : light.sky_bins] = -1  # a sun alone closes a group
        return C.assign(pane_group=(("sensor", "bin"), out))
