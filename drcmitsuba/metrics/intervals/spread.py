"""Intervals of the metrics: from their draws, or from the standard errors alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.case.groups import State
from drcmitsuba.metrics import Interval, thresholds
from drcmitsuba.metrics.facade_states import sunlit
from drcmitsuba.metrics.grids import grid_of_sensors
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts
from drcmitsuba.metrics.intervals.rules import TAIL, Rules
from drcmitsuba.schema import luminance


@dataclass(frozen=True)
class DrawnShares:
    """Draws of the metrics of some sensors [%]."""

    annual: dict[str, np.ndarray]
    """`sDA`, `ASE`, and of all sensors `shade_closed`, shape (draw,)."""
    monthly: dict[str, np.ndarray]
    """`msDA`, `MSE`, and of all sensors `shade_closed_monthly`, January first, shape (month, draw);
    NaN for a month without hours."""

    @classmethod
    def mean(cls, parts: Sequence[DrawnShares], weights: Sequence[float]) -> DrawnShares:
        """Mean of the same draws for several sets of sensors, by weights of any sum."""

        def mean(values: Sequence[np.ndarray]) -> np.ndarray:
            return np.asarray(np.average(values, axis=0, weights=weights))

        first = parts[0]
        return cls(
            {n: mean([p.annual[n] for p in parts]) for n in ("sDA", "ASE") if n in first.annual},
            {n: mean([p.monthly[n] for p in parts]) for n in ("msDA", "MSE") if n in first.monthly},
        )

    def interval(self, name: str, value: float, month: int | None = None) -> Interval:
        """95 % interval of a metric, which always holds its value.

        Draws of direct sun and of the shade are possible truths: the interval is that of their
        percentiles. Draws of sDA and msDA are possible results of another simulation and contain
        the noise of this one a second time: the interval also holds the mirror images of the
        percentiles about the value (the pivotal interval), which correct that bias. Both were
        tested on 200 evaluations of a room whose truth is known (tests/validation).
        """
        draws = self.annual[name] if month is None else self.monthly[name][month]
        inside = (len(draws) - 1) * TAIL  # number of draws that a tail holds, a fraction
        ordered = np.sort(draws)
        ends = [float(ordered[math.floor(inside)]), float(ordered[-1 - math.floor(inside)])]
        if name in ("sDA", "msDA"):
            ends += [2 * value - end for end in ends]
        return Interval(value, max(0.0, min(value, *ends)), min(100.0, max(value, *ends)))


@dataclass(frozen=True)
class Draws(DrawnShares):
    """Draws of the metrics of all sensors [%], and how likely each sensor passes."""

    counts: Mapping[str, BootstrapCounts]
    """`sDA`, `ASE`: the sensors that count in every draw."""
    mean_illuminance: Interval
    """Mean over all hours and sensors, shade applied [lx]."""
    possible: Mapping[State, np.ndarray]
    """Time stamps at which the façade takes each state in some draw, shape (time,)."""
    grids: dict[str, DrawnShares] = field(default_factory=dict)
    """The same draws of `sDA`, `ASE`, `msDA` and `MSE` for the sensors of each grid."""

    @property
    def passing(self) -> dict[str, np.ndarray]:
        """`sDA`, `ASE`: share of the draws in which a sensor counts, 0 to 1, shape (sensor,)."""
        return {name: tally.passing for name, tally in self.counts.items()}

    @property
    def hours(self) -> dict[str, np.ndarray]:
        """`sDA`, `ASE`: number of the undecided sensors at which an hour is in doubt, (time,)."""
        return {name: tally.hours for name, tally in self.counts.items()}

    def undecided(self, metric: str) -> np.ndarray:
        """Sensors whose passing is too close to call: 2.5 % < probability < 97.5 %."""
        p = self.passing[metric]
        return np.flatnonzero((p > TAIL) & (p < 1 - TAIL))

    def half_width(self, numbers: Mapping[str, Any], unit: str) -> float:
        """Half the width of the intervals, to be compared with `accuracy.Target`.

        With the unit "point" it is the larger of those of sDA and of ASE in `numbers`, which are
        from `evaluate_metrics.summarise`, in points; with "%", that of the mean illuminance.
        """
        if unit == "point":
            return max(numbers[m]["high"] - numbers[m]["low"] for m in self.passing) / 2
        E = self.mean_illuminance
        return 100 * (E.high - E.low) / (2 * E.value) if E.value else 0.0


@dataclass(frozen=True)
class Bounds:
    """Intervals without replicates: metrics of E with all errors in the same direction.

    Every illuminance is set to the lower, then to the upper end of its own 95 % interval. The
    correlation of errors between sensors and hours is unknown without replicates; independent
    errors would cancel out in the metrics and give intervals that are too narrow. These intervals
    are wider than 95 % calls for.
    """

    annual: dict[str, tuple[float, float]]
    """(low, high) of each metric [%]."""
    monthly: dict[str, tuple[np.ndarray, np.ndarray]]
    """(low, high) of each metric, shape (month,) each."""

    @classmethod
    def of(cls, illuminance: xr.Dataset, rules: Rules) -> Bounds:
        """Evaluate E − f·se and E + f·se; f is the attribute `interval_factor`, else 1.96."""
        factor = float(illuminance.attrs.get("interval_factor", 1.96))
        low, high = (values(illuminance, rules, f) for f in (-factor, factor))
        return cls(
            {name: (low[0][name], high[0][name]) for name in low[0]},
            {name: (low[1][name], high[1][name]) for name in low[1]},
        )

    def interval(self, name: str, value: float, month: int | None = None) -> Interval:
        """Bounds of a metric, widened to hold the value: more direct sun closes more shades."""
        ends = self.annual[name] if month is None else [m[month] for m in self.monthly[name]]
        return Interval(value, float(min(value, *ends)), float(max(value, *ends)))


def values(
    illuminance: xr.Dataset, rules: Rules, errors: float = 0.0
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Metrics [%] of E with so many standard errors added: of the year, and by month (month,).

    `sDA`, `ASE`, `shade_closed`; `msDA`, `MSE`, `shade_closed_monthly`, NaN without hours.
    """
    total, direct = (luminance(illuminance[name]) for name in ("total", "direct_sun"))
    if errors:
        total = total + errors * luminance(illuminance["total_se"])
        direct = direct + errors * luminance(illuminance["direct_sun_se"])
        illuminance = illuminance.assign(direct_sun=direct)
    t = rules.metrics
    enough, stamps = thresholds.stamps_by_month(total, "illuminance", t.sda_threshold)
    in_sun, _ = thresholds.stamps_by_month(direct, "direct", t.ase_threshold)

    def lit(t_m: int, t_y: int) -> int:
        return metrics.autonomy_stamps(t.sda_fraction, t_m)

    def exposed(t_m: int, t_y: int) -> int:
        return metrics.exposure_stamps(t.ase_hours, rules.step_hours, t_m, t_y)

    def share(reached: np.ndarray, required: Callable[[int, int], int]) -> float:
        whole = int(stamps.sum())
        return thresholds.share(reached.sum(axis=0) >= required(whole, whole))

    rule = rules.shade
    counts = sunlit(illuminance, rule)
    sensors = np.bincount(grid_of_sensors(illuminance))
    indices = rule.indices(rule.closed(counts, sensors), direct["time"])
    closed = rule.groups.share_closed(indices)
    closed *= bool(illuminance.attrs.get("has_shade", 1))
    shut = np.bincount(metrics.months(total), closed, minlength=13)[1:]
    return (
        {
            "sDA": share(enough, lit),
            "ASE": share(in_sun, exposed),
            "shade_closed": 100 * float(closed.mean()),
        },
        {
            "msDA": thresholds.monthly(enough, stamps, lit).values,
            "MSE": thresholds.monthly(in_sun, stamps, exposed).values,
            "shade_closed_monthly": np.where(stamps, 100 * shut / np.maximum(stamps, 1), np.nan),
        },
    )
