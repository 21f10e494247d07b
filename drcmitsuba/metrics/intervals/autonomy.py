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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.rules import BEYOND, DRAWS, t_factor
from drcmitsuba.runtime.threads import in_threads, one_blas_thread

GROUPS = 64
"""Number of groups of sensors; errors outside the replicates are independent between groups."""
ENTRIES = 128
"""Number of entries drawn at once: few enough for the cache and for a single thread."""


class Multipliers(NamedTuple):
    """Random numbers of the draws."""

    replicates: np.ndarray
    """Weights q·w / √(n (n − 1)), shape (replicate, draw)."""
    others: np.ndarray
    """Normal random numbers for errors that no replicate holds, shape (group, draw); a sensor takes
    its group's."""


def multipliers(replicates: int, seed: int) -> Multipliers:
    """Draw the random numbers."""
    rng = np.random.default_rng([seed, 2])
    n = replicates
    w = rng.standard_normal((n, DRAWS))
    q = np.sqrt((n - 1) / rng.chisquare(n - 1, DRAWS))
    others = rng.standard_normal((GROUPS, DRAWS)).astype(np.float32)
    return Multipliers((q * w / math.sqrt(n * (n - 1))).astype(np.float32), others)


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

    def classes(self, threshold: float, beyond: float) -> tuple[np.ndarray, np.ndarray]:
        """Whether entries pass for certain, and whether they may pass, (time, sensor) each."""
        reach = beyond * self.error
        nothing = np.zeros((1, self.mean.shape[1]), bool)  # row −1
        sure = np.concatenate([self.mean - reach >= threshold, nothing])
        may = np.concatenate([self.mean + reach >= threshold, nothing])
        return sure[self.row], may[self.row]

    def doubts(
        self, time: np.ndarray, sensor: np.ndarray, threshold: float, drawn: Multipliers
    ) -> Doubts:
        """Entries whose draws are asked for, by their time stamps and sensors (entry,)."""
        row = self.row[time]
        E = accumulate.replicates_at(self.coefficients, self.sky, row, sensor)
        mean, own = E.mean(axis=0), None
        if "sun_straight" in self.coefficients:
            own = self.error[row, sensor] ** 2 - E.var(axis=0, ddof=1) / len(E)
            own = np.sqrt(np.maximum(own, 0))
        return Doubts((E - mean).T, threshold - mean, own, sensor % GROUPS, drawn)


@dataclass(frozen=True)
class Doubts:
    """Entries of illuminance that may lie on both sides of a threshold."""

    off: np.ndarray
    """Differences of the replicates from their mean [lx], shape (entry, replicate)."""
    missing: np.ndarray
    """Threshold less the mean [lx], shape (entry,)."""
    own: np.ndarray | None
    """Standard error that no replicate holds [lx]: that of interpolation in an adaptive sun's mesh,
    and the noise of its straight light. It moves all hours of a sensor together, which overstates
    its effect."""
    group: np.ndarray
    """Group of the entries' sensors."""
    drawn: Multipliers

    def passes(self, begin: int, end: int) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield some entries after others, and whether E* ≥ threshold in every draw of them."""
        for start in range(begin, end, ENTRIES):
            few = slice(start, min(start + ENTRIES, end))
            yield slice(start - begin, few.stop - begin), self.missing[few, None] <= self._off(few)

    def above(self) -> np.ndarray:
        """E* less the threshold in every draw, shape (entry, draw) [lx]."""
        return np.asarray(self._off(slice(None)) - self.missing[:, None])

    def _off(self, few: slice) -> np.ndarray:
        """E* less the mean in every draw of some entries [lx]."""
        E = self.off[few] @ self.drawn.replicates
        if self.own is not None:
            E += self.own[few, None] * self.drawn.others[self.group[few]]
        return E


def draw_autonomy(
    states: Sequence[State], closures: Closures, threshold: float, needed: Needed,
    drawn: Multipliers,
) -> BootstrapCounts:  # fmt: skip
    """Draw sDA and msDA; an hour takes the state of the façade that was drawn for it."""
    beyond = t_factor(len(drawn.replicates), 1 - 2 * BEYOND)
    sure = np.ones((len(closures.state), states[0].mean.shape[1]), bool)
    may = ~sure
    for state, here in zip(states, closures.possible, strict=True):
        of_state = state.classes(threshold, beyond)
        sure &= of_state[0] | ~here[:, None]
        may |= of_state[1] & here[:, None]
    doubtful = may & ~sure
    tally = BootstrapCounts(needed, needed.count(sure), needed.count(doubtful))
    # The matrices are small: threads of the library would wait for each other most of the time.
    with one_blas_thread():
        for time, sensor in tally.wanted(doubtful):
            _draw(tally, states, closures, threshold, drawn, time, sensor)
    return tally


def _draw(
    tally: BootstrapCounts, states: Sequence[State], closures: Closures, threshold: float,
    drawn: Multipliers, time: np.ndarray, sensor: np.ndarray,
) -> None:  # fmt: skip
    """Draw some entries, and add them to the counts."""
    hour = np.full(len(closures.state), -1)
    hour[closures.hours] = np.arange(len(closures.hours))
    hour = hour[time]
    in_state = closures.possible[:, time]
    every = [
        state.doubts(time[some], sensor[some], threshold, drawn)
        for state, some in zip(states, in_state, strict=True)
    ]
    first = np.cumsum(in_state, axis=1) - in_state  # number of a state's entries before each one
    lock = Lock()

    def of_block(block: slice) -> None:
        passed = np.zeros((block.stop - block.start, DRAWS), bool)
        for k, doubts in enumerate(every):
            some = np.flatnonzero(in_state[k, block])
            begin = first[k, block.start]
            for few, by_state in doubts.passes(begin, begin + len(some)):
                at = hour[block][some[few]]
                if (at >= 0).any():
                    by_state[at >= 0] &= closures.drawn[at[at >= 0]] == k
                passed[some[few]] |= by_state
        counted = tally.counted(sensor[block], time[block], passed)
        with lock:
            tally.add(counted)

    in_threads(of_block, list(tally.blocks(sensor)))
