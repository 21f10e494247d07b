"""Verdicts on one standard, or on all of them, which share what they count."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import xarray as xr

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.standards.coverage import check_facing, check_spacing, hours_of
from drcmitsuba.standards.evidence import Evidence
from drcmitsuba.standards.quantities import Counted, count
from drcmitsuba.standards.standard import Quantity, names, read
from drcmitsuba.standards.verdict import Verdict, assess
from drcmitsuba.standards.year import Year


@dataclass(frozen=True)
class Refusal:
    """Standard on which the evidence allows no verdict."""

    standard: str
    title: str
    reason: InputError

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {"standard": self.standard, "title": self.title, "refused": str(self.reason)}


@dataclass
class _Judge:
    """Years by hours, and quantities by what they count: standards share them."""

    evidence: Evidence
    years: dict[str, Year] = field(default_factory=dict)
    counted: dict[tuple, Counted] = field(default_factory=dict)

    def verdict(self, name: str) -> Verdict:
        standard, E = read(name), self.evidence.illuminance
        step = float(E.attrs.get("step_hours", 1.0))
        if standard.hours not in self.years:
            at = hours_of(standard, E, step, self.evidence.source, self.evidence.sky)
            self.years[standard.hours] = Year(self.evidence, at)
        check_facing(E, self.evidence.source)
        check_spacing(standard, E, self.evidence.source)
        year = self.years[standard.hours]
        quantities = {
            of: self.count(quantity, standard.hours) for of, quantity in standard.quantities.items()
        }
        return assess(name, standard, year, quantities)

    def count(self, quantity: Quantity, hours: str) -> Counted:
        asked = (quantity.light, quantity.of, quantity.threshold, quantity.fraction, quantity.hours)
        key = (hours, *asked)
        if key not in self.counted:
            self.counted[key] = count(quantity, self.years[hours])
        return self.counted[key]


def verdict(standard: str, evidence: Evidence) -> Verdict:
    """Verdict on a standard.

    Parameters
    ----------
    standard : str
        Name of a standard, one of `names()`.
    evidence : Evidence
        `Evidence.of_folder(...)` or `Evidence.of_result(...)`.

    Returns
    -------
    Verdict
        Level, margin, probability of passing, and what decides it.

    Raises
    ------
    InputError
        There is no such standard, the period does not cover its hours, a grid is too coarse, or a
        state of the façade is missing in C.
    """
    return _Judge(evidence).verdict(standard)


def each(standards: Iterable[str], evidence: Evidence) -> list[Verdict]:
    """Verdicts on several standards, which share what they count; errors as for `verdict`."""
    judge = _Judge(evidence)
    return [judge.verdict(name) for name in standards]


def not_covered(sky: xr.Dataset, step_hours: float, source: object) -> dict[str, InputError]:
    """Standards whose hours the time stamps of a sky do not cover, and why, by name.

    `sky` is `Daylight.sky` of a case, `step_hours` the length of its intervals [h], `source` the
    case's file, for the messages.
    """
    refusals = {}
    for name in names():
        try:
            hours_of(read(name), sky, step_hours, source, sky)
        except InputError as error:
            refusals[name] = error
    return refusals


def verdicts(evidence: Evidence) -> list[Verdict | Refusal]:
    """Verdicts on all standards; a refusal where `verdict` would raise InputError."""
    judge, out = _Judge(evidence), list[Verdict | Refusal]()
    for name in names():
        try:
            out.append(judge.verdict(name))
        except InputError as error:
            out.append(Refusal(name, read(name).title, error))
    return out
