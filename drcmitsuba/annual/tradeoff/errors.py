"""Errors of a setting against the reference, without the reference's own noise.

The squared difference from a mean of R independent rounds is too large by the variance of the mean.
With d_r = E − E_r, the mean over all pairs r ≠ q of ⟨d_r d_q⟩ is free of this variance: the noises
of a pair are independent. It estimates ⟨(E − true)²⟩ without bias, and may be below zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.annual.tradeoff.reference import Reference
from drcmitsuba.case.metrics import Metrics


@dataclass(frozen=True)
class SettingResult:
    """Illuminance of a setting at some of its time stamps, and the cost of its evaluation.

    Parameters
    ----------
    total, total_open, direct_sun : np.ndarray, shape (time, sensor)
        Illuminance with the shade applied, with it open, and by direct sun [lx].
    state : np.ndarray of int, shape (time,)
        Number of the state of the façade; 0 is the open one.
    seconds : float
        Seconds of the whole period, without start-up and writing.
    memory : int
        Largest memory that the process held [bytes].
    """

    total: np.ndarray
    total_open: np.ndarray
    direct_sun: np.ndarray
    state: np.ndarray
    seconds: float
    memory: int


@dataclass(frozen=True)
class Estimate:
    """A number and its standard error."""

    value: float
    error: float = 0.0

    @classmethod
    def of(cls, samples: np.ndarray) -> Estimate:
        """Mean of independent samples (sample,)."""
        return cls(float(samples.mean()), float(samples.std(ddof=1) / np.sqrt(len(samples))))


def jackknife(value: Callable[[np.ndarray], float], rounds: int) -> Estimate:
    """Value of all rounds, and its standard error from leaving out one round at a time.

    `value` takes the indices of some rounds; if it needs pairs, there must be 3 rounds or more.
    """
    every = np.arange(rounds)
    left_out = np.array([value(np.delete(every, r)) for r in every])
    spread = (rounds - 1) / rounds * ((left_out - left_out.mean()) ** 2).sum()
    return Estimate(value(every), float(np.sqrt(spread)))


def mean_square(products: np.ndarray, rounds: np.ndarray) -> float:
    """Mean of `products` (round, round) over all pairs of different rounds."""
    some = products[np.ix_(rounds, rounds)]
    n = len(rounds)
    return float((some.sum() - np.trace(some)) / (n * (n - 1)))


@dataclass(frozen=True)
class Errors:
    """Errors of a setting on the reference's hours; NaN where no comparison is possible.

    Parameters
    ----------
    square : Estimate
        Mean square error of E over the squared mean E, without the reference's noise.
    mean, sda, ase : Estimate
        Errors of the mean E [%], of sDA and of ASE [points].
    direct_sun, shade : Estimate
        Shares of the sensor-hours on the wrong side of the threshold of ASE, and of the hours with
        the façade in the wrong state [%].
    """

    square: Estimate
    mean: Estimate
    sda: Estimate
    ase: Estimate
    direct_sun: Estimate
    shade: Estimate

    @property
    def rms(self) -> float:
        """RMS error of E [%]; 0 where the noise of the reference hides it."""
        return 100 * float(np.sqrt(max(self.square.value, 0)))

    @property
    def rms_below(self) -> float:
        """Upper bound of the RMS error of E at 95 % confidence [%]."""
        return 100 * float(np.sqrt(max(self.square.value, 0) + 2 * self.square.error))

    @property
    def is_hidden(self) -> bool:
        """Whether the noise of the reference hides the RMS error."""
        return not self.square.value > self.square.error

    @property
    def rms_error(self) -> float:
        """Standard error of the RMS [%]."""
        return 0.0 if self.rms == 0 else 50e2 * self.square.error / self.rms

    @property
    def shown(self) -> float:
        """RMS error [%], or its upper bound where the noise hides it."""
        return self.rms_below if self.is_hidden else self.rms


UNKNOWN = Estimate(float("nan"), float("nan"))


@dataclass(frozen=True)
class Yardstick:
    """Reference and thresholds by which settings are measured.

    Parameters
    ----------
    share : float
        Share of the period's time stamps that the reference has [–]; the hours of ASE shrink with
        it, as the hours of a month do in `metrics.mse`.
    step_hours : float
        Length of the intervals [h].
    """

    reference: Reference
    thresholds: Metrics
    share: float
    step_hours: float

    @property
    def count(self) -> int:
        """Number of rounds of the reference."""
        return len(self.reference.is_open)

    @cached_property
    def _rounds(self) -> np.ndarray:
        """E with the shade applied, shape (round, time, sensor) [lx]."""
        return self.reference.rounds(self.reference.state)

    @cached_property
    def mean(self) -> Estimate:
        """Mean E [lx]."""
        return Estimate.of(self._rounds.mean(axis=(1, 2), dtype=float))

    @cached_property
    def own_rms(self) -> float:
        """RMS of the reference's own error over its mean E [%]."""
        variance = self._rounds.var(axis=0, ddof=1, dtype=float).mean() / self.count
        return 100 * float(np.sqrt(variance)) / self.mean.value

    @cached_property
    def sda(self) -> Estimate:
        """Daylight autonomy, sDA, of the reference on its hours and sensors [%]."""
        return jackknife(lambda some: self._sda(self._rounds[some].mean(axis=0)), self.count)

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

    def errors(self, setting: SettingResult, *, same_sensors: bool) -> Errors:
        """Compare an evaluation at all sensors of its grid with the reference, hour by hour.

        E is compared in the same state of the façade: open where the two differ. Hours with
        different states count in `shade` and sDA; in E a single one would outweigh all else. If the
        sensors are not those of the reference's grid, only sDA, ASE and shade are compared.
        """
        ref, mean = self.reference, self.mean
        known = ref.state >= 0
        differ = (setting.state != ref.state)[known]
        shade = Estimate(100 * float(differ.mean()) if known.any() else 0.0)
        ase = Estimate(self._ase(setting.direct_sun) - self.ase)
        if not same_sensors:
            sda = Estimate(self._sda(setting.total) - self.sda.value, self.sda.error)
            return Errors(UNKNOWN, UNKNOWN, sda, ase, UNKNOWN, shade)
        at = ref.sensors
        both = ref.both(setting.state)[:, None]
        E = np.where(both, setting.total[:, at], setting.total_open[:, at])
        d = (E - ref.rounds(setting.state)).reshape(self.count, -1) / mean.value
        products = d @ d.T / d.shape[1]
        limit = self.thresholds.ase_threshold
        wrong = (setting.direct_sun >= limit) != (ref.direct_sun >= limit)
        return Errors(
            square=jackknife(lambda rounds: mean_square(products, rounds), self.count),
            mean=Estimate.of(100 * d.mean(axis=1, dtype=float)),
            sda=Estimate(self._sda(setting.total[:, at]) - self.sda.value, self.sda.error),
            ase=ase,
            direct_sun=Estimate(100 * float(wrong.mean())),
            shade=shade,
        )


NOT_RUN = "not run"


@dataclass(frozen=True)
class Row:
    """Row of the table: one setting with its status, errors, seconds and memory [bytes].

    Name and varied quantity are those of `settings.Setting`; the status is "done", "not run", or
    "failed: …".
    """

    name: str
    varied: str
    status: str = NOT_RUN
    errors: Errors | None = None
    seconds: float = math.nan
    memory: int = 0

    @property
    def is_on_plot(self) -> bool:
        """Whether E of the setting has an error."""
        return self.errors is not None and not math.isnan(self.errors.square.value)

    def as_dict(self) -> dict[str, Any]:
        """The row of the CSV file."""
        out: dict[str, Any] = {"setting": self.name, "varied": self.varied, "status": self.status}
        if self.errors is not None:
            e = self.errors
            out |= {
                "E_rms_percent": e.rms,
                "E_rms_se": e.rms_error,
                "E_rms_below": e.rms_below,
                "E_mean_percent": e.mean.value,
                "E_mean_se": e.mean.error,
                "sDA_points": e.sda.value,
                "ASE_points": e.ase.value,
                "direct_sun_wrong_percent": e.direct_sun.value,
                "shade_wrong_percent": e.shade.value,
                "seconds": round(self.seconds, 3),
                "memory_MiB": round(self.memory / 2**20),
            }
        return out

    def cells(self) -> tuple[str, ...]:
        """The row of the table on a terminal."""
        if self.errors is None:
            return self.name, self.status, *[""] * 6
        e = self.errors
        return (
            self.name,
            _number(e.square.value, f"{'< ' * e.is_hidden}{e.shown:.1f}"),
            _number(e.mean.value, _signed(e.mean.value)),
            _signed(e.sda.value),
            _signed(e.ase.value),
            _number(e.direct_sun.value, f"{e.direct_sun.value:.2f}"),
            f"{self.seconds:.1f}",
            f"{self.memory / 2**30:.1f}",
        )


def _signed(value: float) -> str:
    """Write a number with sign and one decimal; zero has no sign."""
    text = f"{value:+.1f}"
    return "0.0" if float(text) == 0 else text


def _number(value: float, text: str) -> str:
    return "–" if math.isnan(value) else text


HEADER = (
    "setting", "E RMS %", "E mean %", "sDA points", "ASE points", "direct sun %", "seconds", "GiB",
)  # fmt: skip
"""Columns of `Row.cells`."""
