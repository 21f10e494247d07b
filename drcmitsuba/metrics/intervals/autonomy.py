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
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.rules import BEYOND, DRAWS, t_factor
from drcmitsuba.runtime.threads import one_blas_thread

BLOCK = 256
"""Number of sensors whose replicates are in memory at once."""
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

    def replicates(self, sensors: np.ndarray) -> np.ndarray:
        """Replicates of the rows at some sensors, (replicate, row, sensor)."""
        return accumulate.replicates(self.coefficients, self.sky, sensors)

    def passes(
        self, replicates: np.ndarray, sensor: int, time: np.ndarray, drawn: Multipliers,
        threshold: float,
    ) -> np.ndarray:  # fmt: skip
        """Whether E* ≥ threshold, (entry, draw), from one sensor's replicates (replicate, row).

        No replicate holds the interpolation error of an adaptive sun's mesh, nor the noise of its
        straight light. This part of the error moves all hours of a sensor together, which
        overstates its effect.
        """
        E = replicates[:, self.row[time]]
        mean = E.mean(axis=0)
        off, missing, weights = (E - mean).T, (threshold - mean)[:, None], drawn.replicates
        if "sun_straight" in self.coefficients:
            own = self.error[self.row[time], sensor] ** 2 - E.var(axis=0, ddof=1) / len(E)
            off = np.column_stack([off, np.sqrt(np.maximum(own, 0))])
            weights = np.vstack([weights, drawn.others[sensor % GROUPS]])
        passed = np.empty((len(time), DRAWS), bool)
        for start in range(0, len(time), ENTRIES):
            here = slice(start, start + ENTRIES)
            passed[here] = off[here] @ weights >= missing[here]
        return passed


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
    hour = np.full(len(sure), -1)
    hour[closures.hours] = np.arange(len(closures.hours))
    # The matrices are small: threads of the library would wait for each other most of the time.
    with one_blas_thread():
        for start in range(0, len(tally.sensors), BLOCK):
            block = tally.sensors[start : start + BLOCK]
            E = [state.replicates(block) for state in states]
            for i, sensor in enumerate(block):
                time = np.flatnonzero(doubtful[:, sensor])
                time = time[tally.wants(sensor, time)]
                varies = hour[time] >= 0
                passed = np.zeros((len(time), DRAWS), bool)
                for k, state in enumerate(states):
                    own = E[k][:, :, i]
                    one = ~varies & (closures.state[time] == k)
                    passed[one] = state.passes(own, sensor, time[one], drawn, threshold)
                    some = varies & closures.possible[k, time]
                    if some.any():
                        by_state = state.passes(own, sensor, time[some], drawn, threshold)
                        passed[some] |= by_state & (closures.drawn[hour[time[some]]] == k)
                tally.add(sensor, time, passed)
    return tally
