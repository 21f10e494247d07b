"""Uses of spaces, and the table `[uses]` of a case: targets, hours, words that tell a use.

The uses that come with the program, and where their numbers are from, stand in `uses.toml`. They
serve daylight autonomy and the electric light of a space; sDA keeps its own threshold.
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from importlib import resources
from typing import Annotated

from pydantic import Field, model_validator

from drcmitsuba.model.space import Space
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import (
    Illuminance,
    Name,
    Sourced,
    Table,
    checked,
    choose,
    fits,
    shortened,
    tomllib,
)

Hour = Annotated[int, Field(ge=0, le=24)]
Power = Annotated[float, Field(gt=0, le=1000)]
Words = Annotated[tuple[Name, ...], Field(max_length=100)]
MOST_NAMES = 3
"""Largest number of spaces of unknown use that a note names."""
ALIKE = 0.7
"""Similarity from which on a use may be meant by another word."""


def clock_hours(hours: tuple[int, int]) -> frozenset[int]:
    """Hours of the clock from the first one to the end of the last, 0 to 23, past midnight too."""
    first, last = hours
    passed = range(first, last) if first <= last else [*range(first, 24), *range(last)]
    return frozenset(passed)


class TaskTable(Table):
    """Table of a task, whose keys a use and a space share."""

    hours: tuple[Hour, Hour] | None = None
    """First hour of use on the clock, and the hour at which the last one ends [h], which may lie
    past midnight: [22, 6]; by default those of the use, or all hours of the period."""
    power: Power | None = None
    """Installed power of the lamps [W/m²], from which their energy follows."""

    @model_validator(mode="after")
    def _has_hours(self) -> TaskTable:
        if self.hours is not None and not clock_hours(self.hours):
            got = f"{self.hours[0]} to {self.hours[1]} h, which is none"
            raise InputError("case", "hours", got, "give the first hour and another last one")
        return self


class UseTable(TaskTable):
    """Use of spaces; what the program's own use of this name has may be left out."""

    target: Illuminance | None = None
    """Mean illuminance that the task wants [lx]."""
    words: Words = ()
    """Words that tell the use, in the use of a space or else in its name; * stands for any text."""


class Use(UseTable, Sourced):
    """Use that comes with the program."""

    target: Illuminance


@cache
def shipped_uses() -> dict[str, Use]:
    """Uses that come with the program, by name, in the order in which they are tried."""
    text = (resources.files("drcmitsuba.case") / "uses.toml").read_text(encoding="utf-8")
    return {name: checked(Use, row, "uses.toml") for name, row in tomllib.loads(text).items()}


def known_uses(tables: Mapping[str, UseTable], source: str) -> dict[str, UseTable]:
    """Uses of a case before those of the program, whose keys it overrules.

    Raises
    ------
    InputError
        A use that the program does not know has no target.
    """
    shipped, out = shipped_uses(), dict[str, UseTable]()
    for name, table in tables.items():
        known = shipped.get(name, UseTable())
        stated = {key: getattr(table, key) for key in table.model_fields_set}
        out[name] = known.model_copy(update=stated)
        if out[name].target is None:
            remedy = choose(name, list(shipped), "give target = 300")
            got = "none, and the program has no such use"
            raise InputError(source, f"uses.{name}.target", got, remedy)
    return out | {name: use for name, use in shipped.items() if name not in out}


def recognised(words: str, uses: Mapping[str, UseTable]) -> str:
    """Name of the use that words tell; empty where they tell none.

    It is the use of that name, or else the first one of which a word occurs: capitals within a name
    begin a word, so that "OfficeOpenPlan" holds "office".
    """
    text = plain_words(words)
    for name in uses:
        if plain_words(name) == text and text:
            return name
    for name, use in uses.items():
        if fits(f" {text} ", [f"* {word.lower()} *" for word in use.words]):
            return name
    return ""


@lru_cache(maxsize=4096)
def plain_words(text: str) -> str:
    """Words of a name in small letters with single spaces between them."""
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", text)
    return " ".join(re.findall(r"[^\W_]+", apart.lower()))


def with_uses(
    spaces: Sequence[Space], tables: Mapping[str, UseTable], source: str,
    period: tuple[int, int] = (0, 24),
) -> tuple[tuple[Space, ...], str]:  # fmt: skip
    """Spaces with the targets, hours and power of their uses, and a note on them.

    What a space has already stays. Its use, or its name where that tells nothing, is recognised by
    `recognised`. The note is empty where no space has a target; it tells hours of use that those of
    the `period` cut off.

    Raises
    ------
    InputError
        As `known_uses`; or a use of the case alone can be told of no space.
    """
    uses, out = known_uses(tables, source), []
    taken, met, unknown = Counter[tuple[str, bool]](), set[str](), list[tuple[str, str]]()
    for space in spaces:
        name = recognised(space.use, uses) or recognised(space.name, uses)
        if name:
            use = uses[name]
            met.add(name)
            taken[name, space.hours is None] += space.target is None
            space = replace(
                space,
                target=space.target or use.target,
                hours=space.hours or use.hours,
                power=space.power or use.power,
            )
        elif space.target is None:
            near = difflib.get_close_matches(space.use, list(uses), n=1, cutoff=ALIKE)
            unknown.append((space.name, near[0] if near else ""))
        out.append(space)
    for name in tables:
        if name not in shipped_uses() and not uses[name].words and name not in met:
            got = "no space has this use, and it has no words"
            remedy = choose(
                name, list(shipped_uses()), 'give words = ["..."], or name it in [spaces]'
            )
            raise InputError(source, f"uses.{name}", got, remedy)
    return tuple(out), _note(taken, unknown, uses, period)


def _note(
    taken: Counter[tuple[str, bool]], unknown: Sequence[tuple[str, str]],
    uses: Mapping[str, UseTable], period: tuple[int, int],
) -> str:  # fmt: skip
    """Sentence on the uses that were recognised in so many spaces, and on spaces of none.

    Uses come with whether their hours are taken, spaces of none with the use that may be meant.
    """
    parts, is_cut = [], False
    for (name, takes_hours), count in (+taken).items():
        use, hours = uses[name], ""
        if takes_hours and use.hours is not None:
            first, last = use.hours
            hours = f", {first} to {last} h"
            if clock_hours(use.hours).isdisjoint(clock_hours(period)):
                hours = f", all hours, since the period has none from {first} to {last} h"
            else:
                is_cut |= not clock_hours(use.hours) <= clock_hours(period)
        parts.append(f"{name} {use.target:g} lx{hours} ({count} space{'s' * (count > 1)})")
    if not parts and not any(near for _, near in unknown):
        return ""
    note = f"spaces: targets and hours by use are {'; '.join(parts) or 'none'}"
    if is_cut:
        note += f"; of these hours the period's, {period[0]} to {period[1]} h, count alone"
    if unknown:
        names = ", ".join(
            f"{shortened(name)} (did you mean {shortened(near)}?)" if near else shortened(name)
            for name, near in unknown[:MOST_NAMES]
        )
        more = f" and {len(unknown) - MOST_NAMES} more" if unknown[MOST_NAMES:] else ""
        note += f"; those of {names}{more} tell none, and take the threshold of sDA in all hours"
    return f"{note}: [spaces] and [uses] overrule them"
