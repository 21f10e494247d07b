"""Quantities of standards, counted from E, and where they stand in every draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics import Interval, thresholds
from drcmitsuba.metrics.intervals import t_factor
from drcmitsuba.metrics.intervals.autonomy import ENTRIES, State, multipliers
from drcmitsuba.metrics.intervals.rules import BEYOND, DRAWS, TAIL
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.schema import by_luminance
from drcmitsuba.standards.coverage import MOMENTS
from drcmitsuba.standards.standard import Quantity
from drcmitsuba.standards.year import OF_LIGHT, StandardYear

SENSORS = 1024
"""Number of sensors whose moments are drawn at once."""
OF_MEAN = ("replicates", "sun_straight", "sun_straight_se", "mesh_error")
"""Coefficients that the mean of a space's points follows from."""


@dataclass(frozen=True)
class DrawnQuantity:
    """Draws of a quantity."""

    all: np.ndarray
    """Values of all points together [% or h], shape (draw,)."""
    by_space: np.ndarray
    """Values of every space by itself [% or h], shape (space, draw)."""
    passing: np.ndarray | None
    """Probability that each point counts, shape (sensor,)."""


@dataclass(frozen=True)
class Counted:
    """A quantity of a standard."""

    unit: str
    value: float
    """Value of all points together; hours are those of the space with the fewest [% or h]."""
    by_space: np.ndarray
    """Value of every space by itself [% or h], shape (space,)."""
    hours: np.ndarray
    """Hours of the threshold at each point, or in the mean of each space [h], (point or space,)."""
    drawn: DrawnQuantity | None
    """Draws; None without replicates."""
    bounds: tuple[float, float]
    """Where it stands with all errors of E in one direction, and in the other [% or h]."""
    mirrored: bool
    """Whether the draws hold the noise of the value twice, as those of sDA do."""
    needed_hours: float
    """Hours of the threshold that each point needs [h]."""
    space: np.ndarray
    """Index of the space that each of `hours` belongs to, int, (point or space,)."""

    def of_space(self, space: int) -> np.ndarray:
        """Points of a space, indices."""
        return np.flatnonzero(self.space == space)

    @property
    def interval(self) -> Interval:
        """95 % interval, which holds the value; without draws, the bounds."""
        ends = list(self.bounds)
        if self.drawn is not None:
            low = float(np.quantile(self.drawn.all, TAIL, method="lower"))
            high = float(np.quantile(self.drawn.all, 1 - TAIL, method="higher"))
            ends = [low, high]
            if self.mirrored:
                ends += [2 * self.value - low, 2 * self.value - high]
        low, high = min(self.value, *ends), max(self.value, *ends)
        return Interval(self.value, max(0.0, low), min(high, 100.0) if self.unit == "%" else high)

    def both_ways(self, by_space: bool) -> list[np.ndarray]:
        """Draws, and their mirror images about the value where they are due, else the same again.

        Shape (1, draw) of all points, or (space, draw).
        """
        assert self.drawn is not None
        drawn = self.drawn.by_space if by_space else self.drawn.all[None]
        value = self.by_space[:, None] if by_space else np.array([[self.value]])
        return [drawn, 2 * value - drawn if self.mirrored else drawn]


def stamps_needed(quantity: Quantity, year: StandardYear) -> int:
    """Number of time stamps in which a quantity asks for its threshold."""
    if quantity.fraction is not None:
        return metrics.autonomy_stamps(quantity.fraction, len(year.at))
    return metrics.exposure_stamps(quantity.hours or 0.0, year.step_hours)


def count(quantity: Quantity, year: StandardYear) -> Counted:
    """Count a quantity in E and in every draw.

    Raises
    ------
    InputError
        E is not finite, or a state of the façade is missing in C.
    """
    ways = {"mean": _mean_hours, "moments": _moments, "points": _points}
    return ways[quantity.of](quantity, year)


def _points(quantity: Quantity, year: StandardYear) -> Counted:
    """Share of the floor whose points reach the threshold for long enough [%]."""
    name, limit = OF_LIGHT[quantity.light], quantity.threshold
    required = stamps_needed(quantity, year)
    E = thresholds.checked(year.illuminance[name], name)
    stamps = thresholds.stamps_reached(E, limit)
    value, by_space = year.share(stamps >= required)
    drawn, bounds = None, (value, value)
    if year.can_draw(quantity.light):
        tally = year.tally(quantity.light, limit, required)
        drawn = DrawnQuantity(*year.drawn_shares(tally), tally.passing)
    else:
        half = _factor(year) * year.illuminance[f"{name}_se"].values
        low, high = (thresholds.stamps_reached(end, limit) for end in (E - half, E + half))
        bounds = year.share(low >= required)[0], year.share(high >= required)[0]
    is_sun = quantity.light == "direct_sun"
    hours = stamps * year.step_hours
    needed = required * year.step_hours
    return Counted("%", value, by_space, hours, drawn, bounds, not is_sun, needed, year.space)


def _moments(quantity: Quantity, year: StandardYear) -> Counted:
    """Share of the floor whose points lie within limits at every moment [%], E a mean of days."""
    low, high = quantity.threshold, quantity.at_most or np.inf
    E, half = (of_moments(year.illuminance[f"total_open{suffix}"].values) for suffix in ("", "_se"))
    thresholds.checked(year.illuminance["total_open"], "total_open")
    half = half * _factor(year)
    within = (low <= E) & (high >= E)
    held = np.asarray(np.all(within, axis=0))
    sure = np.all((E - half >= low) & (E + half <= high), axis=0)
    may = np.all((E + half >= low) & (E - half <= high), axis=0)
    drawn, bounds = None, (year.share(np.asarray(sure))[0], year.share(np.asarray(may))[0])
    if year.can_draw(quantity.light):
        by_space, passing = _drawn_moments(year, low, high)
        areas = year.space_areas
        drawn = DrawnQuantity(areas @ by_space / areas.sum(), by_space, passing)
    value, by_space = year.share(held)
    hours = np.count_nonzero(within, axis=0) * year.step_hours
    needed = len(MOMENTS) * year.step_hours
    return Counted("%", value, by_space, hours, drawn, bounds, True, needed, year.space)


def of_moments(E: np.ndarray) -> np.ndarray:
    """Mean over the days, (moment, …), of values at the stamps of `clearest_hours` (time, …)."""
    return np.asarray(E.reshape(len(MOMENTS), -1, *E.shape[1:]).mean(axis=1, dtype=float))


def _drawn_moments(year: StandardYear, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Share of a space's floor within limits [%], (space, draw), and of the draws, (sensor,)."""
    state, areas = year.open_state, year.space_areas
    assert year.replicates is not None
    stamps = len(year.at)
    drawn = multipliers(year.replicates[0].open.sizes["replicate"], year.evidence.drawing["seed"])
    count, passing = np.zeros((len(areas), DRAWS)), np.empty(len(year.space))
    with one_blas_thread():  # as in `draw_autonomy`
        for start in range(0, len(year.space), SENSORS):
            sensors = np.arange(start, min(start + SENSORS, len(year.space)))
            time, sensor = (
                a.ravel() for a in np.meshgrid(np.arange(stamps), sensors, indexing="ij")
            )
            E = state.doubts(time, sensor, 0.0, drawn).above()
            E = of_moments(E.reshape(stamps, len(sensors), DRAWS))
            held = ((low <= E) & (high >= E)).all(axis=0)
            np.add.at(count, year.space[sensors], year.area[sensors, None] * held)
            passing[sensors] = held.mean(axis=1)
    return 100.0 * count / areas[:, None], passing


def _mean_hours(quantity: Quantity, year: StandardYear) -> Counted:
    """Hours in which the mean of each space's points reaches the threshold, shade open [h]."""
    limit, step, spaces = quantity.threshold, year.step_hours, range(len(year.spaces))
    mean, error = (
        np.stack([year.mean(E, space) for space in spaces])
        for E in (year.illuminance[f"total_open{suffix}"].values for suffix in ("", "_se"))
    )
    hours, low, high = (
        step * np.count_nonzero(mean + f * error >= limit, axis=1)
        for f in (0, -_factor(year), _factor(year))
    )
    drawn = None
    if year.can_draw(quantity.light):
        by_space = step * _drawn_means(year, limit)
        drawn = DrawnQuantity(by_space.min(axis=0), by_space, None)
    bounds = float(low.min()), float(high.min())
    each, needed = np.arange(len(spaces)), stamps_needed(quantity, year) * step
    return Counted("h", float(hours.min()), hours, hours, drawn, bounds, True, needed, each)


def _drawn_means(year: StandardYear, limit: float) -> np.ndarray:
    """Time stamps at which the mean of each space reaches a limit, int, (space, draw)."""
    assert year.replicates is not None
    C, sky = year.replicates
    is_open = by_luminance(C.open[[name for name in OF_MEAN if name in C.open]])
    spaces = year.spaces.values()
    area = xr.DataArray(year.area, dims="sensor")
    parts = [
        is_open.isel(sensor=s).weighted(area.isel(sensor=s)).mean("sensor", skipna=False)
        for s in spaces
    ]
    means = xr.concat(parts, "sensor", coords="minimal", compat="override").map(
        lambda v: v.transpose("replicate", "sensor", ..., missing_dims="ignore")
    )
    every = np.ones(len(year.at), bool)
    unknown = np.zeros((len(year.at), len(parts)), np.float32)
    state = State.of(means, sky, every, (unknown, unknown), ~every)
    drawn = multipliers(C.open.sizes["replicate"], year.evidence.drawing["seed"])
    sure, may = state.classes(limit, t_factor(len(drawn.replicates), 1 - 2 * BEYOND))
    out = np.repeat(np.count_nonzero(sure, axis=0)[:, None], DRAWS, axis=1)
    with one_blas_thread():  # as in `draw_autonomy`
        space, time = np.nonzero((may & ~sure).T)
        doubts = state.doubts(time, space, limit, drawn)
        for start in range(0, len(time), ENTRIES):
            few = slice(start, start + ENTRIES)
            np.add.at(out, space[few], doubts.some(few).passes())
    return out


def _factor(year: StandardYear) -> float:
    """Standard errors of E in half of its interval."""
    return float(year.illuminance.attrs.get("interval_factor", 1.96))
