"""Verdicts: which level of a standard is reached, by what margin, and how sure that is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from drcmitsuba.case.shading import AREA, THRESHOLD
from drcmitsuba.metrics import Interval
from drcmitsuba.metrics.watched_groups import spaces_of_groups
from drcmitsuba.standards.coverage import clearest_days
from drcmitsuba.standards.deciding import Deciding, deciding
from drcmitsuba.standards.quantities import Counted
from drcmitsuba.standards.standard import Level, Limit, Standard
from drcmitsuba.standards.year import StandardYear

MOST_NAMES = 3
"""Number of spaces up to which a duty names them all."""
TINY = 1e-9
"""Difference that counts as a tie: mirror images of shares have errors of rounding."""


@dataclass(frozen=True)
class Margin:
    """How far a quantity is from its limit."""

    quantity: str
    value: float
    limit: float
    """Value of the quantity, and where its limit lies [unit]."""
    unit: str
    space: str = ""
    """Space that decides, where the limit is asked of each."""

    @property
    def distance(self) -> float:
        """Value above the limit; negative where it fails [unit]."""
        return self.value - self.limit

    @property
    def slack(self) -> float:
        """Distance as a part of the limit where it fails, else of what is left to 100 %."""
        room = 100.0 - self.limit if self.unit == "%" and self.distance >= 0 else self.limit
        return self.distance / room if room > TINY else float(self.distance >= 0)


@dataclass(frozen=True)
class Outcome:
    """Outcome of one level."""

    name: str
    reached: bool
    probability: float | None
    """Probability that it is reached, from the draws; None without replicates."""
    margin: Margin
    """The limit that is likeliest to fail."""
    spaces: dict[str, bool]
    """Whether each space complies, where the limits are asked of each."""


def likelihood(probability: float | None) -> str:
    """Write a probability for people; one that holds in all draws is certain."""
    if probability is None:
        return "unknown"
    if probability in (0.0, 1.0):
        return "certain" if probability else "ruled out"
    if not 0.01 <= probability <= 0.99:
        return "< 1 %" if probability < 0.5 else "> 99 %"
    return f"{100 * probability:.0f} %"


@dataclass(frozen=True)
class Verdict:
    """Verdict on a standard."""

    standard: str
    title: str
    edition: str
    level: str | None
    """Highest level that is reached; None where none is, or none can be stated."""
    probability: float | None
    """Probability of this level, of the lowest one where none is reached; None where there is no
    level, or there are no replicates."""
    undecided: str | None
    """Reason why no level can be stated."""
    levels: tuple[Outcome, ...]
    extras: tuple[Outcome, ...]
    quantities: dict[str, Interval]
    """Quantities with their 95 % intervals [% or h]."""
    units: dict[str, str]
    deciding: Deciding | None
    """Points and hours that decide the level nearest to change."""
    duties: tuple[str, ...]
    """Duties of spaces."""
    notes: tuple[str, ...]
    conditions: tuple[str, ...] = ()
    """Terms of the standard that the case lacks, so that the level is that of another façade."""
    taken: tuple[str, ...] = ()
    """Hours and points that the standard takes in place of the case's own."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)

    def stated(self) -> str:
        """Level in words."""
        if self.undecided is not None:
            return f"cannot be decided: {self.undecided}"
        return "not reached" if self.level is None else self.level


def assess(
    name: str, standard: Standard, year: StandardYear, counted: dict[str, Counted]
) -> Verdict:
    """Judge the hours of a standard by its levels.

    `counted` holds its quantities, from `quantities.count`.
    """
    levels = tuple(outcome(level, counted, year) for level in standard.levels)
    extras = tuple(outcome(level, counted, year) for level in standard.extras)
    reached = [each for each in levels if each.reached]
    shown = reached[-1] if reached else levels[0] if levels else None
    decides = None
    if levels:
        level = standard.levels[_nearest(levels)]
        limit, _, space = _closest(level, counted, year)
        quantity = standard.quantities[limit.quantity]
        decides = deciding(limit, quantity, counted[limit.quantity], year, space)
    return Verdict(
        name, standard.title, standard.edition,
        reached[-1].name if reached and standard.undecided is None else None,
        None if shown is None else shown.probability,
        standard.undecided, levels, extras,
        {q: c.interval for q, c in counted.items()},
        {q: c.unit for q, c in counted.items()},
        decides, tuple(_duties(standard, counted, year)), tuple(_notes(standard, year)),
        tuple(_conditions(standard, counted, year)),
    )  # fmt: skip


def outcome(level: Level, counted: dict[str, Counted], year: StandardYear) -> Outcome:
    """Judge one level.

    Its probability is the share of the draws that reach it, mean of the draws and of their mirror
    images about the value: a draw of sDA holds the noise of the value a second time, as intervals
    of sDA take into account.

    Parameters
    ----------
    level : Level
    counted : dict of str to Counted
        Quantities of its limits, by name.
    year : Year
        Hours that were counted.
    """
    by_space = level.scope == "spaces"
    areas = year.space_areas
    least = (level.spaces - TINY) * areas.sum()

    def holds(values: list[np.ndarray]) -> np.ndarray:
        """Whether each space holds all limits, from the values of each limit's quantity."""
        pairs = zip(values, level.limits, strict=True)
        return np.logical_and.reduce([v >= limit.at_least - TINY for v, limit in pairs])

    def passes(held: np.ndarray) -> np.ndarray:
        """Whether the level is reached, from what each space holds (space, …)."""
        return areas @ held >= least if by_space else held[0]

    used = [counted[limit.quantity] for limit in level.limits]
    held = holds([c.by_space if by_space else np.array([c.value]) for c in used])
    probability = None
    if all(c.drawn is not None for c in used):
        ways = zip(*(c.both_ways(by_space) for c in used), strict=True)
        probability = float(np.mean([passes(holds(list(way))).mean() for way in ways]))
    spaces = dict(zip(year.spaces, held.tolist(), strict=True)) if by_space else {}
    return Outcome(
        level.name, bool(passes(held)), probability, _closest(level, counted, year).margin, spaces
    )


class _Closest(NamedTuple):
    """Limit that decides a level."""

    limit: Limit
    margin: Margin
    space: int | None
    """Space whose limit it is, where the limits are asked of each."""


def _closest(level: Level, counted: dict[str, Counted], year: StandardYear) -> _Closest:
    """Limit that is likeliest to fail.

    Where a share of the area has to hold the limits, it is that of the space with which this share
    is complete when spaces are taken from the best one on: the level is reached where that one
    holds them.
    """
    if level.scope == "area":
        return _likeliest_to_fail(level, counted, None, "")
    spaces = list(year.spaces)
    slack = [
        min(_margin(limit, counted, i, name).margin.slack for limit in level.limits)
        for i, name in enumerate(spaces)
    ]
    order = np.argsort(np.negative(slack), kind="stable")
    area = np.cumsum(year.space_areas[order])
    last = int(order[np.searchsorted(area, (level.spaces - TINY) * area[-1])])
    return _likeliest_to_fail(level, counted, last, spaces[last])


def _likeliest_to_fail(
    level: Level, counted: dict[str, Counted], space: int | None, name: str
) -> _Closest:
    """Limit that holds in the fewest draws; of those with as many, that with the least slack."""

    def holds(closest: _Closest) -> tuple[float, float]:
        limit, c = closest.limit, counted[closest.limit.quantity]
        if c.drawn is None:
            return 0.0, closest.margin.slack
        ways = (way[space or 0] for way in c.both_ways(space is not None))
        p = np.mean([np.mean(way >= limit.at_least - TINY) for way in ways])
        return float(p), closest.margin.slack

    return min((_margin(limit, counted, space, name) for limit in level.limits), key=holds)


def _margin(limit: Limit, counted: dict[str, Counted], space: int | None, name: str) -> _Closest:
    """Margin of a limit; where all points have to pass, that of the hours of the worst point."""
    c = counted[limit.quantity]
    value = c.value if space is None else float(c.by_space[space])
    asked, unit = limit.at_least, c.unit
    if c.unit == "%" and limit.at_least == 100.0:
        mine = slice(None) if space is None else c.of_space(space)
        value, asked, unit = float(c.hours[mine].min()), c.needed_hours, "h"
    return _Closest(limit, Margin(limit.quantity, value, asked, unit, name), space)


def _nearest(levels: tuple[Outcome, ...]) -> int:
    """Level in doubt; else the first that is not reached; else the highest."""

    def doubt(level: Outcome) -> float:
        p = level.probability
        return 0.0 if p is None else min(p, 1 - p)

    best = max(range(len(levels)), key=lambda i: doubt(levels[i]))
    if doubt(levels[best]) > 0:
        return best
    return next((i for i, o in enumerate(levels) if not o.reached), len(levels) - 1)


def _duties(standard: Standard, counted: dict[str, Counted], year: StandardYear) -> list[str]:
    out = []
    for flag in standard.flags:
        c = counted[flag.quantity]
        above = np.flatnonzero(c.by_space > flag.above + TINY)
        if len(above):
            most = c.by_space[above].max()
            state = f"{flag.quantity} up to {most:.1f} {c.unit}, above {flag.above:g} {c.unit}"
            out.append(f"{_named(list(year.spaces), above)}: {state}: {flag.text}")
    return out


def _named(spaces: list[str], chosen: np.ndarray) -> str:
    """Some of the spaces by their names, or by their number where they are many."""
    if len(chosen) <= MOST_NAMES:
        return ", ".join(spaces[i] or "the room" for i in chosen)
    if len(chosen) == len(spaces):
        return f"all {len(spaces)} spaces"
    named = ", ".join(spaces[i] for i in chosen[:MOST_NAMES])
    return f"{len(chosen)} of {len(spaces)} spaces ({named}, …)"


def _conditions(standard: Standard, counted: dict[str, Counted], year: StandardYear) -> list[str]:
    """Quantities that no level asks for, and a shade that differs from what a standard presumes."""
    rules = [*standard.levels, *standard.extras]
    asked = {limit.quantity for level in rules for limit in level.limits}
    asked |= {flag.quantity for flag in standard.flags}
    out, E = [], year.illuminance.attrs
    for name, c in counted.items():
        if name not in asked and standard.undecided is None:
            out.append(f"{name} of {c.value:.1f} {c.unit} is not judged")
    if standard.shade and not year.has_shade:
        out.append("the case has no shade, which LM-83 wants before every window")
    if standard.shade and year.has_shade:
        rule = float(E.get("shade_threshold", THRESHOLD)), float(E.get("shade_area", AREA))
        if rule != (THRESHOLD, AREA):
            out.append(
                f"the shade closes at {rule[0]:g} lx on {100 * rule[1]:g} % of the points, "
                f"by LM-83 at {THRESHOLD:g} lx on {100 * AREA:g} %"
            )
        if "schedule" in E:
            out.append("groups of panes follow a schedule, not the rule of LM-83")
        if len(year.spaces) > 1 and not spaces_of_groups(E):
            out.append(
                "a shade closes in all spaces at once, by LM-83 in each by itself: "
                'groups = "spaces" in [shading]'
            )
    return out


def _notes(standard: Standard, year: StandardYear) -> list[str]:
    """Notes on how the verdict was reached."""
    notes = []
    if standard.hours == "equinox":
        notes.append(clearest_days(year.illuminance))
    if outside := int(np.count_nonzero(year.space < 0)):
        notes.append(f"{outside} points lie in no space and are left out")
    if year.replicates is None:
        notes.append("no probability: coefficients.zarr and sky.zarr hold the replicates")
    elif standard.shade and year.varies:
        notes.append("no probability: C on disk does not hold all states of the façade")
    return notes + list(standard.notes)
