"""Draws of all metrics from the replicates of E: how far chance moves sDA, ASE and the shade."""

from __future__ import annotations

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
from drcmitsuba.metrics.intervals.sun import draw_sun
from drcmitsuba.metrics.intervals.year_draws import YearDraws, closures_of
from drcmitsuba.schema import luminance, mean_and_error


def closures(direct: xr.Dataset, rules: Rules, rays: int | None, seed: int) -> Closures:
    """Draw when the shade closes, from the direct sun [lx] of luminance; the rest as for `draw`."""
    mean, error = (direct[name].values for name in ("direct_sun", "direct_sun_se"))
    limits = rules.metrics.ase_threshold, rules.shade_threshold
    return closures_of(direct, draw_sun(mean, error, limits, rays, seed), rules)


def draw(
    coefficients: Coefficients, sky: xr.Dataset, illuminance: xr.Dataset, rules: Rules, *,
    rays: int | None, seed: int,
) -> Draws:  # fmt: skip
    """Draw all metrics from C of all states, by luminance or channel, and E of the same C and sky.

    E is from `accumulate.illuminance`, with the attribute `has_shade`. `rays` are the directions
    that were drawn from the disk of every sun, in all replicates; None where its rim was searched
    for edges, so that none is hidden. The same seed gives the same draws.
    """
    E = {name: luminance(illuminance[name]) for name in illuminance.data_vars}
    t, stamps = rules.metrics, sky.sizes["time"]
    mean, error = E["direct_sun"].values, E["direct_sun_se"].values
    sun = draw_sun(mean, error, (t.ase_threshold, rules.shade_threshold), rays, seed)
    shut = Closures.never(stamps)
    if illuminance.attrs.get("has_shade", 1):
        shut = closures_of(xr.Dataset(E), sun, rules)
    year = YearDraws.of(coefficients, sky, E, sun, shut, seed)
    month = metrics.months(E["total"]) - 1
    in_month = np.bincount(month, minlength=12)
    grids, grid = sensors_by_grid(illuminance), grid_of_sensors(illuminance)
    of_ase = [metrics.exposure_stamps(t.ase_hours, rules.step_hours, n, stamps) for n in in_month]
    hours = metrics.exposure_stamps(t.ase_hours, rules.step_hours)
    exposure = year.exposure(t.ase_threshold, Needed(month, np.array(of_ase), hours, grid))
    of_sda = [metrics.autonomy_stamps(t.sda_fraction, n) for n in in_month]
    hours = metrics.autonomy_stamps(t.sda_fraction, stamps)
    autonomy = year.autonomy(t.sda_threshold, Needed(month, np.array(of_sda), hours, grid))
    (sda, msda), (ase, mse) = autonomy.shares(), exposure.shares()
    closed, closed_monthly = shut.shares(month)
    return Draws(
        {"sDA": sda, "ASE": ase, "shade_closed": closed},
        {"msDA": msda, "MSE": mse, "shade_closed_monthly": closed_monthly},
        {"sDA": autonomy.passing, "ASE": exposure.passing},
        {"sDA": autonomy.hours, "ASE": exposure.hours},
        _mean_illuminance(coefficients.map(luminance), sky, shut),
        dict(zip(shut.states, shut.possible, strict=True)),
        {name: _shares(autonomy, exposure, i) for i, name in enumerate(grids)},
    )


def _shares(autonomy: BootstrapCounts, exposure: BootstrapCounts, grid: int) -> DrawnShares:
    """Draws of the metrics of one grid."""
    (sda, msda), (ase, mse) = autonomy.shares(grid), exposure.shares(grid)
    return DrawnShares({"sDA": sda, "ASE": ase}, {"msDA": msda, "MSE": mse})


def _mean_illuminance(coefficients: Coefficients, sky: xr.Dataset, shut: Closures) -> Interval:
    """Mean over hours and sensors [lx], from its replicates."""
    total = np.zeros(coefficients.open.sizes["replicate"])
    for k, state in enumerate(shut.states):
        hours = shut.state == k
        if hours.any():
            C = coefficients.states[state]
            names = ("replicates", "sun_straight", "sun_straight_se", "illuminance")
            C = C[[name for name in names if name in C]]
            C = C.mean("sensor", keepdims=True, skipna=False, dtype=float)
            at = sky.isel(time=np.flatnonzero(hours))
            E = accumulate.replicates(C, at, np.zeros(1, np.int64))
            total += E.sum(axis=(1, 2), dtype=float)
    mean, error = mean_and_error(total / len(shut.state))
    half = t_factor(len(total)) * error
    return Interval(float(mean), float(mean - half), float(mean + half))
