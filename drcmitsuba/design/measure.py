"""Rating of a year: the aim and ASE, smooth and hard side by side.

Façades and lamellae are rated by the same numbers, in per cent. A search follows the smooth twins;
only the hard numbers, those of `drcmitsuba.metrics`, are reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.design.facade_glare import (
    TracedEyes,
    Weights,
    hard_hours,
    smooth_hours,
    states_of_hours,
)
from drcmitsuba.design.facade_groups import FacadeGroups, applied, smooth_applied
from drcmitsuba.design.requirement import Requirement
from drcmitsuba.metrics import Interval, smooth
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.transport.elements.state_illuminances import Illuminances

Aim = Literal["sDA", "worst month", "standard", "glare"]
NAMES: Mapping[Aim, str] = {
    "sDA": "sDA", "worst month": "msDA of the worst month", "standard": "margin of the standard",
    "glare": "hours without glare",
}  # fmt: skip
"""Names of the aims in tables and pictures."""
COLUMNS: Mapping[Aim, str] = {
    "sDA": "sDA", "worst month": "worst_msDA", "standard": "margin", "glare": "without_glare",
}  # fmt: skip
"""Names of the aims in files."""
AIMS_OF_METRICS: tuple[Aim, ...] = ("sDA", "worst month")
"""Aims that every evaluation tells in its `metrics.json`."""
SOFTEST = 50.0
"""Months, or margins, within SOFTEST / sharpness [%] of the lowest count as the worst together."""
SHORT = 1e-6
"""Least distance from 0 of the margin of a level that the standard's count does not reach [%]."""
HARD = 0.0
"""Sharpness of a design of which hard numbers alone were computed."""
ASE_TOLERANCE = 1e-9
"""Largest excess of ASE over its limit that still holds the limit [%]."""


def interval_of_aim(metrics: dict[str, Any], aim: Aim) -> Interval:
    """95 % interval [%] of one of the `AIMS_OF_METRICS`, from `metrics.json`.

    For the worst month it is the interval of that month alone.
    """
    if aim == "sDA":
        return Interval(**metrics["sDA"])
    months = [month for month in metrics["msDA"] if month is not None]
    return Interval(**min(months, key=lambda month: month["value"]))


@dataclass(frozen=True)
class Score:
    """One design in numbers, hard or smooth [%].

    `value` is the objective, the aim less its cost; the aim is sDA, msDA of the worst month, or the
    least margin of a level of a standard, which is 0 or more where the level is reached, or the
    share of the hours without glare at the worst eye.
    """

    value: float
    aim: float
    ase: float

    @property
    def holds_aim(self) -> bool:
        """Whether the aim is as high as it has to be; true where it is the objective."""
        return True

    @property
    def rank(self) -> tuple[float, ...]:
        """Sort key among designs that hold the limits of ASE and area: the objective."""
        return (self.value,)


@dataclass(frozen=True, eq=False)
class RatedCandidate:
    """One design, x (free,) as fractions of the ranges, 0 to 1, with its smooth and its hard score.

    The smooth twins have the given sharpness.
    """

    x: np.ndarray
    sharpness: float
    smooth: Score
    hard: Score

    @property
    def objective(self) -> float:
        """Objective by the hard metrics [%]."""
        return self.hard.value

    def merit(
        self, ase_limit: float | None, area_error: float, glare_excess: float = 0.0
    ) -> tuple[float, ...]:
        """Sort key: the largest hard objective among the candidates that hold the constraints.

        These are a largest ASE [%], an area of panes, by its deviation as a fraction, and a largest
        share of hours with glare, by its excess [%]. If no candidate holds them, the least ASE and
        glare among candidates with the required area; then the highest aim, where it has to reach a
        value. Equal candidates are ordered by the smooth objective at the highest sharpness, so
        that the search does not stop at the edge of a plateau of the hard metric.
        """
        over = 0.0 if ase_limit is None else max(self.hard.ase - ase_limit - ASE_TOLERANCE, 0.0)
        over += glare_excess
        smooth = 0.0 if self.sharpness == HARD else self.smooth.value
        return -area_error, -over, *self.hard.rank, self.sharpness, smooth


class RatedProblem:
    """Merit and constraints of a `goal`, which has an `aim` and an `ase_limit` [%]."""

    goal: Any

    def area_error(self, score: Any) -> float:
        """Deviation of the panes' area as a fraction of the required area; 0 within tolerance."""
        return 0.0

    def glare_excess(self, score: Any) -> float:
        """Hours with glare beyond their limit [%]; 0 without one."""
        return 0.0

    def is_feasible(self, score: Any) -> bool:
        """True if a hard score holds the constraints."""
        return score.holds_aim and self.holds_limits(score)

    def holds_limits(self, score: Any) -> bool:
        """True if a hard score holds the constraints on ASE, the panes' area and glare."""
        limit = self.goal.ase_limit
        holds_ase = limit is None or score.ase <= limit + ASE_TOLERANCE
        return holds_ase and self.area_error(score) == 0 == self.glare_excess(score)

    def holds(self, candidate: Any) -> bool:
        """True if the candidate's hard numbers hold the constraints."""
        return self.is_feasible(candidate.hard)

    def merit(self, candidate: Any) -> tuple[float, ...]:
        """Sort key of candidates; see `RatedCandidate.merit`."""
        hard = candidate.hard
        return candidate.merit(self.goal.ase_limit, self.area_error(hard), self.glare_excess(hard))

    def numbers(self, candidate: Any) -> dict[str, float]:
        """Columns of the history: hard and smooth numbers [%]."""
        name = COLUMNS[self.goal.aim]
        return {
            "sharpness": candidate.sharpness,
            "value": candidate.hard.value,
            name: candidate.hard.aim,
            "ASE": candidate.hard.ase,
            "smooth_value": candidate.smooth.value,
            f"smooth_{name}": candidate.smooth.aim,
            "smooth_ASE": candidate.smooth.ase,
        }


@dataclass(frozen=True)
class Measure:
    """Rules by which illuminances are rated, and the month 1 … 12 of each time stamp (time,).

    The aim "standard" is that of a `requirement`, the aim "glare" of the hours with glare.
    """

    rules: Rules
    aim: Aim
    months: np.ndarray
    groups: FacadeGroups | None = None
    """Groups of panes that close one by one; None where one shade closes."""
    requirement: Requirement | None = None

    def smooth(
        self, E: Illuminances, sharpness: float, glare: mi.Float | None = None
    ) -> tuple[mi.Float, mi.Float]:
        """Rate illuminances by the smooth twins: aim and ASE [%], with gradients.

        `glare` are the hours with glare at the worst eye [%], from `glare_smooth`.
        """
        t, k, step = self.rules.metrics, sharpness, self.rules.step_hours
        ase = smooth.ase(E.direct, t.ase_threshold, t.ase_hours, step, sharpness=k)
        if self.requirement is not None:
            margins = dr.concat(self.requirement.smooth(E, k))
            return _soft_minimum(100 * margins, k / SOFTEST), ase
        if self.aim == "glare" and glare is not None:
            return 100 - glare, ase
        total = smooth_applied(E, self.rules, self.groups, k)
        if self.aim == "sDA":
            return smooth.sda(total, t.sda_threshold, t.sda_fraction, sharpness=k), ase
        months = smooth.msda(total, self.months, t.sda_threshold, t.sda_fraction, sharpness=k)
        return _soft_minimum(months.array, k / SOFTEST), ase

    def hard(self, E: Illuminances, glare: float | None = None) -> tuple[float, float]:
        """Rate illuminances by `metrics`: aim and ASE [%]; `glare` as for `smooth`."""
        rules, t = self.rules, self.rules.metrics
        direct_sun = _dated(E.direct.numpy(), self.months)
        ase = metrics.ase(direct_sun, t.ase_threshold, t.ase_hours, rules.step_hours)
        if self.requirement is not None:
            outcome, margins = self.requirement.hard(E)
            least = 100 * float(margins.min())
            return (max(least, 0.0) if outcome.reached else min(least, -SHORT)), ase
        if self.aim == "glare" and glare is not None:
            return 100 - glare, ase
        total = _dated(applied(E, direct_sun, rules, self.groups), self.months)
        if self.aim == "sDA":
            return metrics.sda(total, t.sda_threshold, t.sda_fraction), ase
        return float(np.nanmin(metrics.msda(total, t.sda_threshold, t.sda_fraction))), ase

    def glare_smooth(
        self, eyes: TracedEyes, weights: Weights, E: Illuminances, sharpness: float
    ) -> mi.Float:
        """Hours with glare at the worst eye [%], smooth, by shares and factors of elements."""
        of_views = smooth_hours(eyes, weights, E, self.rules, self.groups, sharpness)
        return -_soft_minimum(-of_views.array, sharpness / SOFTEST)

    def glare_hard(self, eyes: TracedEyes, weights: Weights, E: Illuminances) -> float:
        """Hours with glare at the worst eye [%]."""
        direct = _dated(E.direct.numpy(), self.months)
        return float(hard_hours(eyes, weights, E, direct, self.rules, self.groups).max())

    def states(self, E: Illuminances) -> np.ndarray:
        """Number of the state that the façade takes in every hour, int, shape (time,)."""
        direct = _dated(E.direct.numpy(), self.months)
        return states_of_hours(E, direct, self.rules, self.groups)


def _soft_minimum(values: mi.Float, beta: float) -> mi.Float:
    """Smooth minimum −ln(mean exp(−β·v)) / β; tends to the minimum as β grows."""
    least = dr.detach(dr.min(values))
    return least - dr.log(dr.mean(dr.exp((least - values) * beta))) / beta


def _dated(values: np.ndarray, months: np.ndarray) -> xr.DataArray:
    """Illuminance (time, sensor) with a date in its month for each time stamp."""
    dates = np.datetime64("2001-01", "M") + (np.asarray(months) - 1)
    return xr.DataArray(values, {"time": dates.astype("M8[ns]")}, ("time", "sensor"))
