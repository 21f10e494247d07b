"""Counting the sensors that pass, by grid, in every draw; most are the same in all draws."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from drcmitsuba.metrics.intervals.rules import DRAWS, TAIL

MOST = 255
"""Largest count of a byte: sums of bytes are several times as fast as sums of larger numbers."""
HELD = 1 << 20
"""Number of entries in doubt that are in memory at once."""
TOGETHER = 1 << 12
"""Number of entries that are drawn at once, unless a single sensor has more: 2.5 MB."""


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


class CountedBlock(NamedTuple):
    """Counts of a block of sensors in every draw."""

    sensor: np.ndarray
    month: np.ndarray
    """Sensor and month of every row of `counts`, shape (row,)."""
    counts: np.ndarray
    """Entries in doubt that pass, int, shape (row, draw)."""
    open_year: np.ndarray
    """Sensors whose year is open, shape (sensor,)."""
    passes: np.ndarray
    """Whether their years pass, bool, shape (sensor, draw)."""
    passing: np.ndarray
    """Share of the draws in which they do, shape (sensor,)."""
    doubtful: np.ndarray
    """Time stamps in doubt of those that may pass or fail, each as often as it is, shape (any,)."""


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

    def wanted(self, doubtful: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the entries of doubtful ones (time, sensor) that have to be drawn.

        They are time stamps and sensors, indices of shape (entry,) each, by sensor, then by month;
        at most `HELD` at a time, unless a single sensor has more.
        """
        order = np.argsort(self.needed.month, kind="stable")
        open_months = self.open_months | self.open_year[:, None]
        before = np.cumsum(np.count_nonzero(doubtful, axis=0)) // HELD
        for part in np.unique(before):
            first, last = np.searchsorted(before, (part, part + 1))
            asked = np.ascontiguousarray(doubtful[order, first:last].T)
            asked &= open_months[first:last, self.needed.month[order]]
            sensor, place = np.divmod(np.flatnonzero(asked), len(order))
            yield order[place], sensor + first

    def blocks(self, sensor: np.ndarray) -> Iterator[slice]:
        """Cut entries that are sorted by their `sensor` into blocks of whole sensors."""
        start = 0
        while start < len(sensor):
            last = sensor[min(start + TOGETHER, len(sensor)) - 1]
            before, behind = np.searchsorted(sensor, (last, last + 1))
            whole = behind == min(start + TOGETHER, len(sensor)) or before == start
            stop = int(behind if whole else before)
            yield slice(start, stop)
            start = stop

    def counted(self, sensor: np.ndarray, time: np.ndarray, passed: np.ndarray) -> CountedBlock:
        """Count the draws (entry, draw) of some sensors' wanted entries, as `wanted` sorts them.

        Open months and years, which began as not passed, have all of their entries there. This
        changes nothing, so that threads may count blocks side by side.
        """
        month = self.needed.month[time]
        changes = np.flatnonzero((month[1:] != month[:-1]) | (sensor[1:] != sensor[:-1])) + 1
        first = np.append(0, changes)
        counts = _sums(passed, first)
        sensor_first = np.flatnonzero(np.diff(sensor[first], prepend=-1))
        those = sensor[first][sensor_first]
        of_year = np.add.reduceat(counts, sensor_first, axis=0)
        of_year += self.sure[those].sum(axis=1, dtype=np.int32)[:, None]
        chosen = self.open_year[those]
        passes, those = of_year[chosen] >= self.needed.yearly, those[chosen]
        passing, doubtful = passes.mean(axis=1), [np.zeros(0, np.int64)]
        for s in those[(passing > TAIL) & (passing < 1 - TAIL)]:
            mine = slice(*np.searchsorted(sensor, (s, s + 1)))
            q = passed[mine].mean(axis=1)
            doubtful.append(time[mine][(q > TAIL) & (q < 1 - TAIL)])
        return CountedBlock(
            sensor[first], month[first], counts, those, passes, passing, np.concatenate(doubtful)
        )

    def add(self, counted: CountedBlock) -> None:
        """Add the counts of some sensors."""
        self._count_months(counted.sensor, counted.month, counted.counts)
        grid = self.needed.grid[counted.open_year]
        for g in np.unique(grid):
            self.counts[g, 12] += counted.passes[grid == g].sum(axis=0, dtype=np.int32)
        self.passing[counted.open_year] = counted.passing
        np.add.at(self.hours, counted.doubtful, 1)

    def _count_months(self, sensor: np.ndarray, month: np.ndarray, counts: np.ndarray) -> None:
        """Count the open ones among months of sensors (row,), from what they pass (row, draw)."""
        lacking = self.needed.monthly[month] - self.sure[sensor, month]
        passes = counts >= lacking.astype(np.int32)[:, None]
        is_open, grid = self.open_months[sensor, month], self.needed.grid[sensor]
        for row in np.flatnonzero(is_open):
            self.counts[grid[row], month[row]] += passes[row]

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


def _sums(passed: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Number of passed entries (entry, draw) in pieces from the `first` of each, (piece, draw)."""
    counts = np.zeros((len(first), passed.shape[1]), np.int32)
    for out, (begin, end) in zip(counts, pairwise([*first.tolist(), len(passed)]), strict=True):
        for start in range(begin, end, MOST):
            piece = passed[start : min(start + MOST, end)].view(np.uint8)
            out += np.add.reduce(piece, axis=0, dtype=np.uint8)
    return counts
