"""Counts of time stamps by sensor and month, from which all metrics of a year follow.

They are small where E[time, sensor] is not: a year of any number of sensors is counted block by
block.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.metrics import thresholds
from drcmitsuba.metrics.facade_states import shares_of_states
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.intervals import DrawnShares, Draws, Rules
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.metrics_of_spaces import by_space
from drcmitsuba.metrics.space_tasks import at_target
from drcmitsuba.metrics.space_years import SpaceYears
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.schema import luminance


def sensor_counts(illuminance: xr.Dataset, rules: Rules) -> xr.Dataset:
    """Count the time stamps of each sensor.

    Parameters
    ----------
    illuminance : xr.Dataset
        `total` and `direct_sun` (time, sensor) [lx], by channel where the case is coloured.
    rules : Rules
        Thresholds.

    Returns
    -------
    xr.Dataset
        `enough` and `in_sun` (sensor, month), numbers of time stamps at which `total` reaches the
        threshold of sDA and `direct_sun` that of ASE; `mean_illuminance` (sensor) [lx]; `DA`,
        `DA_low`, `DA_high` (sensor) [%] from `space_tasks.at_target`.
    """
    total, direct = luminance(illuminance["total"]), luminance(illuminance["direct_sun"])
    t = rules.metrics

    def count(E: xr.DataArray, name: str, limit: float) -> np.ndarray:
        return thresholds.stamps_by_month(E, name, limit)[0].T

    counted = {
        "enough": (("sensor", "month"), count(total, "illuminance", t.sda_threshold)),
        "in_sun": (("sensor", "month"), count(direct, "direct sun", t.ase_threshold)),
        "mean_illuminance": ("sensor", total.mean("time", dtype=float).values, {"units": "lx"}),
    }
    at = {name: c for name, c in illuminance.coords.items() if c.dims == ("sensor",)}
    autonomy = at_target(illuminance, sensors_by_space(illuminance), rules)
    return xr.Dataset(counted, {"month": np.arange(1, 13), **at}).assign(autonomy)


@dataclass(frozen=True)
class CountedYear:
    """Counts of all sensors of a year, with the draws of its metrics."""

    counts: xr.Dataset
    """From `sensor_counts`."""
    month: np.ndarray
    """Month of every time stamp, 1 to 12, shape (time,)."""
    rules: Rules
    draws: Draws
    closures: Closures
    of_group: np.ndarray
    """State of every group of panes at every time stamp, an index, shape (time, group)."""
    years: SpaceYears
    """Daylight of the spaces."""

    def numbers(self) -> dict[str, Any]:
        """Metrics with their intervals, as `evaluate_metrics.summarise` gives them."""
        closed, stamps = self.closures.closed, self._stamps
        with np.errstate(invalid="ignore"):
            by_month = 100 * np.bincount(self.month, closed, minlength=13)[1:] / stamps
        shut = self.draws.interval("shade_closed", 100 * float(closed.mean())).to_dict()
        numbers = self._shares(slice(None), self.draws)
        numbers = {"sDA": numbers["sDA"], "ASE": numbers["ASE"], "shade_closed": shut} | numbers
        numbers["shade_closed_monthly"] = self._monthly("shade_closed_monthly", by_month)
        numbers["undecided"] = undecided(self.counts, self.draws)
        groups = self.rules.groups
        if self.of_group.shape[1] and groups != GroupStates.of_shade():
            numbers["groups"] = shares_of_states(self.of_group, groups)

        def of(here: np.ndarray, drawn: DrawnShares | None) -> dict[str, Any]:
            return {"sensors": len(here), **self._shares(here, drawn or self.draws)}

        if grids := sensors_by_grid(self.counts):
            numbers["grids"] = {name: of(s, self.draws.grids[name]) for name, s in grids.items()}
        spaces = sensors_by_space(self.counts)
        every = self.counts, self.draws, spaces, self.years, self.rules
        return numbers | by_space(numbers, *every)

    @property
    def _stamps(self) -> np.ndarray:
        return np.bincount(self.month, minlength=13)[1:]

    def passing(self) -> dict[str, np.ndarray]:
        """Whether each sensor counts for `sDA` and `ASE`, bool, shape (sensor,)."""
        stamps, t = len(self.month), self.rules.metrics
        hours = metrics.exposure_stamps(t.ase_hours, self.rules.step_hours)
        return {
            "sDA": self._of_year("enough") >= metrics.autonomy_stamps(t.sda_fraction, stamps),
            "ASE": self._of_year("in_sun") >= hours,
        }

    def _of_year(self, name: str) -> np.ndarray:
        return np.asarray(self.counts[name].sum("month").values)

    def _shares(self, here: Any, drawn: DrawnShares) -> dict[str, Any]:
        """Shares of some sensors [%] with their intervals."""
        t, step, stamps = self.rules.metrics, self.rules.step_hours, len(self.month)
        required = {
            "msDA": [metrics.autonomy_stamps(t.sda_fraction, n) for n in self._stamps.tolist()],
            "MSE": [
                metrics.exposure_stamps(t.ase_hours, step, n, stamps) for n in self._stamps.tolist()
            ],
        }
        out: dict[str, Any] = {
            name: drawn.interval(name, thresholds.share(passed[here])).to_dict()
            for name, passed in self.passing().items()
        }
        for name, of in (("msDA", "enough"), ("MSE", "in_sun")):
            passed = self.counts[of].values[here] >= np.array(required[name])
            shares = np.array([thresholds.share(p) for p in passed.T])
            shares[self._stamps == 0] = np.nan
            out[name] = self._monthly(name, shares, drawn)
        return out

    def _monthly(
        self, name: str, values: np.ndarray, drawn: DrawnShares | None = None
    ) -> list[dict[str, float] | None]:
        """Twelve intervals, January first; None for a month without hours."""
        drawn = self.draws if drawn is None else drawn
        return [
            None if np.isnan(v) else drawn.interval(name, float(v), month).to_dict()
            for month, v in enumerate(values)
        ]

    def by_sensor(self) -> xr.Dataset:
        """Metrics of every sensor.

        Returns
        -------
        xr.Dataset, dims (sensor,)
            `mean_illuminance` [lx], `autonomy` [%], `sun_hours` [h], and the probabilities
            `probability_sDA` and `probability_ASE` that the sensor counts [–]; in spaces `DA` at
            their targets in their hours, with `DA_low` and `DA_high` [%].
        """
        stamps = len(self.month)
        hours = {"units": "h", "long_name": "hours with too much direct sun"}
        share = {"units": "%", "long_name": "share of hours with enough daylight"}
        sun = self._of_year("in_sun") * self.rules.step_hours
        out = self.counts.drop_dims("month").assign(
            autonomy=("sensor", 100 * self._of_year("enough") / stamps, share),
            sun_hours=("sensor", sun, hours),
        )
        for name, p in self.draws.passing.items():
            words = {"units": "1", "long_name": f"probability that the sensor counts for {name}"}
            out[f"probability_{name}"] = ("sensor", p, words)
        return out


def undecided(sensors: xr.Dataset, draws: Draws) -> list[dict[str, Any]]:
    """Sensors that neither pass nor fail clearly, with their probability of passing."""
    x, y, z = (sensors[axis].values for axis in "xyz")
    grid = sensors["grid"].values if "grid" in sensors.coords else None
    return [
        {
            "sensor": int(i), "x": float(x[i]), "y": float(y[i]), "z": float(z[i]),
            **({} if grid is None else {"grid": str(grid[i])}),
            "metric": metric, "probability": round(float(p[i]), 4),
        }
        for metric, p in draws.passing.items()
        for i in draws.undecided(metric)
    ]  # fmt: skip
