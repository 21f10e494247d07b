"""Groups of panes in a search: the states that the façade may take, hard and smooth.

A group closes by LM-83's rule, or follows its schedule. E of every hour is that of the state which
the groups take; its smooth twin mixes the states, each by the product of the shares of its groups.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.annual.attributes import spaces_text
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates, State
from drcmitsuba.metrics import smooth, smooth_step
from drcmitsuba.metrics.facade_states import ShadeRule
from drcmitsuba.metrics.grids import count_by_grid, grid_of_sensors
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.metrics.watched_groups import outside_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.transport.elements.state_illuminances import Illuminances

MOST_STATES = 32
"""Largest number of states of the façade that a search holds."""


@dataclass(frozen=True, eq=False)
class FacadeGroups:
    """Rule of the groups of a case at its time stamps, and the states that they may take."""

    rule: ShadeRule
    time: xr.DataArray
    """Time stamps, with the coordinate `time`."""
    grid: np.ndarray
    """Number of every sensor's grid, int, shape (sensor,)."""
    indices: np.ndarray
    """State of every group, an index, in each state of the façade, all groups open first, all in
    their last state next, int, shape (state, group)."""
    outside: np.ndarray
    """Whether each group belongs to other spaces than a sensor's, bool, shape (group, sensor)."""

    @classmethod
    def of(
        cls, rule: ShadeRule, time: xr.DataArray, grid: np.ndarray, outside: np.ndarray,
        source: str, most: int = MOST_STATES,
    ) -> FacadeGroups:  # fmt: skip
        """Find the states; InputError where there are more than `most`."""
        groups, by_rule = rule.groups, rule.by_rule
        scheduled = rule.indices(np.zeros((len(time), len(groups)), bool), time)
        rows = np.unique(scheduled, axis=0)
        last = np.array(groups.last)
        if len(rows) << int(by_rule.sum()) > most:
            got = f"more than {most} states of the façade, by {len(groups)} groups"
            remedy = "join groups that close together, or name fewer states in their schedules"
            raise InputError(source, "groups", got, remedy)
        closed = np.array([*product((0, 1), repeat=int(by_rule.sum()))], bool)
        every = np.repeat(rows, len(closed), axis=0)
        every[:, by_rule] = np.tile(closed, (len(rows), 1)) * last[by_rule]
        first = np.stack([np.zeros_like(last), last])
        others = [row for row in every if (row != first).any(axis=1).all()]
        return cls(rule, time, grid, np.array([*first, *others]), outside)

    @classmethod
    def of_case(
        cls, case: Case, groups: GroupStates, time: xr.DataArray, most: int = MOST_STATES
    ) -> FacadeGroups:
        """Groups of a case by its rule and schedules; InputError as `of`."""
        at = prepared(case).receivers.coordinates.assign_attrs(spaces=spaces_text(case))
        grid, outside = grid_of_sensors(at), outside_of(groups, at)
        return cls.of(ShadeRule.of_case(case, groups), time, grid, outside, case.source, most)

    def at(self, hours: np.ndarray) -> FacadeGroups:
        """Groups at some time stamps (hour,)."""
        return replace(self, time=self.time[hours])

    @cached_property
    def _scheduled(self) -> np.ndarray:
        """State of every group while none closes by the rule, an index, int, (time, group)."""
        none = np.zeros((len(self.time), len(self.rule.groups)), bool)
        return self.rule.indices(none, self.time)

    @cached_property
    def _required(self) -> np.ndarray:
        """Sensors in the sun that close a group, by grid."""
        return self.rule.required(np.bincount(self.grid))

    @property
    def states(self) -> tuple[State, ...]:
        """States of the façade in the order of `indices`."""
        return tuple(self.rule.groups.label(row) for row in self.indices.tolist())

    def places(self, indices: np.ndarray) -> np.ndarray:
        """Places in `indices` of states, given by every group's index (…, group), int, (…)."""
        same = (indices[..., None, :] == self.indices).all(axis=-1)
        return np.asarray(same.argmax(axis=-1))

    def places_of(self, other: FacadeGroups) -> np.ndarray:
        """Places in `indices` of another façade's states, which has all of these groups, int."""
        every = other.rule.groups.names
        own = [every.index(name) for name in self.rule.groups.names]
        return self.places(other.indices[:, own])

    @cached_property
    def by_schedule(self) -> np.ndarray:
        """State at each time stamp while no group closes by the rule, an index, int, (time,)."""
        return self.places(self._scheduled)

    def hours(self, may_close: np.ndarray) -> np.ndarray:
        """Time stamps at which each state has a share, bool, (state, time).

        `may_close` (time,) tells when groups may close by the rule, in part by the smooth twin.
        """
        by_rule = self.rule.by_rule
        agrees = by_rule | (self._scheduled[:, None] == self.indices)
        closes = (self.indices[:, by_rule] != 0).any(axis=1)
        return np.asarray((agrees.all(axis=-1) & (may_close[:, None] | ~closes)).T)

    def applied(self, E: Illuminances) -> np.ndarray:
        """E (time, sensor) [lx] in the states that the groups take."""
        group, reached = self._group_of_sun(E), E.direct.numpy() >= self.rule.threshold
        every = range(len(self.rule.groups))
        each = [count_by_grid(reached & (group == g), self.grid) for g in every]
        closed = self.rule.closed(np.stack(each, axis=-1), np.bincount(self.grid))
        taken = self.rule.indices(closed, self.time)
        same = (taken[:, None] == self.indices).all(axis=-1)
        states = np.stack([state.numpy() for state in E.states])
        return np.asarray(states[same.argmax(axis=1), np.arange(len(taken))])

    def smooth(self, E: Illuminances, sharpness: float) -> mi.TensorXf:
        """Twin of `applied`, with gradients."""
        shares = self._shares(E, sharpness)
        total = dr.zeros(mi.TensorXf, E.open.shape)
        for row, state in zip(self.indices.tolist(), E.states, strict=True):
            weight = shares[0][row[0]]
            for of_group, index in zip(shares[1:], row[1:], strict=True):
                weight = weight * of_group[index]
            total += state * dr.reshape(mi.TensorXf, weight, (len(self.time), 1))
        return total

    def _group_of_sun(self, E: Illuminances) -> np.ndarray:
        """Group by which most of a sun comes to a sensor, −1 for none, int, (time, sensor)."""
        if len(self.rule.groups) == 1:
            by = np.zeros(E.direct.shape, int)
        else:
            each = [sun.numpy() for sun in E.by_group]
            by = np.argmax([*each, E.direct.numpy() - np.sum(each, axis=0)], axis=0)
            by = np.where(by == len(each), -1, by)
        for group in np.flatnonzero(self.outside.any(axis=1)):
            by[(by == group) & self.outside[group]] = -1
        return by

    def _shares(self, E: Illuminances, sharpness: float) -> list[dict[int, mi.TensorXf]]:
        """Share (time,) of every state of each group."""
        rule, scheduled = self.rule, self._scheduled
        closed = self._closed(E, sharpness)
        shares: list[dict[int, mi.TensorXf]] = []
        for g, last in enumerate(rule.groups.last):
            if rule.by_rule[g]:
                shares.append({0: 1 - closed[g], last: closed[g]})
                continue
            taken = (scheduled[:, g] == np.arange(last + 1)[:, None]).astype(np.float32)
            shares.append(dict(enumerate(map(mi.TensorXf, taken))))
        return shares

    def _closed(self, E: Illuminances, sharpness: float) -> dict[int, mi.TensorXf]:
        """Share (time,) by which each group is closed by the rule.

        The order in which groups close, and the group that a sensor's sun comes by, are those of
        the hard rule: they change in steps, and have no gradient.
        """
        rule = self.rule
        reached = smooth_step.passed(E.direct, rule.threshold, sharpness)
        by, mine = self._group_of_sun(E), np.flatnonzero(rule.by_rule)
        opened: dict[int, mi.TensorXf] = {}
        for grid, required in enumerate(self._required.tolist()):
            here = self.grid == grid
            counts = [
                smooth_step.total(reached * mi.TensorXf((here & (by == g)).astype(np.float32)), 1)
                for g in mine
            ]
            order = np.argsort(-np.stack([c.numpy() for c in counts]), axis=0, kind="stable")
            place = np.argsort(order, axis=0)
            for k, g in enumerate(mine.tolist()):
                left = dr.zeros(mi.TensorXf, counts[k].shape)
                for other, count in zip(place, counts, strict=True):
                    left += count * mi.TensorXf((other >= place[k]).astype(np.float32))
                step = (
                    1 - smooth_step.step(left, required - 0.5, sharpness) if required else 0 * left
                )
                opened[g] = opened[g] * step if g in opened else step
        return {g: 1 - share for g, share in opened.items()}


def applied(
    E: Illuminances, direct: xr.DataArray, rules: Rules, groups: FacadeGroups | None
) -> np.ndarray:
    """E (time, sensor) [lx] in the groups' states, or as one shade's rule has it.

    `direct` is `E.direct` with the sensors' coordinates, which tell their grids.
    """
    if groups is not None:
        return groups.applied(E)
    closed = metrics.shade_closed(direct, rules.shade_threshold, rules.shade_area)
    return np.where(closed.values[:, None], E.shaded.numpy(), E.open.numpy())


def smooth_applied(
    E: Illuminances, rules: Rules, groups: FacadeGroups | None, sharpness: float
) -> mi.TensorXf:
    """E (time, sensor) [lx] by the smooth twins of the groups' states, or of one shade's rule."""
    if groups is not None:
        return groups.smooth(E, sharpness)
    threshold, area = rules.shade_threshold, rules.shade_area
    closed = smooth.shade_closed(E.direct, threshold, area, sharpness=sharpness)
    return smooth.applied(E.open, E.shaded, closed)
