"""Draws of all metrics from the replicates of E: how far chance moves sDA, ASE and the shade."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics import Interval, accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.grids import grid_of_sensors, sensors_by_grid
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.rules import Rules, t_factor
from drcmitsuba.metrics.intervals.spread import DrawnShares, Draws
from drcmitsuba.metrics.intervals.sun import SunDraws, draw_sun
from drcmitsuba.metrics.intervals.year_draws import YearDraws, closures_of
from drcmitsuba.schema import by_luminance, luminance, mean_and_error

DRAWN = ("total", "total_se", "total_open", "total_open_se", "direct_sun", "direct_sun_se")
"""Arrays of E that draws are made of."""


class ShadeDraws(NamedTuple):
    """Direct sun near its thresholds, and the states of the façade that follow from it."""

    sun: SunDraws
    closures: Closures

    def at(self, hours: np.ndarray) -> ShadeDraws:
        """Draws of some time stamps, indices in rising order, int, shape (chosen,)."""
        return ShadeDraws(self.sun.at(hours), self.closures.at(hours))

    @classmethod
    def of(cls, direct: xr.Dataset, rules: Rules, rays: int | None, seed: int) -> ShadeDraws:
        """Draw from the direct sun [lx] of luminance; the attribute and the rest as for `draw`."""
        mean, error = (direct[name].values for name in ("direct_sun", "direct_sun_se"))
        limits = rules.metrics.ase_threshold, rules.shade_threshold
        sun = draw_sun(mean, error, limits, rays, seed)
        if not direct.attrs.get("has_shade", 1):
            return cls(sun, Closures.never(direct.sizes["time"]))
        return cls(sun, closures_of(direct, sun, rules))


def draw(
    coefficients: Coefficients, sky: xr.Dataset, illuminance: xr.Dataset, rules: Rules, *,
    rays: int | None, seed: int, shade: ShadeDraws | None = None,
) -> Draws:  # fmt: skip
    """Draw all metrics from C of all states, by luminance or channel, and E of the same C and sky.

    E is from `accumulate.illuminance`, with the attribute `has_shade`. `rays` are the directions
    that were drawn from the disk of every sun, in all replicates; None where its rim was searched
    for edges, so that none is hidden. The same seed gives the same draws. `shade` are the draws of
    this direct sun with the same rules, rays and seed, where they are known.
    """
    if shade is None:
        names = ("direct_sun", "direct_sun_se", "sun_group")
        direct = by_luminance(illuminance[[name for name in names if name in illuminance]])
        shade = ShadeDraws.of(direct.assign_attrs(illuminance.attrs), rules, rays, seed)
    sun, shut = shade
    grid = grid_of_sensors(illuminance)
    block = draw_block(coefficients, sky, illuminance, rules, sun, shut, grid, seed)
    month = metrics.months(illuminance["total"]) - 1
    return block.draws(shut, month, list(sensors_by_grid(illuminance)))


@dataclass(frozen=True)
class BlockDraws:
    """Draws of a block of sensors."""

    autonomy: BootstrapCounts
    """Sensors with enough daylight for sDA and msDA."""
    exposure: BootstrapCounts
    """Sensors with too much sun for ASE and MSE."""
    mean: np.ndarray
    """Mean over hours and sensors by each replicate [lx], shape (replicate,)."""

    def plus(self, other: BlockDraws) -> BlockDraws:
        """Draws of the sensors of two blocks, this one's first."""
        mine, theirs = self.autonomy.sizes.sum(), other.autonomy.sizes.sum()
        mean = (mine * self.mean + theirs * other.mean) / (mine + theirs)
        exposure = self.exposure.plus(other.exposure)
        return BlockDraws(self.autonomy.plus(other.autonomy), exposure, mean)

    def draws(self, shut: Closures, month: np.ndarray, grids: Sequence[str]) -> Draws:
        """Draws of all metrics; the `month` of each time stamp counts from 0."""
        (sda, msda), (ase, mse) = self.autonomy.shares(), self.exposure.shares()
        closed, closed_monthly = shut.shares(month)
        return Draws(
            {"sDA": sda, "ASE": ase, "shade_closed": closed},
            {"msDA": msda, "MSE": mse, "shade_closed_monthly": closed_monthly},
            {"sDA": self.autonomy, "ASE": self.exposure},
            _interval(self.mean),
            dict(zip(shut.states, shut.possible, strict=True)),
            {name: _shares(self.autonomy, self.exposure, i) for i, name in enumerate(grids)},
        )


def draw_block(
    coefficients: Coefficients, sky: xr.Dataset, illuminance: xr.Dataset, rules: Rules,
    sun: SunDraws, shut: Closures, grid: np.ndarray, seed: int,
) -> BlockDraws:  # fmt: skip
    """Draw a block of sensors, the state of the façade and the direct `sun` drawn before.

    `grid` (sensor,) is the number of each sensor's grid; the rest as for `draw`.
    """
    E: dict[Hashable, xr.DataArray] = {
        name: luminance(illuminance[name]) for name in DRAWN if name in illuminance
    }
    t, stamps = rules.metrics, sky.sizes["time"]
    year = YearDraws.of(coefficients, sky, E, sun, shut, seed)
    month = metrics.months(E["total"]) - 1
    in_month = np.bincount(month, minlength=12)
    of_ase = [metrics.exposure_stamps(t.ase_hours, rules.step_hours, n, stamps) for n in in_month]
    hours = metrics.exposure_stamps(t.ase_hours, rules.step_hours)
    exposure = year.exposure(t.ase_threshold, Needed(month, np.array(of_ase), hours, grid))
    of_sda = [metrics.autonomy_stamps(t.sda_fraction, n) for n in in_month]
    hours = metrics.autonomy_stamps(t.sda_fraction, stamps)
    autonomy = year.autonomy(t.sda_threshold, Needed(month, np.array(of_sda), hours, grid))
    return BlockDraws(autonomy, exposure, _means(coefficients.by_luminance(), sky, shut))


def _shares(autonomy: BootstrapCounts, exposure: BootstrapCounts, grid: int) -> DrawnShares:
    """Draws of the metrics of one grid."""
    (sda, msda), (ase, mse) = autonomy.shares(grid), exposure.shares(grid)
    return DrawnShares({"sDA": sda, "ASE": ase}, {"msDA": msda, "MSE": mse})


def _means(coefficients: Coefficients, sky: xr.Dataset, shut: Closures) -> np.ndarray:
    """Mean over hours and sensors by each replicate [lx], shape (replicate,)."""
    total = np.zeros(coefficients.open.sizes["replicate"])
    for k, state in enumerate(shut.states):
        hours = shut.state == k
        if hours.any():
            C, at = coefficients.states[state], sky.isel(time=np.flatnonzero(hours))
            if "illuminance" in C:
                alike = np.full((1, C.sizes["sensor"]), 1 / C.sizes["sensor"])
                total += accumulate.of_means(C, at, alike).sum(axis=(1, 2), dtype=float)
                continue
            names = ("replicates", "sun_straight", "sun_straight_se")
            C = C[[name for name in names if name in C]]
            C = C.mean("sensor", keepdims=True, skipna=False, dtype=float)
            E = accumulate.replicates(C, at, np.zeros(1, np.int64))
            total += E.sum(axis=(1, 2), dtype=float)
    return total / len(shut.state)


def _interval(means: np.ndarray) -> Interval:
    """Mean of independent replicates [lx] with its interval."""
    mean, error = mean_and_error(means)
    half = t_factor(len(means)) * error
    return Interval(float(mean), float(mean - half), float(mean + half))
