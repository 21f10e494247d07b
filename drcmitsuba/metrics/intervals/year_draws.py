"""Draws of a year: of its direct sun, of the façade's states, of the illuminance in each state."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import sun_group
from drcmitsuba.metrics.grids import grid_of_sensors
from drcmitsuba.metrics.intervals.autonomy import (
    Multipliers,
    State,
    draw_autonomy,
    multipliers,
)
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.facade_draws import Closures, draw_closures
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.metrics.intervals.sun import SunDraws, unpacked
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import by_luminance

Arrays = Mapping[Hashable, xr.DataArray]
"""E by luminance: `total`, `total_open`, `direct_sun` and their standard errors [lx]."""


@dataclass(frozen=True)
class YearDraws:
    """Numbers that all draws of a year share: each draw counts any threshold by them."""

    direct: np.ndarray
    """Mean direct sun (time, sensor) [lx]."""
    sun: SunDraws
    """Draws of its entries in doubt."""
    closures: Closures
    """State of the façade at every time stamp, and in every draw."""
    states: list[State]
    """Illuminance of every state."""
    multipliers: Multipliers
    """Random numbers of the illuminance."""

    @classmethod
    def of(
        cls, coefficients: Coefficients, sky: xr.Dataset, E: Arrays, sun: SunDraws, shut: Closures,
        seed: int,
    ) -> YearDraws:  # fmt: skip
        """Draw the illuminance of all states that occur in `shut`, from C, the sky and E of it."""
        states = _states(coefficients.by_luminance(), sky, E, shut)
        drawn = multipliers(coefficients.open.sizes["replicate"], seed)
        return cls(E["direct_sun"].values, sun, shut, states, drawn)

    def autonomy(self, threshold: float, needed: Needed) -> BootstrapCounts:
        """Count, in every draw, the sensors that reach `threshold` [lx] often enough."""
        return draw_autonomy(self.states, self.closures, threshold, needed, self.multipliers)

    def exposure(self, threshold: float, needed: Needed) -> BootstrapCounts:
        """Count the sensors in direct sun of `threshold`, to which it was drawn, often enough."""
        sun, shape = self.sun, (self.direct.shape[1], 12)
        place = sun.sensor * 12 + needed.month[sun.time]
        by_mean = self.direct[sun.time, sun.sensor] >= threshold
        drawn, passing = (np.bincount(place, each, shape[0] * 12) for each in (None, by_mean))
        sure = needed.count(self.direct >= threshold) - passing.astype(int).reshape(shape)
        tally = BootstrapCounts(needed, sure, drawn.reshape(shape))
        entry = tally.chosen(sun.time, sun.sensor)
        time, sensor = sun.time[entry], sun.sensor[entry]
        for block in tally.blocks(sensor):
            exposed = unpacked(sun.exposed[entry[block]]).view(bool)
            tally.add(tally.counted(sensor[block], time[block], exposed))
        return tally


def closures_of(direct: xr.Dataset, sun: SunDraws, rules: Rules) -> Closures:
    """Draw when groups of panes close, from the direct sun and its draws."""
    mean, rule = direct["direct_sun"], rules.shade
    is_one = len(rule.groups) == 1 and "sun_group" not in direct
    group = None if is_one else sun_group(direct)
    return draw_closures(mean.values, group, grid_of_sensors(direct), mean["time"], sun, rule)


def open_state(coefficients: Coefficients, sky: xr.Dataset, E: Arrays) -> State:
    """Illuminance of the open state, `total_open` of E, at all time stamps."""
    everywhere = np.ones(sky.sizes["time"], bool)
    known = E["total_open"].values, E["total_open_se"].values
    return State.of(by_luminance(coefficients.open), sky, everywhere, known, everywhere)


def _states(coefficients: Coefficients, sky: xr.Dataset, E: Arrays, shut: Closures) -> list[State]:
    """Illuminance of all states at the hours that they are wanted for.

    E of the open state is known at all hours, or, as of the others, while the façade is in it.
    """
    everywhere = np.ones(len(shut.state), bool)
    states = []
    for k, (name, wanted) in enumerate(zip(shut.states, shut.possible, strict=True)):
        is_whole = k == 0 and "total_open" in E
        suffix, is_known = ("_open", everywhere) if is_whole else ("", shut.state == k)
        known = E[f"total{suffix}"].values, E[f"total{suffix}_se"].values
        if name not in coefficients.states:
            remedy = "compute the coefficients of all states"
            raise InputError("coefficients", "state", f"no {name!r}", remedy)
        states.append(State.of(coefficients.states[name], sky, wanted, known, is_known))
    return states
