"""Draws of the state of the façade: which groups of panes the direct sun closes, hour by hour."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import OPEN, VARYING, State
from drcmitsuba.metrics.facade_states import ShadeRule, numbered
from drcmitsuba.metrics.grids import count_by_grid
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.metrics.intervals.sun import BLOCK, SunDraws, unpacked

HOURS = 64
"""Number of time stamps whose groups are drawn at once."""


class DrawnStates(NamedTuple):
    """States that a façade takes in some draws, in place of those by the mean of the direct sun."""

    hours: np.ndarray
    """Time stamps whose state differs between draws, shape (hour,)."""
    others: np.ndarray
    """Other states of every time stamp, an index; that by the mean where there are fewer, shape
    (other, time)."""
    drawn: np.ndarray
    """Number of the other state that each draw takes, from 1; 0 for that by the mean, shape (hour,
    draw)."""


@dataclass(frozen=True)
class Closures:
    """State of the façade at every time stamp, and in every draw."""

    states: tuple[State, ...]
    """States that occur in some draw, the open one first."""
    state: np.ndarray
    """State of every time stamp by the mean of the direct sun, an index, shape (time,)."""
    closed: np.ndarray
    """Share of the groups that are closed then, shape (time,)."""
    hours: np.ndarray
    """Time stamps whose state differs between draws, shape (hour,); empty where the states are too
    many to be simulated one by one."""
    drawn: np.ndarray
    """Their state in each draw, an index, shape (hour, draw)."""
    closed_drawn: np.ndarray
    """Share of the groups that are closed then, shape (hour, draw)."""

    @classmethod
    def never(cls, stamps: int) -> Closures:
        """No shade, or one that stays open."""
        none, drawn = np.zeros(0, np.int64), np.zeros((0, DRAWS))
        return cls((OPEN,), np.zeros(stamps, int), np.zeros(stamps), none, drawn.astype(int), drawn)

    def at(self, hours: np.ndarray) -> Closures:
        """Closures of some time stamps, indices in rising order, int, shape (chosen,)."""
        kept = np.isin(self.hours, hours)
        return Closures(
            self.states, self.state[hours], self.closed[hours],
            np.searchsorted(hours, self.hours[kept]), self.drawn[kept], self.closed_drawn[kept],
        )  # fmt: skip

    def in_draws(self) -> DrawnStates:
        """States of the hours in which draws differ."""
        differs = self.drawn != self.state[self.hours, None]
        others = [np.unique(row[own]) for row, own in zip(self.drawn, differs, strict=True)]
        every = np.tile(self.state, (max(map(len, others), default=0), 1))
        number = np.zeros_like(self.drawn)
        for i, (hour, own) in enumerate(zip(self.hours, others, strict=True)):
            every[: len(own), hour] = own
            for k, state in enumerate(own, 1):
                number[i, self.drawn[i] == state] = k
        return DrawnStates(self.hours, every, number)

    def shares(self, month: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shares of the hours with the shade closed [%], mean of all groups.

        Shapes (draw,) and (month, draw).

        `month` (time,) counts from 0.
        """
        sure = self.closed.copy()
        sure[self.hours] = 0
        stamps = np.bincount(month, minlength=12)[:, None]
        counts = np.repeat(np.bincount(month, sure, minlength=12)[:, None], DRAWS, axis=1)
        np.add.at(counts, month[self.hours], self.closed_drawn)
        with np.errstate(invalid="ignore"):
            monthly = 100.0 * counts / stamps
        return 100.0 * counts.sum(axis=0) / len(month), monthly

    @property
    def others(self) -> dict[State, np.ndarray]:
        """Time stamps at which each state but the open one occurs in some draw, bool (time,)."""
        return dict(zip(self.states[1:], self.possible[1:], strict=True))

    @cached_property
    def possible(self) -> np.ndarray:
        """Whether each state occurs at a time stamp in some draw, shape (state, time)."""
        out = np.arange(len(self.states))[:, None] == self.state
        for state in range(len(self.states)):
            out[state, self.hours] |= (self.drawn == state).any(axis=1)
        return out


@dataclass(frozen=True)
class SunlitSensors:
    """Numbers of sensors in the sun by grid and group, and the entries in doubt among them."""

    count: np.ndarray
    """By the mean of the direct sun, int, shape (time, grid, group)."""
    sure: np.ndarray
    """The same without entries in doubt."""
    doubtful: np.ndarray
    """Number of entries in doubt, int, shape (time, grid, group)."""
    place: np.ndarray
    """Places in `count` whose entries in doubt are drawn, in rising order, int, shape (place,)."""
    closing: np.ndarray
    """Number of their entries that reach the rule's threshold in each draw, (place, draw)."""

    @classmethod
    def of(
        cls, passes: np.ndarray, group: np.ndarray | None, grid: np.ndarray, groups: int,
        sun: SunDraws, grids: int = 0, least: np.ndarray | None = None,
    ) -> SunlitSensors:  # fmt: skip
        """Count; `passes` and `group` have the shape (time, sensor), `grid` (sensor,).

        `group` is None where there is a single one.

        Where these are all sensors, of which grids ask for `least` (grid,), only hours in doubt are
        drawn.
        """
        masks = (passes if group is None else passes & (group == g) for g in range(groups))
        count = np.stack([count_by_grid(mask, grid, grids) for mask in masks], axis=-1)
        through = np.zeros(len(sun.time), int) if group is None else group[sun.time, sun.sensor]
        at = (sun.time * count.shape[1] + grid[sun.sensor]) * groups + through
        order = np.argsort(at, kind="stable")
        order = order[through[order] >= 0]  # sun through no group closes none
        time, sensor, at = sun.time[order], sun.sensor[order], at[order]
        by_mean = np.bincount(at, passes[time, sensor], count.size).astype(int)
        doubtful = np.bincount(at, minlength=count.size).reshape(count.shape)
        sure, none = count - by_mean.reshape(count.shape), np.zeros(0, np.int64)
        every = cls(count, sure, doubtful, none, np.zeros((0, DRAWS), np.uint32))
        if least is not None:
            asks = every.in_doubt(least)[time, grid[sensor]]
            order, at = order[asks], at[asks]
        place = np.unique(at)
        closing = np.zeros((len(place), DRAWS), np.uint32)
        for start in range(0, len(order), BLOCK):
            here = slice(start, start + BLOCK)
            some, begins = np.unique(at[here], return_index=True)
            bits = unpacked(sun.closing[order[here]])
            sums = np.add.reduceat(bits, begins, axis=0, dtype=np.uint32)
            closing[np.searchsorted(place, some)] += sums
        return replace(every, place=place, closing=closing)

    def plus(self, other: SunlitSensors) -> SunlitSensors:
        """Count the sensors of two blocks, the grids of which have the same numbers."""
        place = np.union1d(self.place, other.place)
        closing = np.zeros((len(place), DRAWS), np.uint32)
        for one in (self, other):
            closing[np.searchsorted(place, one.place)] += one.closing
        return SunlitSensors(
            self.count + other.count, self.sure + other.sure, self.doubtful + other.doubtful,
            place, closing,
        )  # fmt: skip

    def without_certain(self, least: np.ndarray) -> SunlitSensors:
        """Leave out the entries of hours and grids that close a single group for certain.

        Grids ask for `least` sensors (grid,); further sensors do not change that.
        """
        if self.sure.shape[-1] > 1:
            return self
        kept = (self.sure[..., 0] < least).ravel()[self.place]
        return replace(self, place=self.place[kept], closing=self.closing[kept])

    def in_doubt(self, least: np.ndarray) -> np.ndarray:
        """Whether doubt remains about what a grid closes that asks for `least` sensors (grid,).

        Shape (time, grid).
        """
        most = self.sure + self.doubtful
        certain = (self.sure.sum(axis=-1) >= least) & ((most > 0).sum(axis=-1) < 2)
        return (most.sum(axis=-1) >= least) & ~certain & self.doubtful.any(axis=-1)

    def drawn(self, hours: np.ndarray) -> np.ndarray:
        """Draws of the numbers of some time stamps, int, shape (hour, draw, grid, group).

        `hours` (hour,) rise.
        """
        size = self.sure[0].size
        hour, number = np.divmod(self.place, size)
        at = np.minimum(np.searchsorted(hours, hour), len(hours) - 1)
        asked = hours[at] == hour
        out = np.repeat(self.sure[hours].reshape(-1, 1, size), DRAWS, axis=1)
        out[at[asked], :, number[asked]] += self.closing[asked]
        return out.reshape(-1, DRAWS, *self.sure.shape[1:])


def draw_closures(
    mean: np.ndarray, group: np.ndarray | None, grid: np.ndarray, time: xr.DataArray,
    sun: SunDraws, rule: ShadeRule,
) -> Closures:  # fmt: skip
    """Draw which groups of panes close: where ≥ area of a grid's sensors reach the threshold.

    `mean` is the direct sun (time, sensor) [lx], `group` the group through which it comes, None for
    a single one, `grid` the number of each sensor's grid (sensor,), `time` the time stamps, `sun`
    the draws of the direct sun.
    """
    sensors = np.bincount(grid)
    sunlit = sunlit_sensors(mean, group, grid, sun, rule, least=rule.required(sensors))
    return closures_from(sunlit, sensors, time, rule)


def sunlit_sensors(
    mean: np.ndarray, group: np.ndarray | None, grid: np.ndarray, sun: SunDraws, rule: ShadeRule,
    grids: int = 0, least: np.ndarray | None = None,
) -> SunlitSensors:  # fmt: skip
    """Count the sensors in the sun; arguments as for `draw_closures` and `SunlitSensors.of`.

    There are at least `grids` grids.
    """
    passes, groups = mean >= rule.threshold, len(rule.groups)
    return SunlitSensors.of(passes, group, grid, groups, sun, grids, least)


def closures_from(
    sunlit: SunlitSensors, sensors: np.ndarray, time: xr.DataArray, rule: ShadeRule
) -> Closures:
    """Closures of all sensors; grids have so many `sensors` (grid,)."""
    stamps, groups = len(sunlit.count), len(rule.groups)
    closed, in_doubt = rule.closed(sunlit.count, sensors), sunlit.in_doubt(rule.required(sensors))
    hours = np.flatnonzero(in_doubt.any(axis=-1))
    drawn = np.empty((len(hours), DRAWS, groups), bool)
    alike, which = np.unique(in_doubt[hours], axis=0, return_inverse=True)
    for k, asks in enumerate(alike):  # hours in which the same grids are in doubt
        every = np.flatnonzero(which == k)
        for some in (every[start : start + HOURS] for start in range(0, len(every), HOURS)):
            here = hours[some]
            drawn[some] = rule.closed(sunlit.drawn(here)[:, :, asks], sensors[asks])
            by_mean = rule.closed(sunlit.count[here][:, ~asks], sensors[~asks])
            drawn[some] |= by_mean[:, None]
    varies = (drawn != closed[hours][:, None]).any(axis=(1, 2))
    hours, drawn = hours[varies], drawn[varies]
    by_mean, by_draw = rule.indices(closed, time), rule.indices(drawn, time[hours])
    states, number = numbered(rule.groups, np.concatenate([by_mean, by_draw.reshape(-1, groups)]))
    if VARYING in states:  # every draw takes the state by the mean sun
        states, number = numbered(rule.groups, by_mean)
        hours, by_draw = hours[:0], by_draw[:0]
    of_draw = number[stamps:][: by_draw.shape[0] * DRAWS].reshape(-1, DRAWS)
    share, share_drawn = (rule.groups.share_closed(x) for x in (by_mean, by_draw))
    return Closures(states, number[:stamps], share, hours, of_draw, share_drawn)
