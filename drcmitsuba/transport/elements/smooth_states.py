"""The smooth twin of a year in states among which surfaces come and go, such as a shelf that turns.

Each set of surfaces has a year of its own, which holds the states that it stands in. Direct sun is
that of the open state, as the rule of shades has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mitsuba as mi
import numpy as np

from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.light import LightByElement
from drcmitsuba.transport.elements.smooth_year import ChangePairs, SmoothYear
from drcmitsuba.transport.elements.state_illuminances import Illuminances, evaluated
from drcmitsuba.transport.elements.straight_pairs import StraightPairs


@dataclass(frozen=True)
class SmoothStates:
    """Years of a façade beside each set of its surfaces; named as `SmoothYear`."""

    years: tuple[SmoothYear, ...]
    """Year beside each set, that of the open state first."""
    place: tuple[tuple[int, int], ...]
    """Year of every state, and its number there; the open state is in the first year alone."""

    @classmethod
    def of(
        cls, lights: Sequence[LightByElement], daylight: Daylight, is_open: np.ndarray,
        closings: Sequence[np.ndarray], group: np.ndarray | None = None,
    ) -> SmoothStates:  # fmt: skip
        """Put light by element under the daylight of a case.

        Parameters
        ----------
        lights : sequence of LightByElement
            Light beside the surfaces of every state, the open one first.
        daylight, is_open, closings, group
            As for `SmoothYear.of`, which raises the errors.
        """
        first = lights[0]
        sets = {id(first): first} | {id(light): light for light in lights}
        closed: dict[int, list[np.ndarray]] = {each: [] for each in sets}
        place = [(0, 0)]
        for light, closing in zip(lights[1:], closings, strict=True):
            closed[id(light)].append(closing)
            number = len(closed[id(light)]) - (light is not first)
            place.append(([*sets].index(id(light)), number))
        years = tuple(
            SmoothYear.of(light, daylight, is_open, closed[each], group if light is first else None)
            for each, light in sets.items()
        )
        return cls(years, tuple(place))

    @property
    def months(self) -> np.ndarray:
        """Month of each time stamp, 1 to 12, int, shape (time,)."""
        return self.years[0].months

    @property
    def step_hours(self) -> float:
        """Duration of a time step [h]."""
        return self.years[0].step_hours

    def at(self, hours: np.ndarray) -> SmoothStates:
        """Years of some time stamps (hour,), as `SmoothYear.at`."""
        return replace(self, years=tuple(year.at(hours) for year in self.years))

    def illuminance(self, shares: mi.Float, factors: mi.Float) -> Illuminances:
        """Illuminance by shares of elements, as `SmoothYear.illuminance`."""
        first, *others = self.years
        by_year = [first.states(shares, factors)]
        by_year += [year.states(shares, factors, first=1) for year in others]
        states = [by_year[year][number] for year, number in self.place]
        return evaluated(states, first.straight_light(shares, factors))

    def straight_sun(self, weighed: Callable[[StraightPairs], mi.Float]) -> list[mi.TensorXf]:
        """E by straight sun [lx], as `SmoothYear.straight_sun`."""
        return self.years[0].straight_sun(weighed)

    def with_straight(self, change: ChangePairs) -> SmoothStates:
        """Years with other pairs of straight light, as `SmoothYear.with_straight`."""
        first, *others = self.years
        return replace(self, years=(first.with_straight(change), *others))
