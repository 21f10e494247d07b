"""Objective and constraints of a search for a façade, as `[design]` states them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from drcmitsuba.case.design import Design
from drcmitsuba.design.measure import NAMES, Aim
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
    """

    rules: Rules
    film: str
    aim: Aim = "sDA"
    film_cost: float = 0.0
    ase_limit: float | None = None
    window_area: tuple[float, float] | None = None
    least: LeastArea | None = None

    @classmethod
    def of(
        cls, design: Design, rules: Rules, film: str, window_area: tuple[float, float] | None,
        of: Minimised,
    ) -> Goal:  # fmt: skip
        """Goal that `[design]` states; its objective "area" is that `of` the panes or the film."""
        least = None if design.sda_least is None else LeastArea(of, design.sda_least)
        cost, limit = design.film_cost, design.ase_limit
        return cls(rules, film, design.aim, cost, limit, window_area, least)

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
