"""Standards as tables: thresholds, hours, levels, and the source of every number."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import (
    Fraction,
    Illuminance,
    Name,
    Sourced,
    Table,
    Text,
    checked,
    choose,
    tomllib,
)

Hours = Annotated[float, Field(gt=0, le=8784)]


class Quantity(Sourced):
    """Quantity of E that a standard asks for: a share of the points [%], or hours [h]."""

    meaning: Text
    """Count or hours that the quantity is, in words."""
    light: Literal["total", "open", "direct_sun"]
    """E with the shade applied, with the shade open, or by direct sun alone."""
    of: Literal["points", "mean", "moments"] = "points"
    """Share of the points that reach the threshold for long enough [%]; or hours in which the mean
    of a space's points does [h]; or share of the points that reach it at every moment of the
    equinox [%]."""
    threshold: Illuminance
    """Illuminance that counts as reached [lx]."""
    at_most: Illuminance | None = None
    """Illuminance that moments must not exceed [lx]."""
    fraction: Fraction | None = None
    """Fraction of the standard's hours in which it has to be reached [–]; or else:"""
    hours: Hours | None = None
    """Hours in which it has to be reached [h]."""

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return "h" if self.of == "mean" else "%"

    def at_threshold(self, name: str) -> str:
        """Name of the quantity; of sDA with its threshold, which may not be the evaluation's."""
        return f"{name} at {self.threshold:g} lx" if name == "sDA" else name

    @model_validator(mode="after")
    def _one_duration(self) -> Quantity:
        if (self.fraction is None) == (self.hours is None):
            raise InputError("standard", "fraction, hours", "both or none", "give one of them")
        if self.of != "points" and self.light != "open":
            got = f"{self.of} of {self.light}"
            raise InputError("standard", "light", got, 'give "open": the shade varies in draws')
        return self


class Limit(Table):
    """Least value of a quantity."""

    quantity: Name
    """Name of the quantity."""
    at_least: Annotated[float, Field(ge=0, le=8784)]
    """Value from which on the limit holds [% or h]."""


class Level(Sourced):
    """Level that is reached where all its limits hold."""

    name: Name
    """Name of the level."""
    limits: tuple[Limit, ...]
    """Limits of the quantities."""
    scope: Literal["area", "spaces"] = "area"
    """Whether the limits are asked of all points together, or of every space by itself."""
    spaces: Fraction = 1.0
    """Share of the floor area whose spaces have to hold the limits [–]."""


class Flag(Sourced):
    """Duty that a space has where a quantity is above a value."""

    quantity: Name
    """Name of the quantity."""
    above: float
    """Value above which the duty begins [% or h]."""
    text: Text
    """The duty."""


class Standard(Sourced):
    """A standard, or the part of it that illuminance decides."""

    title: Text
    """Name with the part that is assessed."""
    edition: Name
    """Edition, with its date where it is known."""
    read: Annotated[str, Field(pattern=r"^\d{4}-\d\d$")]
    """Month in which its sources were read, such as 2026-11."""
    hours: Literal["8 to 18", "daylight", "year", "equinox"]
    """Hours that count: 8 to 18 h on the clock every day; the 4,380 h of a year with the highest
    diffuse horizontal illuminance; all hours of a year; 9 and 15 h of a clear day near each
    equinox."""
    shade: bool
    """Whether the standard presumes a shade that the rule of LM-83 closes."""
    largest_spacing: Annotated[float, Field(gt=0, le=100)] | None = None
    """Largest distance of neighbouring points [m]."""
    undecided: Text | None = None
    """Reason why no level can be stated."""
    notes: tuple[Text, ...] = ()
    """Numbers that could not be verified, and parts that are not assessed."""
    quantities: dict[Name, Quantity]
    """Quantities by name."""
    levels: tuple[Level, ...] = ()
    """Levels, the lowest first."""
    extras: tuple[Level, ...] = ()
    """Levels beside them."""
    flags: tuple[Flag, ...] = ()
    """Duties."""

    @property
    def sources(self) -> dict[str, list[str]]:
        """Sources of all numbers, by how sure they are."""
        out: dict[str, list[str]] = {}
        parts = (*self.quantities.values(), *self.levels, *self.extras, *self.flags)
        for sure, source in dict.fromkeys((part.sure, part.source) for part in parts):
            out.setdefault(sure, []).append(source)
        return out

    @model_validator(mode="after")
    def _known_quantities(self) -> Standard:
        levels = (*self.levels, *self.extras)
        used = [limit.quantity for level in levels for limit in level.limits]
        for name in [*used, *(flag.quantity for flag in self.flags)]:
            if name not in self.quantities:
                remedy = choose(name, list(self.quantities))
                raise InputError("standard", "quantity", f"no {name!r}", remedy)
        moments = [quantity.of == "moments" for quantity in self.quantities.values()]
        if moments and (not all(moments) if self.hours == "equinox" else any(moments)):
            got = f"{self.hours}, beside quantities of other hours"
            raise InputError("standard", "hours", got, 'give "equinox" with "moments" alone')
        if not self.levels and self.undecided is None:
            raise InputError("standard", "levels", "none", "say why it is undecided")
        return self


def names() -> list[str]:
    """Names of the standards, such as `leed-v4.1`."""
    files = resources.files("drcmitsuba.standards").iterdir()
    return sorted(file.name[:-5] for file in files if file.name.endswith(".toml"))


@cache
def read(name: str) -> Standard:
    """Read a standard by its name.

    Raises
    ------
    InputError
        There is none of this name.
    """
    known = names()
    if name not in known:
        raise InputError("standards", name, "no such standard", choose(name, known))
    text = (resources.files("drcmitsuba.standards") / f"{name}.toml").read_text(encoding="utf-8")
    return checked(Standard, tomllib.loads(text), f"{name}.toml")
