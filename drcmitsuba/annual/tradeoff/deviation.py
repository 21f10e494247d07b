"""Errors of a setting against the reference, without the reference's own noise.

The squared difference to a mean of R independent rounds is too large by the variance of that mean.
With d_r = E − E_r, the mean over all pairs r ≠ q of ⟨d_r d_q⟩ is free of it: every pair's noises
are independent, so ⟨(E − true)²⟩ is estimated without bias, and may come out below zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.annual.tradeoff.evaluation import Evaluated
from drcmitsuba.annual.tradeoff.reference import Reference
from drcmitsuba.case.metrics import Metrics


@dataclass(frozen=True)
class Measured:
    """A number and its standard error."""

    value: float
    error: float = 0.0


def jackknife(value: Callable[[np.ndarray], float], rounds: int) -> Measured:
    """Value of all rounds, and its standard error from leaving out each.

    Parameters
    ----------
    value : callable
        Of the positions of the rounds that are used.
    rounds : int
        At least 3 for a value that takes pairs.
    """
    every = np.arange(rounds)
    left_out = np.array([value(np.delete(every, r)) for r in every])
    spread = (rounds - 1) / rounds * ((left_out - left_out.mean()) ** 2).sum()
    return Measured(value(every), float(np.sqrt(spread)))


def mean_square(products: np.ndarray, rounds: np.ndarray) -> float:
    """Mean over the pairs of different rounds of a matrix of products."""
    some = products[np.ix_(rounds, rounds)]
    n = len(rounds)
    return float((some.sum() - np.trace(some)) / (n * (n - 1)))


@dataclass(frozen=True)
class Errors:
    """Errors of a setting on the reference's hours; NaN for what cannot be compared.

    Parameters
    ----------
    square : Measured
        Mean square error of E over the squared mean E, without the reference's noise.
    mean : Measured
        Of the mean E [%].
    sda, ase : Measured
        [points].
    direct_sun : Measured
        Share of the sensor-hours on the wrong side of the threshold of ASE [%].
    shade : Measured
        Share of the hours with the shade in the wrong state [%].
    """

    square: Measured
    mean: Measured
    sda: Measured
    ase: Measured
    direct_sun: Measured
    shade: Measured

    @property
    def rms(self) -> float:
        """RMS error of E [%]; 0 where the noise of the reference hides it."""
        return 100 * float(np.sqrt(max(self.square.value, 0)))

    @property
    def rms_below(self) -> float:
        """What the RMS error of E is below with 95 % [%]."""
        return 100 * float(np.sqrt(max(self.square.value, 0) + 2 * self.square.error))

    @property
    def is_hidden(self) -> bool:
        """Whether the RMS error is lost in the noise of the reference."""
        return not self.square.value > self.square.error

    @property
    def rms_error(self) -> float:
        """Standard error of the RMS [%]."""
        return 0.0 if self.rms == 0 else 50e2 * self.square.error / self.rms


UNKNOWN = Measured(float("nan"), float("nan"))


@dataclass(frozen=True)
class Yardstick:
    """The reference, and the rule that settings are measured by.

    Parameters
    ----------
    reference : Reference
    thresholds : Metrics
    share : float
        Of the period's time stamps that the reference has; the hours of ASE shrink with it, as
        those of the months do in `metrics.mse`.
    step_hours : float
        Length of the intervals [h].
    """

    reference: Reference
    thresholds: Metrics
    share: float
    step_hours: float

    @property
    def count(self) -> int:
        """Rounds of the reference."""
        return len(self.reference.is_open)

    @cached_property
    def _rounds(self) -> np.ndarray:
        """E with the shade applied, shape (round, time, sensor) [lx]."""
        return self.reference.rounds(self.reference.closed)

    @cached_property
    def mean(self) -> Measured:
        """Mean E [lx]."""
        means = self._rounds.mean(axis=(1, 2), dtype=float)
        return Measured(float(means.mean()), float(means.std(ddof=1) / np.sqrt(self.count)))

    @cached_property
    def own_rms(self) -> float:
        """RMS of the reference's own error over its mean E [%]."""
        variance = self._rounds.var(axis=0, ddof=1, dtype=float).mean() / self.count
        return 100 * float(np.sqrt(variance)) / self.mean.value

    @cached_property
    def sda(self) -> Measured:
        """Daylight autonomy, sDA, of the reference on its hours and sensors [%]."""

        def value(rounds: np.ndarray) -> float:
            return self._sda(self._rounds[rounds].mean(axis=0))

        return jackknife(value, self.count)

    @cached_property
    def ase(self) -> float:
        """Sunlight exposure, ASE, of the reference on its hours, of all sensors [%]."""
        return self._ase(self.reference.direct_sun)

    def _sda(self, total: np.ndarray) -> float:
        t = self.thresholds
        E = xr.DataArray(total, dims=("time", "sensor"))
        return metrics.sda(E, t.sda_threshold, t.sda_fraction)

    def _ase(self, direct: np.ndarray) -> float:
        t = self.thresholds
        E = xr.DataArray(direct, dims=("time", "sensor"))
        return metrics.ase(E, t.ase_threshold, t.ase_hours * self.share, self.step_hours)

    def errors(self, found: Evaluated, *, same_sensors: bool) -> Errors:
        """Compare an evaluation with the reference, hour by hour.

        E is compared in the same state of the shade: open where either has it open. (Where they
        differ `shade` and sDA tell so; else a single hour with the other state would drown all.)

        Parameters
        ----------
        found : Evaluated
            Of the reference's time stamps, and of all sensors of its grid.
        same_sensors : bool
            Whether that is the grid of the reference; if not, only sDA, ASE and shade are known.
        """
        ref, mean = self.reference, self.mean
        shade = Measured(100 * float((found.closed != ref.closed).mean()))
        ase = Measured(self._ase(found.direct_sun) - self.ase)
        if not same_sensors:
            sda = Measured(self._sda(found.total) - self.sda.value, self.sda.error)
            return Errors(UNKNOWN, UNKNOWN, sda, ase, UNKNOWN, shade)
        at = ref.sensors
        both = (found.closed & ref.closed)[:, None]
        E = np.where(both, found.total[:, at], found.total_open[:, at])
        d = (E - ref.rounds(found.closed)).reshape(self.count, -1) / mean.value
        products = d @ d.T / d.shape[1]
        limit = self.thresholds.ase_threshold
        wrong = (found.direct_sun >= limit) != (ref.direct_sun >= limit)
        offsets = 100 * d.mean(axis=1, dtype=float)
        return Errors(
            square=jackknife(lambda rounds: mean_square(products, rounds), self.count),
            mean=Measured(float(offsets.mean()), float(offsets.std(ddof=1) / np.sqrt(self.count))),
            sda=Measured(self._sda(found.total[:, at]) - self.sda.value, self.sda.error),
            ase=ase,
            direct_sun=Measured(100 * float(wrong.mean())),
            shade=shade,
        )
