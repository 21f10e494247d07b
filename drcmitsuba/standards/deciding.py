"""Points and hours that decide a limit: those nearest to changing it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from drcmitsuba.metrics.intervals.rules import TAIL
from drcmitsuba.standards.quantities import Counted, stamps_needed
from drcmitsuba.standards.standard import Limit, Quantity
from drcmitsuba.standards.year import OF_LIGHT, StandardYear

MOST_POINTS = 20
"""Largest number of points that are listed."""
TINY = 1e-9
"""Difference that counts as a tie: shares by area have errors of rounding."""
FEW = 3
"""Number of months and of hours of the day that are named."""
WORDS = {
    "decides_point": "point",
    "decides_points": "points",
    "decides_h": "h",
    "decides_spare_points": "it would fail if {number} failed",
    "decides_lack_points": "it would hold if {number} more passed",
    "decides_spare_h": "it would fail with {number} less",
    "decides_lack_h": "it would hold with {number} more",
    "decides_nearest_has": "the closest, at x {x} m, y {y} m, z {z} m, has {hours} h to spare",
    "decides_nearest_lacks": "the closest, at x {x} m, y {y} m, z {z} m, lacks {hours} h",
    "decides_open": "{count} of all points are too close to call",
    "decides_dark": "most hours with too little light lie in {months}, and at {hours}",
    "decides_light": "with {factor} times the light it would hold",
    "decides_light_still": "with {factor} times the light it would still hold",
    "decides_months": (
        "January February March April May June July August September October November December"
    ),
}
"""Parts of the sentence on what decides; the report has them in its table of labels."""


@dataclass(frozen=True)
class Deciding:
    """Points and hours that decide a limit of a quantity."""

    quantity: str
    holds: bool
    """Whether the limit holds."""
    count: int
    """Number of points, or of hours, by which it holds or fails; so many would have to change."""
    unit: str
    """Unit of `count`: points or h."""
    points: list[dict[str, Any]]
    """These points, the nearest first, at most 20: `sensor`, `x`, `y`, `z` [m], `grid`, and
    `hours`, how many it has more than needed [h]."""
    undecided: int
    """Number of points that are too close to call."""
    months: list[float]
    """Hours of daylight below the threshold at such a point in each month [h], January first."""
    clock: list[float]
    """The same by the hour of the day [h], 24 values."""
    light: float | None = None
    """Factor of all light with which the limit would just hold, the states of the shade unchanged
    [–]: to first order that of the transmittance of all panes. None for direct sun."""

    def text(self, words: Mapping[str, str] = WORDS) -> str:
        """Sentence for people; `words` are its parts in another language, as `WORDS` has them."""
        held, unit = self.holds, self.unit
        number = words[f"decides_{'point' if self.count == 1 and unit == 'points' else unit}"]
        first = words[f"decides_{'spare' if held else 'lack'}_{unit}"]
        parts = [first.format(number=f"{self.count:,} {number}")]
        if self.points:
            nearest = self.points[0]
            at = {axis: f"{nearest[axis]:.2f}" for axis in "xyz"}
            hours = f"{abs(nearest['hours']):,g}"
            words_of = words["decides_nearest_has" if held else "decides_nearest_lacks"]
            parts.append(words_of.format(**at, hours=hours))
        if self.undecided:
            parts.append(words["decides_open"].format(count=self.undecided))
        if any(self.months):
            names = words["decides_months"].split()
            months = ", ".join(names[i] for i in sorted(_largest(self.months)))
            hours = ", ".join(f"{i}–{i + 1} h" for i in sorted(_largest(self.clock)))
            parts.append(words["decides_dark"].format(months=months, hours=hours))
        if self.light is not None and self.light < 1e3:
            words_of = words["decides_light_still" if held else "decides_light"]
            parts.append(words_of.format(factor=_rounded(self.light)))
        return f"{self.quantity}: {'; '.join(parts)}"


def _rounded(factor: float) -> str:
    """Write a factor with two digits, rounded up so that it suffices."""
    return f"{math.ceil(100 * factor - 1e-6) / 100:.2f}"


def _largest(values: list[float]) -> list[int]:
    """Indices of the few largest values above 0."""
    order = sorted(range(len(values)), key=lambda i: -values[i])[:FEW]
    return [i for i in order if values[i] > 0]


def deciding(
    limit: Limit, quantity: Quantity, counted: Counted, year: StandardYear, space: int | None
) -> Deciding:
    """Find what decides a limit of a quantity.

    Parameters
    ----------
    limit : Limit
    quantity : Quantity
    counted : Counted
        From `quantities.count` of the same quantity and year.
    year : Year
    space : int, optional
        Index of the space that it is asked of; by default all points together.
    """
    value = counted.value if space is None else float(counted.by_space[space])
    holds, needed = value >= limit.at_least - TINY, counted.needed_hours
    if quantity.of == "mean":
        lowest = int(np.argmin(counted.by_space)) if space is None else space
        gap = abs(value - limit.at_least) / year.step_hours
        stamps = math.floor(gap) + 1 if holds else math.ceil(gap)
        E = year.mean(year.illuminance["total_open"].values, lowest)[:, None]
        months, clock = _below(E, quantity.threshold, np.zeros(1, int), year)
        hours = math.ceil(stamps * year.step_hours)
        wanted = max(math.ceil(limit.at_least / year.step_hours), 1)
        factor = quantity.threshold / max(float(np.sort(E[:, 0])[-wanted]), 1e-9)
        return Deciding(limit.quantity, holds, hours, "h", [], 0, months, clock, factor)
    if quantity.of == "moments":
        return _at_moments(limit, counted, value, year, space)
    sensors = np.flatnonzero(year.space >= 0) if space is None else counted.of_space(space)
    margin = counted.hours[sensors] - needed
    share = year.area[sensors] / year.area[sensors].sum()
    nearest = np.argsort(np.where((margin >= 0) == holds, np.abs(margin), np.inf), kind="stable")
    number = _points_to_change(value, limit.at_least, share[nearest])
    chosen = sensors[nearest[:number]]
    E = year.illuminance[OF_LIGHT[quantity.light]].values
    months, clock = _below(E, quantity.threshold, chosen, year)
    p = None if counted.drawn is None else counted.drawn.passing
    undecided = 0 if p is None else int(((p > TAIL) & (p < 1 - TAIL))[sensors].sum())
    listed = [_point(year, s, float(counted.hours[s]) - needed) for s in chosen[:MOST_POINTS]]
    light = None
    if quantity.light != "direct_sun" and limit.at_least:
        # The point that is the last one to be needed decides.
        lasting = year.lasting(quantity.light, stamps_needed(quantity, year))[sensors]
        order = np.argsort(-lasting, kind="stable")
        last = np.searchsorted(np.cumsum(share[order]), limit.at_least / 100 - TINY)
        light = quantity.threshold / max(float(lasting[order[last]]), 1e-9)
    return Deciding(
        limit.quantity, holds, number, "points", listed, undecided, months, clock, light
    )


def _points_to_change(value: float, at_least: float, share: np.ndarray) -> int:
    """Number of points that have to change for a share [%] to cross its limit.

    `share` (point,) is the part of the floor that each stands for [–], those that change first in
    front.
    """
    changed = 100.0 * np.cumsum(share)
    if value >= at_least - TINY:
        return int(np.searchsorted(changed, value - at_least + TINY, side="right")) + 1
    return int(np.searchsorted(changed, at_least - value - TINY)) + 1


def _at_moments(
    limit: Limit, counted: Counted, value: float, year: StandardYear, space: int | None
) -> Deciding:
    """Count the points by which a share at moments holds or fails."""
    sensors = np.flatnonzero(counted.space >= 0) if space is None else counted.of_space(space)
    passes = (counted.hours >= counted.needed_hours)[sensors]
    holds = value >= limit.at_least - TINY
    # The largest ones first: so few points would suffice.
    share = np.sort(year.area[sensors][passes == holds] / year.area[sensors].sum())[::-1]
    number = _points_to_change(value, limit.at_least, share)
    p = None if counted.drawn is None else counted.drawn.passing
    undecided = 0 if p is None else int(((p > TAIL) & (p < 1 - TAIL))[sensors].sum())
    none = [0.0] * 12, [0.0] * 24
    return Deciding(limit.quantity, holds, number, "points", [], undecided, *none)


def _below(
    E: np.ndarray, threshold: float, sensors: np.ndarray, year: StandardYear
) -> tuple[list[float], list[float]]:
    """Hours of daylight below a threshold by month and by hour, mean of some sensors [h]."""
    coords = year.illuminance.coords
    clock = coords["clock" if "clock" in coords else "time"]
    dark = np.count_nonzero(E[:, sensors] < threshold, axis=1) * year.step_hours / len(sensors)
    dark *= year.illuminance["total_open"].values.any(axis=1)
    by_month = np.bincount(clock.dt.month.values - 1, dark, minlength=12)
    by_hour = np.bincount(clock.dt.hour.values, dark, minlength=24)
    return by_month.round(1).tolist(), by_hour.round(1).tolist()


def _point(year: StandardYear, sensor: int, more: float) -> dict[str, Any]:
    """Place of a point, and the hours that it has more than needed."""
    E = year.illuminance
    place = {axis: round(float(E[axis].values[sensor]), 4) for axis in "xyz"}
    grid = {"grid": str(E["grid"].values[sensor])} if "grid" in E.coords else {}
    return {"sensor": int(sensor), **place, **grid, "hours": round(more, 6)}
