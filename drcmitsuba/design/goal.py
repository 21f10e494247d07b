"""Objective and constraints of a search for a façade, as `[design]` states them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.measure import NAMES, Aim
from drcmitsuba.design.requirement import Requirement, asked_of
from drcmitsuba.metrics.evaluate_metrics import rules
from drcmitsuba.metrics.intervals.rules import Rules

Minimised = Literal["panes", "film"]


@dataclass(frozen=True)
class LeastArea:
    """Area that is minimised, `of` the panes or the film, where the aim is at least `aim` [%]."""

    of: Minimised
    aim: float


@dataclass(frozen=True)
class Goal:
    """Objective and constraints of a façade; aim, film cost and limit of ASE as in `[design]`.

    Parameters
    ----------
    rules : Rules
        Thresholds of the metrics and of the shade.
    film : str
        Material whose area has a cost.
    window_area : (float, float), optional
        Least and largest area of all panes together [m²], equal if the area is fixed; default: no
        limits.
    least : LeastArea, optional
        Area that is minimised; default: the aim is maximised.
    requirement : Requirement, optional
        Level of a standard whose margin is the aim "standard"; it is reached from 0 on.
    glare_limit : float, optional
        Largest share of the hours with glare at any eye [%]; default: no limit.
    """

    rules: Rules
    film: str
    aim: Aim = "sDA"
    film_cost: float = 0.0
    ase_limit: float | None = None
    window_area: tuple[float, float] | None = None
    least: LeastArea | None = None
    requirement: Requirement | None = None
    glare_limit: float | None = None

    @classmethod
    def of(
        cls, case: Case, year: FacadeYear, film: str, window_area: tuple[float, float] | None,
        of: Minimised,
    ) -> Goal:  # fmt: skip
        """Goal that `[design]` states; its objective "area" is that `of` the panes or the film.

        Errors are those of `Requirement.of`.
        """
        design, least, light = case.design, None, year.daylight
        assert design is not None
        requirement = None if light is None else asked_of(case, light, year.groups)
        if design.objective == "area":
            least = LeastArea(of, 0.0 if design.sda_least is None else design.sda_least)
        cost, limit = design.film_cost, design.ase_limit
        of_case = rules(case, year.step_hours)
        return cls(
            of_case, film, design.aim, cost, limit, window_area, least, requirement,
            design.glare_limit,
        )  # fmt: skip

    def at(self, hours: np.ndarray, step_hours: float) -> Goal:
        """Goal of some time stamps (hour,), each of which stands for so many hours."""
        rules, asked = replace(self.rules, step_hours=step_hours), self.requirement
        asked = None if asked is None else asked.at_hours(hours, step_hours)
        return replace(self, rules=rules, requirement=asked)

    def value(self, aim: Any, film: Any, window: Any) -> Any:
        """Objective [%] of an aim [%], and areas of film and panes over that of the tiles [–]."""
        cost = film * self.film_cost
        if self.least is None:
            return aim - cost
        return (window if self.least.of == "panes" else film) * -100 - cost

    @property
    def title(self) -> str:
        """Objective in words, for pictures."""
        name = NAMES[self.aim] if self.least is None else f"−area of the {self.least.of}"
        return name + (", less the film's cost" if self.film_cost > 0 else "")

    def margin(self, aim: float) -> float | None:
        """Excess of an aim [%] over the least one [%]; None without one."""
        return None if self.least is None else aim - self.least.aim
