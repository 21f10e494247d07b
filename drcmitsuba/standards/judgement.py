"""Verdicts on one standard, or on all of them, which share what they count."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.standards.coverage import check_facing, check_spacing, hours_of
from drcmitsuba.standards.evidence import Evidence
from drcmitsuba.standards.quantities import Counted, count
from drcmitsuba.standards.standard import Quantity, Standard, names, read
from drcmitsuba.standards.terms import Terms, in_place
from drcmitsuba.standards.verdict import Verdict, assess
from drcmitsuba.standards.year import StandardYear


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
    years: dict[str, StandardYear] = field(default_factory=dict)
    counted: dict[tuple, Counted] = field(default_factory=dict)

    def verdict(self, name: str) -> Verdict:
        evidence = self.evidence.of_year
        standard, E = read(name), evidence.illuminance
        step = float(E.attrs.get("step_hours", 1.0))
        if standard.hours not in self.years:
            at = hours_of(standard, E, step, evidence.source, evidence.sky)
            self.years[standard.hours] = StandardYear(evidence, at)
        check_facing(E, evidence.source)
        check_spacing(standard, E, evidence.source)
        year = self.years[standard.hours]
        quantities = {
            of: self.count(quantity, standard.hours) for of, quantity in standard.quantities.items()
        }
        judged = assess(name, standard, year, quantities)
        return replace(judged, taken=self._taken(standard, step))

    def _taken(self, standard: Standard, step: float) -> tuple[str, ...]:
        """Line on hours that are not those of the evaluation's period, where C tells them."""
        E, sky = self.evidence.illuminance, self.evidence.sky
        if not standard.quantities:
            return ()
        try:
            hours_of(standard, E, step, self.evidence.source, sky)
        except InputError:
            return (in_place(standard, E.sizes["time"] * step),)
        return ()

    def count(self, quantity: Quantity, hours: str) -> Counted:
        asked = (quantity.light, quantity.of, quantity.threshold, quantity.at_most)
        key = (hours, *asked, quantity.fraction, quantity.hours)
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


def on_terms(terms: Terms, evidence: Evidence) -> list[Verdict | Refusal]:
    """Verdicts on the standards of some terms, `evidence` being of their case; or refusals."""
    out = list[Verdict | Refusal]()
    for each in verdicts(evidence, terms.standards):
        if isinstance(each, Verdict):
            hours = each.taken if terms.hours is None else terms.taken(each.standard)
            each = replace(each, taken=(*hours, *((terms.grid,) if terms.grid else ())))
        out.append(each)
    return out


def verdicts(evidence: Evidence, standards: Iterable[str] | None = None) -> list[Verdict | Refusal]:
    """Verdicts on standards, by default all; a refusal where `verdict` would raise InputError.

    Examples
    --------
    >>> import drcmitsuba
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> evidence = drcmitsuba.standards.Evidence.of_result(result)
    >>> found = drcmitsuba.standards.verdicts(evidence, ["leed-v4.1", "en-17037"])
    >>> [one.standard for one in found]
    ['leed-v4.1', 'en-17037']
    """
    judge, out = _Judge(evidence), list[Verdict | Refusal]()
    for name in names() if standards is None else standards:
        try:
            out.append(judge.verdict(name))
        except InputError as error:
            out.append(Refusal(name, read(name).title, error))
    return out
