"""A level of a standard asked of façades of one room: hard outcome and smooth margins.

A margin is how far a quantity lies above its limit, in parts of all points or of the limit's hours:

    m = (value − limit) / 100 %,  or value / limit − 1

There is one for each limit and each space that it is asked of. The standard's own count decides
whether the level is reached; a search only follows the margins.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import spaces_text
from drcmitsuba.case.case import Case
from drcmitsuba.design.facade_groups import FacadeGroups, applied, smooth_applied
from drcmitsuba.metrics import smooth, smooth_step
from drcmitsuba.metrics.evaluate_metrics import rules
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.standards import Evidence, names, read
from drcmitsuba.standards.coverage import check_facing, check_spacing, hours_of
from drcmitsuba.standards.quantities import Counted, count, stamps_needed
from drcmitsuba.standards.standard import Level, Limit, Quantity, Standard
from drcmitsuba.standards.verdict import Margin, Outcome, outcome
from drcmitsuba.standards.year import OF_LIGHT, StandardYear
from drcmitsuba.transport.elements.state_illuminances import Illuminances

ALL_POINTS = 100.0
"""Limit [%] at which the hours of the worst point tell more than the share of the points."""


@dataclass(frozen=True)
class Requirement:
    """A level that a façade has to reach.

    Parameters
    ----------
    standard : Standard
    level : Level
        One of the standard's levels.
    at : np.ndarray of int, shape (counted,)
        Time stamps that the standard counts, from `standards.coverage.hours_of`.
    coordinates : xr.Dataset
        Coordinates `time` of the year, and of the sensors; the attribute `spaces` tells spaces.
    rules : Rules
        Rule of the shade, from `evaluate_metrics.rules`.
    groups : FacadeGroups, optional
        Groups of panes that close one by one; by default one shade closes.
    """

    standard: Standard
    level: Level
    at: np.ndarray
    coordinates: xr.Dataset
    rules: Rules
    groups: FacadeGroups | None = None

    @classmethod
    def of(
        cls, case: Case, name: str, level: str | None, light: Daylight,
        groups: FacadeGroups | None = None,
    ) -> Requirement:  # fmt: skip
        """Level of a standard, by default its lowest one, asked of a case under its daylight.

        Raises
        ------
        InputError
            There is no such standard or level, illuminance does not decide it, or the period or
            the points are not those that it asks for.
        """
        source = case.source
        if name not in names():
            got = f"{shortened(name)} is no standard"
            raise InputError(source, "design.standard", got, choose(name, names()))
        standard = read(name)
        why = standard.undecided
        if standard.hours == "equinox":
            why = "it counts moments of clear days, which no search holds"
        if why is not None or not standard.levels:
            got = f"{name} has no level that a search can reach: {why}"
            raise InputError(source, "design.standard", got, "name another standard")
        levels = {one.name: one for one in standard.levels}
        if level is not None and level not in levels:
            got = f"{shortened(level)} is no level of {name}"
            raise InputError(source, "design.level", got, choose(level, list(levels)))
        asked = standard.levels[0] if level is None else levels[level]
        at = hours_of(standard, light.sky, light.step_hours, source, light.sky)
        sensors = prepared(case).receivers.coordinates
        check_facing(sensors, source)
        check_spacing(standard, sensors, source)
        times = {key: light.sky[key] for key in ("time", "clock")}
        coordinates = sensors.assign_coords(times).assign_attrs(spaces=spaces_text(case))
        return cls(standard, asked, at, coordinates, rules(case, light.step_hours), groups)

    @property
    def title(self) -> str:
        """Standard and level in words."""
        return f"{self.standard.title}: {self.level.name}"

    @property
    def asked(self) -> dict[str, float]:
        """Limits that are higher than the standard's [% or h]."""
        own = next(level for level in self.standard.levels if level.name == self.level.name)
        pairs = zip(self.level.limits, own.limits, strict=True)
        return {mine.quantity: mine.at_least for mine, theirs in pairs if mine != theirs}

    def raised(self, margin: Margin) -> Requirement | None:
        """Requirement whose limit is higher by what a façade lacks; None where it cannot be."""
        limits = {limit.quantity: limit for limit in self.level.limits}
        limit = limits[margin.quantity]
        least, is_share = limit.at_least - margin.distance, self._quantity(limit).of != "mean"
        if margin.distance >= 0 or (is_share and max(least, limit.at_least) >= ALL_POINTS):
            return None
        limits[margin.quantity] = limit.model_copy(update={"at_least": least})
        level = self.level.model_copy(update={"limits": tuple(limits.values())})
        return replace(self, level=level)

    def at_hours(self, hours: np.ndarray, step_hours: float) -> Requirement:
        """Level asked of some time stamps (hour,), each of which stands for so many hours."""
        at = np.flatnonzero(np.isin(hours, self.at))
        groups = None if self.groups is None else self.groups.at(hours)
        coordinates = self.coordinates.isel(time=hours)
        rules = replace(self.rules, step_hours=step_hours)
        return replace(self, at=at, coordinates=coordinates, rules=rules, groups=groups)

    def hard(self, E: Illuminances) -> tuple[Outcome, np.ndarray]:
        """Outcome of the level by the standard's count, and its margins, shape (margin,)."""
        direct = self.coordinates.assign(E=(("time", "sensor"), E.direct.numpy()))["E"]
        total = applied(E, direct, self.rules, self.groups)
        year = self._year(E.open.numpy(), direct.values, total)
        names = dict.fromkeys(limit.quantity for limit in self.level.limits)
        counted = {name: count(self.standard.quantities[name], year) for name in names}
        margins = [
            self._hard_margin(limit, counted[limit.quantity], space)
            for limit, space in self._asked(year)
        ]
        return outcome(self.level, counted, year), np.array(margins)

    def smooth(self, E: Illuminances, sharpness: float) -> list[mi.Float]:
        """Smooth twins of the margins of `hard`, with gradients.

        The twin of the rule of one shade counts all sensors as one grid.
        """
        total, year = E.open, self._dark
        if any(self._quantity(limit).light == "total" for limit in self.level.limits):
            total = smooth_applied(E, self.rules, self.groups, sharpness)
        of_light = {"total": total, "open": E.open, "direct_sun": E.direct}
        margins = []
        for limit, space in self._asked(year):
            sensors = np.flatnonzero(year.space == space) if space is not None else None
            counted = _taken(of_light[self._quantity(limit).light], self.at, sensors)
            area = year.area if sensors is None else year.area[sensors]
            margins.append(self._smooth_margin(limit, counted, area, year, sharpness))
        return margins

    def _quantity(self, limit: Limit) -> Quantity:
        return self.standard.quantities[limit.quantity]

    def _asked(self, year: StandardYear) -> list[tuple[Limit, int | None]]:
        """Limits, each with the index of the space that it is asked of, None for all points."""
        spaces = range(len(year.spaces)) if self.level.scope == "spaces" else (None,)
        return [(limit, space) for limit in self.level.limits for space in spaces]

    @cached_property
    def _dark(self) -> StandardYear:
        """Hours without light, which tell the spaces."""
        sizes = self.coordinates.sizes
        none = np.zeros((sizes["time"], sizes["sensor"]), np.float32)
        return self._year(none, none, none)

    def _year(self, open: np.ndarray, direct: np.ndarray, total: np.ndarray) -> StandardYear:
        """Hours of the standard without errors of E [lx]; `total` has the shade applied."""
        dims = ("time", "sensor")
        of_light = (("total_open", open), ("direct_sun", direct), ("total", total))
        E = {name: (dims, e) for name, e in of_light}
        told = {n: v for n, v in self.coordinates.attrs.items() if n == "spaces"}
        told |= {"step_hours": self.rules.step_hours}
        out = xr.Dataset(E, self.coordinates.coords, told)
        none = np.zeros_like(open)
        out = out.assign({f"{name}_se": (dims, none) for name in OF_LIGHT.values()})
        return StandardYear(Evidence(out, None, None, {}, "light by tile"), self.at)

    def _hard_margin(self, limit: Limit, counted: Counted, space: int | None) -> float:
        if self._quantity(limit).of == "mean":
            hours = counted.value if space is None else counted.by_space[space]
            return float(hours) / limit.at_least - 1
        if limit.at_least == ALL_POINTS:
            own = counted.hours if space is None else counted.hours[counted.of_space(space)]
            return float(own.min()) / counted.needed_hours - 1
        share = counted.value if space is None else counted.by_space[space]
        return (float(share) - limit.at_least) / 100

    def _smooth_margin(
        self, limit: Limit, E: mi.TensorXf, area: np.ndarray, year: StandardYear, sharpness: float
    ) -> mi.Float:
        """Margin by E (counted, sensor) [lx] of sensors that stand for some `area` (sensor,)."""
        quantity, step = self._quantity(limit), self.rules.step_hours
        needed = stamps_needed(quantity, year)
        if quantity.of == "mean":
            E = E * mi.TensorXf((area / area.mean()).astype(np.float32)[None])
            hours = smooth.mean_hours(E, quantity.threshold, step, sharpness=sharpness)
            return hours / limit.at_least - 1
        if limit.at_least == ALL_POINTS:
            hours = smooth.worst_point_hours(E, quantity.threshold, step, sharpness=sharpness)
            return hours / (needed * step) - 1
        stamps = smooth_step.stamps_reached(E, quantity.threshold, sharpness)
        return (smooth_step.share(stamps, needed, sharpness, area) - limit.at_least) / 100


def asked_of(case: Case, light: Daylight, groups: FacadeGroups | None = None) -> Requirement | None:
    """Level that `[design]` asks for; None without a standard. Errors: `Requirement.of`."""
    if case.design is None or case.design.standard is None:
        return None
    return Requirement.of(case, case.design.standard, case.design.level, light, groups)


def _taken(E: mi.TensorXf, at: np.ndarray, sensors: np.ndarray | None) -> mi.TensorXf:
    """E at some time stamps and sensors, by default all sensors, (counted, sensor) [lx]."""
    stamps, count = E.shape
    if len(at) == stamps and sensors is None:
        return E
    columns = np.arange(count) if sensors is None else sensors
    index = np.asarray(at)[:, None] * count + columns
    return mi.TensorXf(dr.gather(mi.Float, E.array, flat_indices(index)), index.shape)
