"""Draws of all metrics from the replicates of E: how far chance moves sDA, ASE and the shade."""

from __future__ import annotations

from collections.abc import Hashable, Mapping

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics import Interval, accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.intervals.autonomy import State, draw_autonomy, multipliers
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.rules import Rules, t_factor
from drcmitsuba.metrics.intervals.spread import DrawnShares, Draws
from drcmitsuba.metrics.intervals.sun import Closures, SunDraws, draw_closures, draw_sun
from drcmitsuba.schema import luminance, mean_and_error


def _exposure(mean: np.ndarray, sun: SunDraws, threshold: float, needed: Needed) -> BootstrapCounts:
    """Draw ASE and MSE from the mean direct sun (time, sensor) [lx]."""
    drawn = np.zeros(mean.shape, bool)
    drawn[sun.time, sun.sensor] = True
    tally = BootstrapCounts(needed, needed.count((mean >= threshold) & ~drawn), needed.count(drawn))
    for sensor in tally.sensors:
        entries = np.flatnonzero(sun.sensor == sensor)
        time = tally.wanted(sensor, sun.time[entries])
        kept = entries[np.isin(sun.time[entries], time)]
        tally.add(sensor, sun.time[kept], sun.exposed[kept])
    return tally


def closures(direct: xr.Dataset, rules: Rules, rays: int | None, seed: int) -> Closures:
    """Draw when the shade closes, from the direct sun [lx] of luminance; the rest as for `draw`."""
    mean, error = (direct[name].values for name in ("direct_sun", "direct_sun_se"))
    limits = rules.metrics.ase_threshold, rules.shade_threshold
    return draw_closures(mean, draw_sun(mean, error, limits, rays, seed), rules)


def draw(
    coefficients: Coefficients, sky: xr.Dataset, illuminance: xr.Dataset, rules: Rules, *,
    rays: int | None, seed: int,
) -> Draws:  # fmt: skip
    """Draw all metrics from C of both states, by luminance or channel, and E of the same C and sky.

    E is from `accumulate.illuminance`, with the attribute `has_shade`. `rays` are the directions
    that were drawn from the disk of every sun, in all replicates; None where its rim was searched
    for edges, so that none is hidden. The same seed gives the same draws.
    """
    E = {name: luminance(illuminance[name]) for name in illuminance.data_vars}
    mean, error = E["direct_sun"].values, E["direct_sun_se"].values
    t = rules.metrics
    sun = draw_sun(mean, error, (t.ase_threshold, rules.shade_threshold), rays, seed)
    shut = Closures.never(len(mean))
    if illuminance.attrs.get("has_shade", 1):
        shut = draw_closures(mean, sun, rules)
    month = metrics.months(E["total"]) - 1
    stamps = np.bincount(month, minlength=12)
    of_ase = [metrics.exposure_stamps(t.ase_hours, rules.step_hours, n, len(mean)) for n in stamps]
    grids = sensors_by_grid(illuminance)
    grid = np.zeros(mean.shape[1], np.int64)
    for i, sensors in enumerate(grids.values()):
        grid[sensors] = i
    hours = metrics.exposure_stamps(t.ase_hours, rules.step_hours)
    needed = Needed(month, np.array(of_ase), hours, grid)
    exposure = _exposure(mean, sun, t.ase_threshold, needed)
    by_luminance = coefficients.map(luminance)
    drawn = multipliers(coefficients.open.sizes["replicate"], seed)
    of_sda = [metrics.autonomy_stamps(t.sda_fraction, n) for n in stamps]
    hours = metrics.autonomy_stamps(t.sda_fraction, len(mean))
    needed = Needed(month, np.array(of_sda), hours, grid)
    states = _states(by_luminance, sky, E, shut)
    autonomy = draw_autonomy(*states, shut, t.sda_threshold, needed, drawn)
    (sda, msda), (ase, mse) = autonomy.shares(), exposure.shares()
    closed, closed_monthly = shut.shares(month)
    return Draws(
        {"sDA": sda, "ASE": ase, "shade_closed": closed},
        {"msDA": msda, "MSE": mse, "shade_closed_monthly": closed_monthly},
        {"sDA": autonomy.passing, "ASE": exposure.passing},
        {"sDA": autonomy.hours, "ASE": exposure.hours},
        _mean_illuminance(by_luminance, sky, shut.closed),
        shut.possible,
        {name: _shares(autonomy, exposure, i) for i, name in enumerate(grids)},
    )


def _shares(autonomy: BootstrapCounts, exposure: BootstrapCounts, grid: int) -> DrawnShares:
    """Draws of the metrics of one grid."""
    (sda, msda), (ase, mse) = autonomy.shares(grid), exposure.shares(grid)
    return DrawnShares({"sDA": sda, "ASE": ase}, {"msDA": msda, "MSE": mse})


def _mean_illuminance(coefficients: Coefficients, sky: xr.Dataset, closed: np.ndarray) -> Interval:
    """Mean over hours and sensors [lx], from its replicates."""
    total = np.zeros(coefficients.open.sizes["replicate"])
    for state, C in coefficients.states.items():
        hours = closed if state == "shaded" else ~closed
        if hours.any():
            names = ("replicates", "sun_straight", "sun_straight_se")
            C = C[[name for name in names if name in C]]
            C = C.mean("sensor", keepdims=True, skipna=False, dtype=float)
            at = sky.isel(time=np.flatnonzero(hours))
            E = accumulate.replicates(C, at, np.zeros(1, np.int64))
            total += E.sum(axis=(1, 2), dtype=float)
    mean, error = mean_and_error(total / len(closed))
    half = t_factor(len(total)) * error
    return Interval(float(mean), float(mean - half), float(mean + half))


def _states(
    coefficients: Coefficients, sky: xr.Dataset, E: Mapping[Hashable, xr.DataArray], shut: Closures
) -> tuple[State, State | None]:
    """Illuminance of both states at the hours that they are wanted for."""
    varies = np.zeros(len(shut.closed), bool)
    varies[shut.hours] = True
    wanted = ~shut.closed | varies
    everywhere = np.ones_like(wanted)
    known = E["total_open"].values, E["total_open_se"].values
    is_open = State.of(coefficients.open, sky, wanted, known, everywhere)
    if coefficients.shaded is None or not shut.possible.any():
        return is_open, None
    known = E["total"].values, E["total_se"].values
    return is_open, State.of(coefficients.shaded, sky, shut.possible, known, shut.closed)
