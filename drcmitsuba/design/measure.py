"""What a year comes to: what is to be large and ASE, smooth and hard side by side.

Every problem of this folder is judged by these numbers, whatever it turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics import smooth
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.transport.facade_basis.year import Illuminances

Aim = Literal["sDA", "worst month"]
SOFTEST = 50.0
"""Points of msDA over the sharpness: how near months count as the worst together."""


@dataclass(frozen=True)
class Score:
    """One design in numbers.

    Parameters
    ----------
    value : float
        The objective [%].
    aim, ase : float
        What is to be large, and ASE [%].
    """

    value: float
    aim: float
    ase: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A design, smooth and hard.

    Parameters
    ----------
    x : np.ndarray, shape (free,)
        Free values, 0 to 1 between their bounds.
    sharpness : float
        Of the smooth numbers.
    smooth, hard : Score
    """

    x: np.ndarray
    sharpness: float
    smooth: Score
    hard: Score


@dataclass(frozen=True)
class Measure:
    """How illuminances are judged.

    Parameters
    ----------
    rules : Rules
        Thresholds of the metrics and of the shade.
    aim : {'sDA', 'worst month'}
        What is to be large.
    months : np.ndarray of int, shape (time,)
        Of the time stamps.
    """

    rules: Rules
    aim: Aim
    months: np.ndarray

    def smooth(self, E: Illuminances, k: float) -> tuple[mi.Float, mi.Float]:
        """What is to be large, and ASE [%], by twins of sharpness k, with gradients."""
        rules, t = self.rules, self.rules.metrics
        closed = smooth.shade_closed(E.direct, rules.shade_threshold, rules.shade_area, sharpness=k)
        total = smooth.applied(E.open, E.shaded, closed)
        if self.aim == "sDA":
            aim = smooth.sda(total, t.sda_threshold, t.sda_fraction, sharpness=k)
        else:
            months = smooth.msda(total, self.months, t.sda_threshold, t.sda_fraction, sharpness=k)
            aim = _soft_least(months.array, k / SOFTEST)
        return aim, smooth.ase(
            E.direct, t.ase_threshold, t.ase_hours, rules.step_hours, sharpness=k
        )

    def hard(self, E: Illuminances) -> tuple[float, float]:
        """What is to be large, and ASE [%], by `metrics`."""
        rules, t = self.rules, self.rules.metrics
        direct, is_open, shaded = (v.numpy() for v in (E.direct, E.open, E.shaded))
        sun = _dated(direct, self.months)
        closed = metrics.shade_closed(sun, rules.shade_threshold, rules.shade_area).values
        total = _dated(np.where(closed[:, None], shaded, is_open), self.months)
        if self.aim == "sDA":
            aim = metrics.sda(total, t.sda_threshold, t.sda_fraction)
        else:
            aim = float(np.nanmin(metrics.msda(total, t.sda_threshold, t.sda_fraction)))
        return aim, metrics.ase(sun, t.ase_threshold, t.ase_hours, rules.step_hours)


def _soft_least(values: mi.Float, beta: float) -> mi.Float:
    """Smooth minimum −ln(mean exp(−β·v)) / β; tends to the least as β grows."""
    least = dr.detach(dr.min(values))
    return least - dr.log(dr.mean(dr.exp((least - values) * beta))) / beta


def _dated(values: np.ndarray, months: np.ndarray) -> xr.DataArray:
    """Illuminance with a date in its month for each time stamp."""
    dates = np.datetime64("2001-01", "M") + (np.asarray(months) - 1)
    return xr.DataArray(values, {"time": dates.astype("M8[ns]")}, ("time", "sensor"))
