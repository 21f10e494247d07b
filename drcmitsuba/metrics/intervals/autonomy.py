"""Draws of sDA and msDA: multiplier bootstrap of the replicates of E.

    E* = Ē + q Σ_r w_r (E_r − Ē) / √(n (n − 1)),   w_r normal, q² = (n − 1) / χ²_{n−1},

with the same w and q for all sensors and hours [1]_: what shares gather paths and cells moves
together, and every single entry has Student's t with n − 1 degrees of freedom around its mean.

References
----------
.. [1] A. W. van der Vaart, J. A. Wellner, "Weak convergence and empirical processes", 1996, 2.9.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from threading import Lock
from typing import NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.intervals.bootstrap_counts import (
    BootstrapCounts,
    Needed,
    draws_passed,
    sums,
)
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.reach import FEWER, Reach
from drcmitsuba.metrics.intervals.rules import BEYOND, DRAWS, t_factor
from drcmitsuba.runtime.pieces import pieces, run
from drcmitsuba.runtime.threads import in_threads, one_blas_thread

GROUPS = 64
"""Number of groups of sensors; errors outside the replicates are independent between groups."""
ENTRIES = 256
"""Number of entries drawn at once: few enough for the cache and for a single thread."""
FARTHEST = slice(0, FEWER[-1])
"""Draws that are made of all entries: to choose among these takes as long."""
NEARER = tuple(slice(fewer, draws) for draws, fewer in pairwise(FEWER))
"""Draws that are made of entries of the same level and of those before."""


class Multipliers(NamedTuple):
    """Random numbers of the draws."""

    weights: np.ndarray
    """Weights of the replicates, q·w / √(n (n − 1)), then 1, that of their mean, shape (replicate +
    1, draw)."""
    others: np.ndarray
    """Normal random numbers for errors that no replicate holds, shape (group, draw); a sensor takes
    its group's."""

    @property
    def replicates(self) -> np.ndarray:
        """Weights of the replicates alone, shape (replicate, draw)."""
        return self.weights[:-1]


def multipliers(replicates: int, seed: int) -> Multipliers:
    """Draw the random numbers."""
    rng = np.random.default_rng([seed, 2])
    n = replicates
    w = rng.standard_normal((n, DRAWS))
    q = np.sqrt((n - 1) / rng.chisquare(n - 1, DRAWS))
    others = rng.standard_normal((GROUPS, DRAWS)).astype(np.float32)
    weights = np.concatenate([q * w / math.sqrt(n * (n - 1)), np.ones((1, DRAWS))])
    return Multipliers(weights.astype(np.float32), others)


@dataclass(frozen=True)
class State:
    """Illuminance of one state of the façade at the hours that need it."""

    coefficients: xr.Dataset
    sky: xr.Dataset
    """Luminances of the rows: the time stamps that need the state."""
    row: np.ndarray
    """Row of every time stamp, −1 where the state is not needed, shape (time,)."""
    mean: np.ndarray
    error: np.ndarray
    """Illuminance and its standard error [lx], shape (row, sensor)."""

    @classmethod
    def of(
        cls, coefficients: xr.Dataset, sky: xr.Dataset, wanted: np.ndarray,
        known: tuple[np.ndarray, np.ndarray], is_known: np.ndarray,
    ) -> State:  # fmt: skip
        """Take mean and error (time, sensor) where they are known, and accumulate the rest."""
        mean, error = (a if wanted.all() else a[wanted] for a in known)
        row = np.where(wanted, np.cumsum(wanted) - 1, -1)
        rest = np.flatnonzero(wanted & ~is_known)
        if len(rest):
            E = accumulate.by_source(coefficients, sky.isel(time=rest))
            mean, error = mean.copy(), error.copy()  # E itself stays as it is
            mean[row[rest]], error[row[rest]] = E["total"].values, E["total_se"].values
        return cls(coefficients, sky.isel(time=np.flatnonzero(wanted)), row, mean, error)

    @property
    def has_own_error(self) -> bool:
        """Whether there are errors that no replicate holds."""
        return "sun_straight" in self.coefficients

    def classes(self, threshold: float, beyond: float) -> tuple[np.ndarray, np.ndarray]:
        """Whether entries pass for certain, and whether they may pass, (row, sensor) each."""
        sure, may = np.empty(self.mean.shape, bool), np.empty(self.mean.shape, bool)

        def some(here: slice) -> None:
            mean, reach = self.mean[here], beyond * self.error[here]
            np.greater_equal(mean - reach, threshold, out=sure[here])
            np.greater_equal(mean + reach, threshold, out=may[here])

        in_threads(some, pieces(*self.mean.shape))
        return sure, may

    def doubts(
        self, time: np.ndarray, sensor: np.ndarray, threshold: float, drawn: Multipliers
    ) -> Doubts:
        """Entries whose draws are asked for, by their time stamps and sensors (entry,)."""
        row = self.row[time]
        E = accumulate.replicates_at(self.coefficients, self.sky, row, sensor)
        mean, own = E.mean(axis=0), None
        off = np.empty((len(row), len(E) + 1), np.float32)
        np.subtract(E.T, mean[:, None], out=off[:, :-1])
        np.subtract(mean, threshold, out=off[:, -1])
        if self.has_own_error:
            own = self.error[row, sensor] ** 2 - E.var(axis=0, ddof=1) / len(E)
            own = np.sqrt(np.maximum(own, 0))
        return Doubts(off, own, sensor % GROUPS, drawn)


@dataclass(frozen=True)
class Doubts:
    """Entries of illuminance that may lie on both sides of a threshold."""

    off: np.ndarray
    """Differences of the replicates from their mean, and of the mean from the threshold [lx], shape
    (entry, replicate + 1)."""
    own: np.ndarray | None
    """Standard error that no replicate holds [lx]: that of interpolation in an adaptive sun's mesh,
    and the noise of its straight light. It moves all hours of a sensor together, which overstates
    its effect."""
    group: np.ndarray
    """Group of the entries' sensors."""
    drawn: Multipliers

    @classmethod
    def joined(cls, parts: Sequence[tuple[np.ndarray, Doubts]]) -> Doubts:
        """Entries of several states, with their places in the whole (entry,), int."""
        if len(parts) == 1:
            return parts[0][1]
        count, first = sum(len(places) for places, _ in parts), parts[0][1]
        off, group = np.empty((count, first.off.shape[1]), np.float32), np.empty(count, int)
        own = None if first.own is None else np.empty(count, first.own.dtype)
        for places, part in parts:
            off[places], group[places] = part.off, part.group
            if own is not None:
                own[places] = part.own
        return cls(off, own, group, first.drawn)

    @property
    def error(self) -> np.ndarray:
        """Standard error [lx], shape (entry,)."""
        n = self.off.shape[1] - 1
        squares = np.einsum("er,er->e", self.off[:, :n], self.off[:, :n]) / (n * (n - 1))
        return np.sqrt(squares if self.own is None else squares + self.own**2)

    def some(self, chosen: np.ndarray | slice) -> Doubts:
        """Some of the entries."""
        if isinstance(chosen, np.ndarray):
            chosen = run(chosen)
        off = self.off[chosen] if isinstance(chosen, slice) else self.off.take(chosen, axis=0)
        if self.own is None:
            return Doubts(off, None, self.group, self.drawn)
        return Doubts(off, self.own[chosen], self.group[chosen], self.drawn)

    def passes(self, draws: slice = slice(0, DRAWS)) -> np.ndarray:
        """Whether E* ≥ threshold in some draws, bool, shape (entry, draw)."""
        width = len(range(DRAWS)[draws])
        passed, together = np.empty((len(self.off), width), bool), ENTRIES * DRAWS // width
        held = np.empty((min(together, len(self.off)), width), np.float32)
        for start in range(0, len(self.off), together):
            few = slice(start, start + together)
            E = self.some(few).above(draws, held[: len(self.off[few])])
            np.greater_equal(E, 0, out=passed[few])
        return passed

    def above(self, draws: slice = slice(0, DRAWS), out: np.ndarray | None = None) -> np.ndarray:
        """E* less the threshold in some draws [lx], shape (entry, draw)."""
        E = np.matmul(self.off, self.drawn.weights[:, draws], out=out)
        if self.own is not None:
            E += self.own[:, None] * self.drawn.others[self.group, draws]
        return np.asarray(E)


@dataclass(frozen=True)
class MovedEntries:
    """Entries that some draws move, row by row: months of sensors."""

    draws: slice
    entries: np.ndarray
    """The first of every row is among them, so that none is empty, int, shape (entry,)."""
    begins: np.ndarray
    """Place of each row's first one among them, and their number, int, shape (row + 1,)."""
    base: np.ndarray
    """Number of the others that pass, by their means, int, shape (row,)."""

    @classmethod
    def of(
        cls, by_mean: np.ndarray, first: np.ndarray, moved: np.ndarray, draws: slice
    ) -> MovedEntries:
        """Entries that are `moved` (entry,), of rows from their `first` on (row,)."""
        moved = moved.copy()
        moved[first] = True
        entries = np.flatnonzero(moved)
        begins = np.searchsorted(entries, first)
        base = np.add.reduceat(by_mean & ~moved, first, dtype=np.int32)
        return cls(draws, entries, np.append(begins, len(entries)), base)

    def at(self, rows: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Entries, the first ones and the base of some rows."""
        begins = self.begins[rows.start : rows.stop + 1]
        entries = self.entries[begins[0] : begins[-1]]
        return entries, begins[:-1] - begins[0], self.base[rows]


def draw_autonomy(
    states: Sequence[State], closures: Closures, threshold: float, needed: Needed,
    drawn: Multipliers,
) -> BootstrapCounts:  # fmt: skip
    """Draw sDA and msDA; an hour takes the state of the façade that was drawn for it."""
    beyond = t_factor(len(drawn.replicates), 1 - 2 * BEYOND)
    sure = np.ones((len(closures.state), states[0].mean.shape[1]), bool)
    may = np.zeros_like(sure)
    for state, here in zip(states, closures.possible, strict=True):
        hours, (passes, may_pass) = np.flatnonzero(here), state.classes(threshold, beyond)
        at, row = run(hours), run(state.row[hours])
        sure[at] &= passes[row]
        may[at] |= may_pass[row]
    doubtful = may & ~sure
    tally = BootstrapCounts(needed, needed.count(sure), needed.count(doubtful))
    reach = Reach.of(drawn.replicates, drawn.others if states[0].has_own_error else None)
    closures = replace(closures, drawn=closures.drawn[:, reach.order])
    drawn = Multipliers(*(numbers[:, reach.order] for numbers in drawn))
    # The matrices are small: threads of the library would wait for each other most of the time.
    with one_blas_thread():
        for time, sensor in tally.wanted(doubtful):
            _draw(tally, states, closures, reach, threshold, drawn, time, sensor)
    tally.counts[..., reach.order] = tally.counts.copy()
    return tally


def _draw(
    tally: BootstrapCounts, states: Sequence[State], closures: Closures, reach: Reach,
    threshold: float, drawn: Multipliers, time: np.ndarray, sensor: np.ndarray,
) -> None:  # fmt: skip
    """Draw some entries, and add them to the counts; draws are in the order of their reach."""

    def doubts(k: int, entries: np.ndarray) -> tuple[np.ndarray, Doubts]:
        return entries, states[k].doubts(time[entries], sensor[entries], threshold, drawn)

    state, which = closures.state[time], np.unique(closures.state)
    whole = Doubts.joined([doubts(k, np.flatnonzero(state == k)) for k in which.tolist()])
    hour = np.full(len(closures.state), -1)
    hour[closures.hours] = np.arange(len(closures.hours))
    hour = hour[time]
    in_state = [np.flatnonzero(possible[time] & (hour >= 0)) for possible in closures.possible]
    varying = [(k, *doubts(k, entries)) for k, entries in enumerate(in_state) if len(entries)]
    by_mean, near = whole.off[:, -1] >= 0, reach.levels(whole.off[:, -1], whole.error)
    near[hour >= 0] = 0
    level = tally.levels(sensor, time, by_mean, near, len(FEWER) - 1)
    lock = Lock()

    def passes(some: np.ndarray, draws: slice) -> np.ndarray:
        """Whether entries, in rising order, pass in some draws (entry, draw)."""
        passed = whole.some(some).passes(draws)
        if not varying:
            return passed
        passed[hour[some] >= 0] = False
        for k, entries, own in varying:
            places = np.minimum(np.searchsorted(some, entries), len(some) - 1)
            here = np.flatnonzero(some[places] == entries)
            in_draw = closures.drawn[hour[entries[here]], draws] == k
            passed[places[here]] |= own.some(here).passes(draws) & in_draw
        return passed

    first = tally.first(sensor, time)
    every = [*((level <= k, draws) for k, draws in enumerate(NEARER)), (level >= 0, FARTHEST)]
    layers = [MovedEntries.of(by_mean, first, moved, draws) for moved, draws in every]

    def of_block(block: slice) -> None:
        rows = slice(*np.searchsorted(first, (block.start, block.stop)))
        counts = np.empty((rows.stop - rows.start, DRAWS), np.int32)
        for layer in layers:
            entries, begins, base = layer.at(rows)
            more = sums(passes(entries, layer.draws), begins)
            np.add(more, base[:, None], out=counts[:, layer.draws])

        def share(some: np.ndarray) -> np.ndarray:
            own = some + block.start
            count = by_mean[own] * DRAWS
            for k, draws in enumerate(FEWER):
                here = np.flatnonzero(near[own] == k)
                if len(here):
                    passed = draws_passed(passes(own[here], slice(0, draws)))
                    count[here] = passed + by_mean[own[here]] * (DRAWS - draws)
            return np.asarray(count / DRAWS)

        counted = tally.summed(sensor[block], time[block], first[rows] - block.start, counts, share)
        with lock:
            tally.add(counted)

    in_threads(of_block, list(tally.blocks(sensor)))
