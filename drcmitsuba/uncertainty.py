"""How far chance moves the metrics: draws of sDA, ASE and the shade from the replicates of E.

Illuminance that scatters (sky, ground, all that is interreflected) has n independent replicates.
A draw is a multiplier bootstrap of their mean [1]_,

    E* = Ē + q Σ_r w_r (E_r − Ē) / √(n (n − 1)),   w_r normal, q² = (n − 1) / χ²_{n−1},

with the same w and q for all sensors and hours: what shares gather paths and cells moves together,
and every single entry has Student's t with n − 1 degrees of freedom around its mean. So the 95 %
interval of an entry of E is ± `t_factor(n)` · se.

Direct sun is drawn anew for every sensor and sun, and most of it is certain: seen or not seen. At
the edge of a shadow, a mean μ with standard error s is worth κ = (μ/s)² rays that saw the sun; the
sun that is seen is then Gamma distributed, E* = s²/μ · Γ(κ + 2/3). The 2/3 is the prior of the part
of a disk that a straight edge leaves: for a small part a the edge is a^(2/3) deep in the disk. By
the same prior some pairs without a hit hide a small part: as many as `hidden_share` tells.

References
----------
.. [1] A. W. van der Vaart, J. A. Wellner, "Weak convergence and empirical processes", 1996, 2.9.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.special import gammaincc, stdtrit

from drcmitsuba import accumulate, metrics
from drcmitsuba.case import Metrics
from drcmitsuba.schema import luminance

DRAWS = 600
"""Draws of every metric."""
LEVEL = 0.95
"""Of the intervals."""
BEYOND = 2.5e-4
"""Entries that pass a threshold with less than this probability are taken not to."""
EDGE = 2 / 3
"""Beta prior of the part of the sun that is seen, on the edge of a shadow: B(2/3, 2/3)."""
BLOCK = 64
"""Sensors whose replicates are in memory at once."""


def t_factor(replicates: int, level: float = LEVEL) -> float:
    """Half the width of an interval of E in standard errors: Student's t(1/2 + level/2, n − 1)."""
    return float(stdtrit(replicates - 1, 0.5 + level / 2))


@dataclass(frozen=True)
class Rules:
    """What the metrics ask for.

    Parameters
    ----------
    metrics : Metrics
        Thresholds of sDA and ASE.
    shade_threshold, shade_area : float
        When the shade closes: share of the sensors with at least so much direct sun [lx].
    step_hours : float
        Length of the intervals [h].
    """

    metrics: Metrics
    shade_threshold: float
    shade_area: float
    step_hours: float


def hidden_share(rays: int) -> float:
    """Pairs on the edge of a shadow without a hit, for each that has hits and misses.

    A Beta(2/3, 2/3) part of the sun is missed by all `rays` with
    p = B(2/3, rays + 2/3) / B(2/3, 2/3), and likewise seen by all.
    """
    g = math.lgamma
    p = math.exp(g(rays + EDGE) + g(2 * EDGE) - g(rays + 2 * EDGE) - g(EDGE))
    return p / (1 - 2 * p)


def _exceeds(mean: np.ndarray, error: np.ndarray, threshold: float) -> np.ndarray:
    """Probability that direct sun reaches a threshold; of entries with hits."""
    p = (mean >= threshold).astype(float)
    doubtful = (abs(mean - threshold) < 8 * error) | ((mean < 7 * error) & (mean > 0))
    mu, s = mean[doubtful].astype(float), error[doubtful].astype(float)
    kappa = (mu / s) ** 2
    p[doubtful] = gammaincc(kappa + EDGE, threshold * mu / s**2)
    return p


@dataclass(frozen=True)
class Closures:
    """When the shade closes.

    Parameters
    ----------
    closed : np.ndarray of bool, shape (time,)
        By the mean of the direct sun.
    hours : np.ndarray, shape (hour,)
        Time stamps that close in some draws only.
    drawn : np.ndarray of bool, shape (hour, draw)
    """

    closed: np.ndarray
    hours: np.ndarray
    drawn: np.ndarray

    @classmethod
    def never(cls, stamps: int) -> Closures:
        """No shade, or one that stays open."""
        none = np.zeros(0, np.int64)
        return cls(np.zeros(stamps, bool), none, np.zeros((0, DRAWS), bool))

    def shares(self, month: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shares of the hours with the shade closed [%]: (draw,) and (month, draw).

        `month` (time,) counts from 0.
        """
        sure = self.closed.copy()
        sure[self.hours] = False
        stamps = np.bincount(month, minlength=12)[:, None]
        counts = np.repeat(np.bincount(month[sure], minlength=12)[:, None], DRAWS, axis=1)
        np.add.at(counts, month[self.hours], self.drawn)
        with np.errstate(invalid="ignore"):
            monthly = 100.0 * counts / stamps
        return 100.0 * counts.sum(axis=0) / len(month), monthly

    @property
    def possible(self) -> np.ndarray:
        """Time stamps that close in some draw, shape (time,)."""
        out = self.closed.copy()
        out[self.hours] = True
        return out


@dataclass(frozen=True)
class SunDraws:
    """Which entries of the direct sun are in doubt, and whether they reach the thresholds.

    Parameters
    ----------
    time, sensor : np.ndarray, shape (entry,)
    exposed, closing : np.ndarray of bool, shape (entry, draw)
        Whether they reach the threshold of ASE, of the shade.
    """

    time: np.ndarray
    sensor: np.ndarray
    exposed: np.ndarray
    closing: np.ndarray


def draw_sun(
    mean: np.ndarray, error: np.ndarray, limits: tuple[float, float], rays: int, seed: int
) -> SunDraws:
    """Draw the direct sun near its thresholds.

    Parameters
    ----------
    mean, error : np.ndarray, shape (time, sensor)
        Direct sun and its standard error [lx].
    limits : (float, float)
        Thresholds of ASE and of the shade [lx].
    rays : int
        Directions that were drawn from the disk of every sun, in all replicates.
    seed : int

    Returns
    -------
    SunDraws
    """
    rng = np.random.default_rng([seed, 1])
    lit = np.nonzero(mean > 0)
    mu, s = mean[lit], error[lit]
    p = np.stack([_exceeds(mu, s, limit) for limit in limits])
    near = ((p > BEYOND) & (p < 1 - BEYOND)).any(axis=0)
    time, sensor, p = lit[0][near], lit[1][near], p[:, near]
    u = rng.random((len(time), DRAWS), np.float32)
    exposed, closing = (u < row[:, None] for row in p)
    # One miss makes s = μ / rays; the height of the sun within its disk makes far less of it.
    edges = int((mu < 1.2 * rays * s).sum())
    found = _hidden(mean, limits, rays, edges, rng)
    if found is not None:
        hidden_time, hidden_sensor, hidden = found
        time, sensor = np.append(time, hidden_time), np.append(sensor, hidden_sensor)
        exposed, closing = (
            np.vstack(pair) for pair in zip((exposed, closing), hidden, strict=True)
        )
    return SunDraws(time, sensor, exposed, closing)


def _hidden(
    mean: np.ndarray, limits: tuple[float, float], rays: int, edges: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]] | None:  # fmt: skip
    """Draw pairs without a hit that hide a part of the sun: any that are dark in a sunny hour."""
    dark = np.argwhere((mean == 0) & (mean > 0).any(axis=1, keepdims=True))
    expected = edges * hidden_share(rays)
    if len(dark) == 0 or expected == 0:
        return None
    full = mean.max(axis=1)
    # The part that a pair hides is drawn by its tail: u < p(limit), as for the others.
    tails = [gammaincc(EDGE, limit * rays / np.maximum(full, 1e-9)) for limit in limits]
    most = np.maximum(*tails)[dark[:, 0]]
    total = np.cumsum(most)
    counts = rng.poisson(expected * total[-1] / len(dark), DRAWS)
    if counts.sum() == 0:
        return None
    picked = np.searchsorted(total, rng.random(counts.sum()) * total[-1])
    in_draw = np.repeat(np.arange(DRAWS), counts)
    u = rng.random(len(picked)) * most[picked]
    entries, row = np.unique(picked, return_inverse=True)
    passed = []
    for tail in tails:
        out = np.zeros((len(entries), DRAWS), bool)
        out[row, in_draw] = u < tail[dark[picked, 0]]
        passed.append(out)
    return dark[entries, 0], dark[entries, 1], (passed[0], passed[1])


def draw_closures(mean: np.ndarray, sun: SunDraws, rules: Rules) -> Closures:
    """Draw when the shade closes: where ≥ area of the sensors reach its threshold.

    Parameters
    ----------
    mean : np.ndarray, shape (time, sensor)
        Direct sun [lx].
    sun : SunDraws
    rules : Rules
    """
    least = metrics.closing_sensors(rules.shade_area, mean.shape[1])
    passes = mean >= rules.shade_threshold
    count = np.count_nonzero(passes, axis=1)
    sure = count - np.bincount(sun.time, passes[sun.time, sun.sensor], len(mean)).astype(int)
    doubtful = np.bincount(sun.time, minlength=len(mean))
    hours = np.flatnonzero((sure < least) & (sure + doubtful >= least))
    drawn = np.empty((len(hours), DRAWS), bool)
    for i, hour in enumerate(hours):
        drawn[i] = sure[hour] + sun.closing[sun.time == hour].sum(axis=0) >= least
    varies = drawn.any(axis=1) != drawn.all(axis=1)
    varies |= drawn[:, 0] != (count[hours] >= least)
    return Closures(count >= least, hours[varies], drawn[varies])


@dataclass(frozen=True)
class Draws:
    """Draws of the metrics [%], and how likely each sensor passes.

    Parameters
    ----------
    annual : dict of np.ndarray, shape (draw,)
        `sDA`, `ASE`, `shade_closed`.
    monthly : dict of np.ndarray, shape (month, draw)
        `msDA`, `MSE`, `shade_closed_monthly`, January first; NaN for a month without hours.
    passing : dict of np.ndarray, shape (sensor,)
        `sDA`, `ASE`: share of the draws in which a sensor counts, 0 to 1.
    """

    annual: dict[str, np.ndarray]
    monthly: dict[str, np.ndarray]
    passing: dict[str, np.ndarray]


@dataclass(frozen=True)
class _Needed:
    """Time stamps that a sensor has to pass, in each month and in the year; months from 0."""

    month: np.ndarray
    monthly: np.ndarray
    yearly: int

    @property
    def empty(self) -> np.ndarray:
        """Months without time stamps, shape (month,)."""
        return np.bincount(self.month, minlength=12) == 0

    def count(self, passed: np.ndarray) -> np.ndarray:
        """Count by month: (time, sensor) to (sensor, month)."""
        out = np.zeros((passed.shape[1], 12), np.int64)
        for m in np.flatnonzero(~self.empty):
            out[:, m] = np.count_nonzero(passed[self.month == m], axis=0)
        return out


class _Tally:
    """Counts, for every draw, the sensors that pass; most are the same in all draws."""

    def __init__(self, needed: _Needed, sure: np.ndarray, doubtful: np.ndarray) -> None:
        """Begin with the certain entries and the number of doubtful ones, (sensor, month)."""
        self.needed, self.sure = needed, sure
        of_year = sure.sum(axis=1)
        self.monthly = np.repeat((sure >= needed.monthly).sum(axis=0)[:, None], DRAWS, axis=1)
        self.yearly = np.full(DRAWS, (of_year >= needed.yearly).sum())
        self.passing = (of_year >= needed.yearly).astype(float)
        self.open_months = (sure < needed.monthly) & (sure + doubtful >= needed.monthly)
        self.open_year = (of_year < needed.yearly) & (
            of_year + doubtful.sum(axis=1) >= needed.yearly
        )

    @property
    def sensors(self) -> np.ndarray:
        """Sensors that do not pass or fail for certain."""
        return np.flatnonzero(self.open_year | self.open_months.any(axis=1))

    def wanted(self, sensor: int, time: np.ndarray) -> np.ndarray:
        """Which of the doubtful time stamps of a sensor have to be drawn."""
        if self.open_year[sensor]:
            return time
        return time[self.open_months[sensor, self.needed.month[time]]]

    def add(self, sensor: int, time: np.ndarray, passed: np.ndarray) -> None:
        """Add the draws of a sensor's wanted time stamps, (entry, draw)."""
        counts = np.repeat(self.sure[sensor][:, None], DRAWS, axis=1)
        month = self.needed.month[time]
        order = np.argsort(month, kind="stable")
        month, starts = np.unique(month[order], return_index=True)
        if len(starts):
            counts[month] += np.add.reduceat(passed[order], starts, axis=0, dtype=np.int64)
        # An open month or year began as not passed.
        of_month = self.open_months[sensor]
        self.monthly[of_month] += counts[of_month] >= self.needed.monthly[of_month][:, None]
        if self.open_year[sensor]:
            passes = counts.sum(axis=0) >= self.needed.yearly
            self.yearly += passes
            self.passing[sensor] = passes.mean()

    def shares(self) -> tuple[np.ndarray, np.ndarray]:
        """Shares of the sensors [%]: of the year (draw,), by month (month, draw)."""
        monthly = 100.0 * self.monthly / len(self.sure)
        monthly[self.needed.empty] = np.nan
        return 100.0 * self.yearly / len(self.sure), monthly


def _exposure(mean: np.ndarray, sun: SunDraws, threshold: float, needed: _Needed) -> _Tally:
    """Draw ASE and MSE."""
    drawn = np.zeros(mean.shape, bool)
    drawn[sun.time, sun.sensor] = True
    tally = _Tally(needed, needed.count((mean >= threshold) & ~drawn), needed.count(drawn))
    for sensor in tally.sensors:
        entries = np.flatnonzero(sun.sensor == sensor)
        time = tally.wanted(sensor, sun.time[entries])
        kept = entries[np.isin(sun.time[entries], time)]
        tally.add(sensor, sun.time[kept], sun.exposed[kept])
    return tally


def multipliers(replicates: int, seed: int) -> np.ndarray:
    """Weights q·w / √(n (n − 1)) of the replicates in every draw, shape (replicate, draw)."""
    rng = np.random.default_rng([seed, 2])
    n = replicates
    w = rng.standard_normal((n, DRAWS))
    q = np.sqrt((n - 1) / rng.chisquare(n - 1, DRAWS))
    return (q * w / math.sqrt(n * (n - 1))).astype(np.float32)


@dataclass(frozen=True)
class _State:
    """Illuminance of one state of the shade, at the hours that it is wanted for.

    Parameters
    ----------
    coefficients : xr.Dataset
    sky : xr.Dataset
        Of the wanted time stamps, the rows.
    row : np.ndarray, shape (time,)
        Row of every time stamp, −1 where the state is not wanted.
    mean, error : np.ndarray, shape (row, sensor)
    """

    coefficients: xr.Dataset
    sky: xr.Dataset
    row: np.ndarray
    mean: np.ndarray
    error: np.ndarray

    @classmethod
    def of(
        cls, coefficients: xr.Dataset, sky: xr.Dataset, wanted: np.ndarray,
        known: tuple[np.ndarray, np.ndarray], is_known: np.ndarray,
    ) -> _State:  # fmt: skip
        """Take mean and error (time, sensor) where they are known, and accumulate the rest."""
        mean, error = (a.copy() for a in known)
        rest = np.flatnonzero(wanted & ~is_known)
        if len(rest):
            found = accumulate.by_source(coefficients, sky.isel(time=rest))
            mean[rest], error[rest] = found["total"].values, found["total_se"].values
        row = np.where(wanted, np.cumsum(wanted) - 1, -1)
        part = sky.isel(time=np.flatnonzero(wanted))
        return cls(coefficients, part, row, mean[wanted], error[wanted])

    def classes(self, threshold: float, beyond: float) -> tuple[np.ndarray, np.ndarray]:
        """Entries that pass for certain, and those that may pass, (time, sensor)."""
        reach = beyond * self.error
        nothing = np.zeros((1, self.mean.shape[1]), bool)  # row −1
        sure = np.concatenate([self.mean - reach >= threshold, nothing])
        may = np.concatenate([self.mean + reach >= threshold, nothing])
        return sure[self.row], may[self.row]

    def replicates(self, sensors: np.ndarray) -> np.ndarray:
        """Replicates of the rows at some sensors, (replicate, row, sensor)."""
        return accumulate.replicates(self.coefficients, self.sky, sensors)

    def passes(
        self, replicates: np.ndarray, time: np.ndarray, weights: np.ndarray, threshold: float
    ) -> np.ndarray:
        """Whether E* ≥ threshold, (entry, draw), from one sensor's replicates (replicate, row)."""
        E = replicates[:, self.row[time]]
        mean = E.mean(axis=0)
        return (E - mean).T @ weights >= (threshold - mean)[:, None]


def _autonomy(
    is_open: _State, shaded: _State | None, closures: Closures, threshold: float, needed: _Needed,
    weights: np.ndarray,
) -> _Tally:  # fmt: skip
    """Draw sDA and msDA; an hour takes the state that its closure was drawn to."""
    beyond = t_factor(len(weights), 1 - 2 * BEYOND)
    sure, may = is_open.classes(threshold, beyond)
    if shaded is not None:
        sure_shaded, may_shaded = shaded.classes(threshold, beyond)
        shut, varies = closures.closed[:, None], np.zeros((len(sure), 1), bool)
        varies[closures.hours] = True
        sure = np.where(varies, sure & sure_shaded, np.where(shut, sure_shaded, sure))
        may = np.where(varies, may | may_shaded, np.where(shut, may_shaded, may))
    doubtful = may & ~sure
    tally = _Tally(needed, needed.count(sure), needed.count(doubtful))
    hour = np.full(len(sure), -1)  # the last row of `closes`, which no time stamp uses
    hour[closures.hours] = np.arange(len(closures.hours))
    closes = np.concatenate([closures.drawn, np.zeros((1, DRAWS), bool)])
    for start in range(0, len(tally.sensors), BLOCK):
        block = tally.sensors[start : start + BLOCK]
        E_open = is_open.replicates(block)
        E_shaded = None if shaded is None else shaded.replicates(block)
        for i, sensor in enumerate(block):
            time = tally.wanted(sensor, np.flatnonzero(doubtful[:, sensor]))
            at, shut = hour[time], closures.closed[time]
            passed = np.empty((len(time), DRAWS), bool)
            one = (at >= 0) | ~shut
            passed[one] = is_open.passes(E_open[:, :, i], time[one], weights, threshold)
            if shaded is not None and E_shaded is not None:
                other = (at >= 0) | shut
                behind = np.empty_like(passed)
                behind[other] = shaded.passes(E_shaded[:, :, i], time[other], weights, threshold)
                closed = np.where((at >= 0)[:, None], closes[at], shut[:, None])
                passed = np.where(closed, behind, passed)
            tally.add(sensor, time, passed)
    return tally


def closures(direct: xr.Dataset, rules: Rules, rays: int, seed: int) -> Closures:
    """Draw when the shade closes.

    Parameters
    ----------
    direct : xr.Dataset
        `direct_sun`, `direct_sun_se` (time, sensor) [lx], of luminance.
    rules : Rules
    rays : int
        Directions that were drawn from the disk of every sun, in all replicates.
    seed : int

    Returns
    -------
    Closures
    """
    mean, error = (direct[name].values for name in ("direct_sun", "direct_sun_se"))
    limits = rules.metrics.ase_threshold, rules.shade_threshold
    return draw_closures(mean, draw_sun(mean, error, limits, rays, seed), rules)


def draw(
    coefficients: xr.Dataset, sky: xr.Dataset, illuminance: xr.Dataset, rules: Rules, *,
    rays: int, seed: int,
) -> Draws:  # fmt: skip
    """Draw all metrics.

    Parameters
    ----------
    coefficients : xr.Dataset
        Of all states: `replicates` (state, replicate, sensor, bin) [sr], luminance or by channel.
    sky : xr.Dataset
        From `sky.radiance`.
    illuminance : xr.Dataset
        From `accumulate.illuminance`, of the same coefficients and sky; attribute `has_shade`.
    rules : Rules
    rays : int
        Directions that were drawn from the disk of every sun, in all replicates.
    seed : int
        The same seed, the same draws.

    Returns
    -------
    Draws
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
    of_ase = [metrics.exposed(t.ase_hours, rules.step_hours, n, len(mean)) for n in stamps]
    exposure = _exposure(
        mean, sun, t.ase_threshold,
        _Needed(month, np.array(of_ase), metrics.exposed(t.ase_hours, rules.step_hours)),
    )  # fmt: skip
    by_luminance = coefficients.assign(replicates=luminance(coefficients["replicates"]))
    weights = multipliers(coefficients.sizes["replicate"], seed)
    of_sda = [metrics.autonomous(t.sda_fraction, n) for n in stamps]
    needed = _Needed(month, np.array(of_sda), metrics.autonomous(t.sda_fraction, len(mean)))
    states = _states(by_luminance, sky, E, shut)
    autonomy = _autonomy(*states, shut, t.sda_threshold, needed, weights)
    (sda, msda), (ase, mse) = autonomy.shares(), exposure.shares()
    closed, closed_monthly = shut.shares(month)
    return Draws(
        {"sDA": sda, "ASE": ase, "shade_closed": closed},
        {"msDA": msda, "MSE": mse, "shade_closed_monthly": closed_monthly},
        {"sDA": autonomy.passing, "ASE": exposure.passing},
    )


def _states(
    coefficients: xr.Dataset, sky: xr.Dataset, E: Mapping[Hashable, xr.DataArray], shut: Closures
) -> tuple[_State, _State | None]:
    """Illuminance of both states at the hours that they are wanted for."""
    varies = np.zeros(len(shut.closed), bool)
    varies[shut.hours] = True
    wanted = ~shut.closed | varies
    everywhere = np.ones_like(wanted)
    known = E["total_open"].values, E["total_open_se"].values
    is_open = _State.of(coefficients.sel(state="open", drop=True), sky, wanted, known, everywhere)
    if not shut.possible.any():
        return is_open, None
    known = E["total"].values, E["total_se"].values
    behind = coefficients.sel(state="shaded", drop=True)
    return is_open, _State.of(behind, sky, shut.possible, known, shut.closed)
