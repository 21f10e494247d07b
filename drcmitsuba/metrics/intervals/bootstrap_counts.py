"""Counting the sensors that pass, by grid, in every draw; most are the same in all draws."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drcmitsuba.metrics.intervals.rules import DRAWS, TAIL
from drcmitsuba.metrics.thresholds import MOST, stamps_passed
from drcmitsuba.runtime.pieces import run

HELD = 1 << 20
"""Number of entries in doubt that are in memory at once."""
TOGETHER = 1 << 14
"""Number of entries that are drawn at once, unless a single sensor has more: at most 10 MB."""


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
            out[:, m] = stamps_passed(passed[run(np.flatnonzero(self.month == m))])
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
    doubtful: Callable[[], np.ndarray]
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
        self._hours = np.zeros(len(needed.month), np.int64)
        self._doubtful: list[Callable[[], np.ndarray]] = []
        self.open_months = (sure < needed.monthly) & (sure + doubtful >= needed.monthly)
        self.open_year = (of_year < needed.yearly) & (
            of_year + doubtful.sum(axis=1) >= needed.yearly
        )

    @property
    def hours(self) -> np.ndarray:
        """Number of the undecided sensors at which an hour is in doubt, int, shape (time,).

        Adaptive sampling alone asks for it: it is counted then.
        """
        while self._doubtful:
            np.add.at(self._hours, self._doubtful.pop()(), 1)
        return self._hours

    def chosen(self, time: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        """Those of entries in doubt that have to be drawn, indices, sorted as `wanted` sorts them.

        Entries are time stamps and sensors, indices of shape (entry,) each.
        """
        month = self.needed.month[time]
        asked = np.flatnonzero(self.open_months[sensor, month] | self.open_year[sensor])
        return asked[np.lexsort((time[asked], month[asked], sensor[asked]))]

    def wanted(self, doubtful: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the entries of doubtful ones (time, sensor) that have to be drawn.

        They are time stamps and sensors, indices of shape (entry,) each, by sensor, then by month;
        at most `HELD` at a time, unless a single sensor has more.
        """
        order = np.argsort(self.needed.month, kind="stable")
        rows, month = run(order), self.needed.month[order]
        open_months = (self.open_months | self.open_year[:, None]).T
        before = np.cumsum(stamps_passed(doubtful)) // HELD
        for part in np.unique(before):
            first, last = np.searchsorted(before, (part, part + 1))
            asked = doubtful[rows, first:last] & open_months[month, first:last]
            place, sensor = np.divmod(np.flatnonzero(asked), last - first)
            # Entries are few: they are sorted sooner than the array is turned.
            by_sensor = np.argsort(sensor.astype(np.min_scalar_type(last - first)), kind="stable")
            if len(sensor):
                yield order[place[by_sensor]], sensor[by_sensor] + first

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
        """Count the draws (entry, draw) of some sensors' wanted entries, as `wanted` sorts them."""
        first = self.first(sensor, time)

        q = draws_passed(passed) / passed.shape[1]
        return self.summed(sensor, time, first, sums(passed, first), lambda some: q[some])

    def first(self, sensor: np.ndarray, time: np.ndarray) -> np.ndarray:
        """First entry of every row, a month of a sensor, among wanted entries, int, (row,)."""
        month = self.needed.month[time]
        changes = np.flatnonzero((month[1:] != month[:-1]) | (sensor[1:] != sensor[:-1])) + 1
        return np.append(0, changes)

    def levels(
        self, sensor: np.ndarray, time: np.ndarray, passes: np.ndarray, level: np.ndarray, most: int
    ) -> np.ndarray:
        """Levels of wanted entries from which on neither a month nor a year depends on them.

        Parameters
        ----------
        sensor, time : np.ndarray of int, shape (entry,)
            From `wanted`.
        passes : np.ndarray of bool, shape (entry,)
            Whether entries pass by their means.
        level : np.ndarray of int, shape (entry,)
            Level from which on each entry is as by its mean.
        most : int
            Largest level.
        """
        first = self.first(sensor, time)
        row = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(sensor))))
        size, at = (len(first), most + 1), row * (most + 1) + level
        every, above = (
            np.bincount(at, some, size[0] * size[1]).reshape(size) for some in (None, passes)
        )
        of_row, month = sensor[first], self.needed.month[time[first]]
        sensors, of_sensor = np.unique(of_row, return_inverse=True)

        def settled(
            above: np.ndarray, below: np.ndarray, lacking: np.ndarray, is_open: np.ndarray
        ) -> np.ndarray:
            surplus = (above.sum(axis=1) - lacking)[:, None]
            above, below = (side.cumsum(axis=1)[:, :-1] for side in (above, below))
            certain = np.where(surplus >= 0, above <= surplus, below < -surplus)
            return np.where(is_open, np.count_nonzero(certain, axis=1), most)

        by_month = settled(
            above, every - above, self.needed.monthly[month] - self.sure[of_row, month],
            self.open_months[of_row, month],
        )  # fmt: skip
        year, begin = self.needed.yearly, np.searchsorted(of_sensor, np.arange(len(sensors)))
        above, every = (np.add.reduceat(side, begin, axis=0) for side in (above, every))
        by_year = settled(
            above, every - above, year - self.sure[sensors].sum(axis=1), self.open_year[sensors]
        )
        return np.maximum(level, np.minimum(by_month, by_year[of_sensor])[row])

    def summed(
        self, sensor: np.ndarray, time: np.ndarray, first: np.ndarray, counts: np.ndarray,
        share: Callable[[np.ndarray], np.ndarray],
    ) -> CountedBlock:  # fmt: skip
        """Count some sensors' wanted entries from those that pass in every row, (row, draw).

        `share` gives the share of the draws in which some entries pass (entry,), where it is asked
        for. Open months and years, which began as not passed, have all of their entries there. This
        changes nothing, so that threads may count blocks side by side.
        """
        month = self.needed.month[time]
        sensor_first = np.flatnonzero(np.diff(sensor[first], prepend=-1))
        those = sensor[first][sensor_first]
        ends, chosen = np.append(sensor_first[1:], len(first)), self.open_year[those]
        those, rows = those[chosen], zip(sensor_first[chosen], ends[chosen], strict=True)
        of_year = np.zeros((len(those), counts.shape[1]), np.int32)
        for out, (begin, end) in zip(of_year, rows, strict=True):
            np.add.reduce(counts[begin:end], axis=0, out=out)
        passes = of_year >= self.needed.yearly - self.sure[those].sum(axis=1)[:, None]
        passing = draws_passed(passes) / counts.shape[1]
        undecided = those[(passing > TAIL) & (passing < 1 - TAIL)]

        def doubtful() -> np.ndarray:
            some = np.flatnonzero(np.isin(sensor, undecided))
            q = share(some)
            return np.asarray(time[some][(q > TAIL) & (q < 1 - TAIL)])

        return CountedBlock(sensor[first], month[first], counts, those, passes, passing, doubtful)

    def add(self, counted: CountedBlock) -> None:
        """Add the counts of some sensors."""
        self._count_months(counted.sensor, counted.month, counted.counts)
        grid = self.needed.grid[counted.open_year]
        for g in np.unique(grid):
            self.counts[g, 12] += counted.passes[grid == g].sum(axis=0, dtype=np.int32)
        self.passing[counted.open_year] = counted.passing
        self._doubtful.append(counted.doubtful)

    def _count_months(self, sensor: np.ndarray, month: np.ndarray, counts: np.ndarray) -> None:
        """Count the open ones among months of sensors (row,), from what they pass (row, draw)."""
        place = self.needed.grid[sensor] * 12 + month
        rows = np.flatnonzero(self.open_months[sensor, month])
        rows = rows[np.argsort(place[rows], kind="stable")]
        if len(rows) == 0:
            return
        lacking = self.needed.monthly[month] - self.sure[sensor, month]
        passes = counts[rows] >= lacking[rows].astype(np.int32)[:, None]
        at, first = np.unique(place[rows], return_index=True)
        self.counts[at // 12, at % 12] += sums(passes, first)

    def plus(self, other: BootstrapCounts) -> BootstrapCounts:
        """Count the sensors of two blocks, this one's first; grids have the same numbers."""
        out = copy(self)
        grids = max(len(self.sizes), len(other.sizes))
        counts = np.zeros((grids, *self.counts.shape[1:]), self.counts.dtype)
        out.sizes = np.zeros(grids, self.sizes.dtype)
        for part in (self, other):
            counts[: len(part.sizes)] += part.counts
            out.sizes[: len(part.sizes)] += part.sizes
        out.counts, out._hours, out._doubtful = counts, self.hours + other.hours, []
        out.passing = np.concatenate([self.passing, other.passing])
        return out

    def shares(self, grid: int | slice = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """Shares of all or a grid's sensors [%]: of the year (draw,), by month (month, draw)."""
        counts = self.counts[grid].reshape(-1, 13, DRAWS).sum(axis=0)
        shares = 100.0 * counts / self.sizes[grid].sum()
        shares[:12][self.needed.empty] = np.nan
        return shares[12], shares[:12]


def draws_passed(passed: np.ndarray) -> np.ndarray:
    """Number of draws in which entries pass, int, shape (entry,), of bool (entry, draw).

    As for `sums`; there are less than 2048 draws.
    """
    by_byte = np.add.reduce(passed.view(np.uint64), axis=1).view(np.uint8)
    return np.asarray(by_byte.reshape(-1, 8).sum(axis=1, dtype=np.int64))


def sums(passed: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Number of passed entries (entry, draw) in pieces from the `first` of each, (piece, draw).

    The number of draws is a multiple of eight, whose bytes are added as one number. Counts are
    bytes where these are large enough.
    """
    sizes = np.append(first[1:], len(passed)) - first
    if sizes.max(initial=0) <= MOST:
        return np.add.reduceat(passed.view(np.uint64), first, axis=0).view(np.uint8)
    pieces = -(-sizes // MOST)  # of which a byte counts each
    begins = np.append(0, pieces.cumsum()[:-1])
    starts = np.repeat(first, pieces) + MOST * (np.arange(pieces.sum()) - np.repeat(begins, pieces))
    counts = np.add.reduceat(passed.view(np.uint64), starts, axis=0).view(np.uint8)
    return np.asarray(np.add.reduceat(counts, begins, axis=0, dtype=np.int32))
