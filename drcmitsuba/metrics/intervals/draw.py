"""Draws of all metrics from the replicates of E: how far chance moves sDA, ASE and the shade."""

from __future__ import annotations

from collections.abc import Hashable, Mapping

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics import Interval, accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import sun_group
from drcmitsuba.metrics.grids import grid_of_sensors, sensors_by_grid
from drcmitsuba.metrics.intervals.autonomy import State, draw_autonomy, multipliers
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.facade_draws import Closures, draw_closures
from drcmitsuba.metrics.intervals.rules import Rules, t_factor
from drcmitsuba.metrics.intervals.spread import DrawnShares, Draws
from drcmitsuba.metrics.intervals.sun import SunDraws, draw_sun
from drcmitsuba.runtime.errors import InputError
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
    return _closures(direct, draw_sun(mean, error, limits, rays, seed), rules)


def _closures(direct: xr.Dataset, sun: SunDraws, rules: Rules) -> Closures:
    """Draw when groups of panes close, from the direct sun and its draws."""
    mean, rule = direct["direct_sun"], rules.shade
    group = None if len(rule.groups) == 1 else sun_group(direct)
    return draw_closures(mean.values, group, grid_of_sensors(direct), mean["time"], sun, rule)


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
    mean, error = E["direct_sun"].values, E["direct_sun_se"].values
    t = rules.metrics
    sun = draw_sun(mean, error, (t.ase_threshold, rules.shade_threshold), rays, seed)
    shut = Closures.never(len(mean))
    if illuminance.attrs.get("has_shade", 1):
        shut = _closures(xr.Dataset(E), sun, rules)
    month = metrics.months(E["total"]) - 1
    stamps = np.bincount(month, minlength=12)
    of_ase = [metrics.exposure_stamps(t.ase_hours, rules.step_hours, n, len(mean)) for n in stamps]
    grids, grid = sensors_by_grid(illuminance), grid_of_sensors(illuminance)
    hours = metrics.exposure_stamps(t.ase_hours, rules.step_hours)
    needed = Needed(month, np.array(of_ase), hours, grid)
    exposure = _exposure(mean, sun, t.ase_threshold, needed)
    by_luminance = coefficients.map(luminance)
    drawn = multipliers(coefficients.open.sizes["replicate"], seed)
    of_sda = [metrics.autonomy_stamps(t.sda_fraction, n) for n in stamps]
    hours = metrics.autonomy_stamps(t.sda_fraction, len(mean))
    needed = Needed(month, np.array(of_sda), hours, grid)
    states = _states(by_luminance, sky, E, shut)
    autonomy = draw_autonomy(states, shut, t.sda_threshold, needed, drawn)
    (sda, msda), (ase, mse) = autonomy.shares(), exposure.shares()
    closed, closed_monthly = shut.shares(month)
    return Draws(
        {"sDA": sda, "ASE": ase, "shade_closed": closed},
        {"msDA": msda, "MSE": mse, "shade_closed_monthly": closed_monthly},
        {"sDA": autonomy.passing, "ASE": exposure.passing},
        {"sDA": autonomy.hours, "ASE": exposure.hours},
        _mean_illuminance(by_luminance, sky, shut),
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


def _states(
    coefficients: Coefficients, sky: xr.Dataset, E: Mapping[Hashable, xr.DataArray], shut: Closures
) -> list[State]:
    """Illuminance of all states at the hours that they are wanted for."""
    everywhere = np.ones(len(shut.state), bool)
    states = []
    for k, (name, wanted) in enumerate(zip(shut.states, shut.possible, strict=True)):
        suffix, is_known = ("_open", everywhere) if k == 0 else ("", shut.state == k)
        known = E[f"total{suffix}"].values, E[f"total{suffix}_se"].values
        if name not in coefficients.states:
            remedy = "compute the coefficients of all states"
            raise InputError("coefficients", "state", f"no {name!r}", remedy)
        states.append(State.of(coefficients.states[name], sky, wanted, known, is_known))
    return states
