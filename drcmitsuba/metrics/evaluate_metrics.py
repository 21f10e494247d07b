"""What coefficients come to: illuminance, metrics, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.metrics import intervals
from drcmitsuba.metrics.intervals import Bounds, Draws, Rules, values
from drcmitsuba.sky.daylight import Daylight


@dataclass(frozen=True)
class Judgement:
    """Illuminance and metrics.

    Parameters
    ----------
    illuminance : xr.Dataset
        From `simulation.illuminance`.
    draws : Draws
        Of the metrics.
    metrics : dict
        From `summarise`.
    """

    illuminance: xr.Dataset
    draws: Draws
    metrics: dict[str, Any]

    def half_width(self, unit: str) -> float:
        """Half the width of the intervals, in the unit of an `accuracy.Target`."""
        return self.draws.half_width(self.metrics, unit)


def judge(case: Case, light: Daylight, found: xr.Dataset) -> Judgement:
    """Accumulate E from coefficients and draw its metrics."""
    E = simulation.illuminance(found, light.sky)
    E.attrs["step_hours"] = light.step_hours
    asked = simulation.rules(case, light.step_hours)
    draws = intervals.draw(found, light.sky, E, asked, **simulation.drawing(case))
    return Judgement(E, draws, summarise(E, asked, draws))


def _monthly(
    name: str, values: np.ndarray, spread: Draws | Bounds
) -> list[dict[str, float] | None]:
    """Twelve intervals, January first; None for a month without hours."""
    return [
        None if np.isnan(v) else spread.interval(name, float(v), month).as_dict()
        for month, v in enumerate(values)
    ]


def _undecided(illuminance: xr.Dataset, draws: Draws) -> list[dict[str, Any]]:
    """Sensors whose passing is too close to call, with their probability of it."""
    x, y, z = (illuminance[axis].values for axis in "xyz")
    return [
        {
            "sensor": int(i), "x": float(x[i]), "y": float(y[i]), "z": float(z[i]),
            "metric": metric, "probability": round(float(p[i]), 4),
        }
        for metric, p in draws.passing.items()
        for i in draws.undecided(metric)
    ]  # fmt: skip


def summarise(illuminance: xr.Dataset, rules: Rules, draws: Draws | None = None) -> dict[str, Any]:
    """Compute all metrics with their 95 % intervals.

    Parameters
    ----------
    illuminance : xr.Dataset
        As from `result.illuminance`.
    rules : Rules
        What the metrics ask for.
    draws : Draws, optional
        From `uncertainty.draw`. Without replicates there are none, and the intervals are those of
        `uncertainty.Bounds`: wider than 95 % calls for.

    Returns
    -------
    dict
        `sDA`, `ASE`, `shade_closed`: {"value", "low", "high"} [%]; `msDA`, `MSE`,
        `shade_closed_monthly`: 12 of these or None; with draws `undecided`: the sensors that pass
        in more than 2.5 and less than 97.5 % of them.
    """
    spread = Bounds.of(illuminance, rules) if draws is None else draws
    annual, monthly = values(illuminance, rules)
    numbers: dict[str, Any] = {
        **{name: spread.interval(name, value).as_dict() for name, value in annual.items()},
        **{name: _monthly(name, months, spread) for name, months in monthly.items()},
    }
    if draws is not None:
        numbers["undecided"] = _undecided(illuminance, draws)
    return numbers
