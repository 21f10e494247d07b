"""Counting the sensors that pass, by grid, in every draw; most are the same in all draws."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drcmitsuba.metrics.intervals.rules import DRAWS, TAIL

MOST = 255
"""Largest count of a byte: sums of bytes are several times as fast as sums of larger numbers."""


@dataclass(frozen=True)
class Needed:
    """Number of time stamps that a sensor has to pass by month, from 0, and in the period."""

    month: np.ndarray
    monthly: np.ndarray
    yearly: int
    grid: np.ndarray
    """Index of the grid that each sensor counts for, shape (sensor,)."""

    @classmethod
    def of_period(cls, stamps: int, required: int, grid: np.ndarray) -> Needed:
        """Need `required` of so many time stamps, without months."""
        return cls(np.zeros(stamps, np.int64), np.full(12, stamps + 1), required, grid)

    @property
    def empty(self) -> np.ndarray:
        """Months without time stamps, shape (month,)."""
        return np.bincount(self.month, minlength=12) == 0

    def count(self, passed: np.ndarray) -> np.ndarray:
        """Count by month: (time, sensor) to (sensor, month)."""
        out = np.zeros((passed.shape[1], 12), np.int64)
        for m in np.flatnonzero(~self.empty):
            out[:, m] = np.count_nonzero(passed[self.month == m], axis=0)
        return out


class BootstrapCounts:
    """Counts, for every draw and grid, the sensors that pass; most are the same in all draws."""

    def __init__(self, needed: Needed, sure: np.ndarray, doubtful: np.ndarray) -> None:
        """Begin with the certain entries and the number of doubtful ones, (sensor, month)."""
        self.needed, self.sure = needed, sure
        of_year = sure.sum(axis=1)
        self.sizes = np.bincount(needed.grid)
        counts = np.zeros((len(self.sizes), 13), np.int32)  # the last column is the period's
        passes = np.column_stack([sure >= needed.monthly, of_year >= needed.yearly])
        np.add.at(counts, needed.grid, passes)
        self.counts = np.repeat(counts[..., None], DRAWS, axis=2)
        self.passing = (of_year >= needed.yearly).astype(float)
        self.hours = np.zeros(len(needed.month), np.int64)
        self.open_months = (sure < needed.monthly) & (sure + doubtful >= needed.monthly)
        self.open_year = (of_year < needed.yearly) & (
            of_year + doubtful.sum(axis=1) >= needed.yearly
        )

    @property
    def sensors(self) -> np.ndarray:
        """Sensors that do not pass or fail for certain."""
        return np.flatnonzero(self.open_year | self.open_months.any(axis=1))

    def wants(self, sensor: int, time: np.ndarray) -> np.ndarray:
        """Whether doubtful time stamps of a sensor have to be drawn."""
        if self.open_year[sensor]:
            return np.ones(len(time), bool)
        return self.open_months[sensor, self.needed.month[time]]

    def add(self, sensor: int, time: np.ndarray, passed: np.ndarray) -> None:
        """Add the draws of a sensor's wanted time stamps, (entry, draw)."""
        counts = np.repeat(self.sure[sensor][:, None], DRAWS, axis=1)
        month = self.needed.month[time]
        if (month[1:] < month[:-1]).any():
            order = np.argsort(month, kind="stable")
            month, passed, time = month[order], passed[order], time[order]
        changes = np.flatnonzero(month[1:] != month[:-1]) + 1
        for begin, end in pairwise([0, *changes.tolist(), len(month)]):
            for first in range(begin, end, MOST):
                piece = passed[first : min(first + MOST, end)].view(np.uint8)
                counts[month[begin]] += np.add.reduce(piece, axis=0, dtype=np.uint8)
        # An open month or year began as not passed.
        of_month = self.open_months[sensor]
        of_grid = self.counts[self.needed.grid[sensor]]
        of_grid[:12][of_month] += counts[of_month] >= self.needed.monthly[of_month][:, None]
        if self.open_year[sensor]:
            passes = counts.sum(axis=0) >= self.needed.yearly
            of_grid[12] += passes
            p = self.passing[sensor] = passes.mean()
            if TAIL < p < 1 - TAIL:
                q = passed.mean(axis=1)
                self.hours[time] += (q > TAIL) & (q < 1 - TAIL)

    def plus(self, other: BootstrapCounts) -> BootstrapCounts:
        """Count the sensors of two blocks, this one's first; grids have the same numbers."""
        out = copy(self)
        grids = max(len(self.sizes), len(other.sizes))
        counts = np.zeros((grids, *self.counts.shape[1:]), self.counts.dtype)
        out.sizes = np.zeros(grids, self.sizes.dtype)
        for part in (self, other):
            counts[: len(part.sizes)] += part.counts
            out.sizes[: len(part.sizes)] += part.sizes
        out.counts, out.hours = counts, self.hours + other.hours
        out.passing = np.concatenate([self.passing, other.passing])
        return out

    def shares(self, grid: int | slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Shares of all or a grid's sensors [%]: of the year (draw,), by month (month, draw)."""
        counts = self.counts[grid].reshape(-1, 13, DRAWS).sum(axis=0)
        shares = 100.0 * counts / self.sizes[grid].sum()
        shares[:12][self.needed.empty] = np.nan
        return shares[12], shares[:12]
