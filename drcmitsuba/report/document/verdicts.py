"""Tables of the verdicts on standards, with probabilities, and what decides them."""

from __future__ import annotations

from dataclasses import dataclass

from drcmitsuba import standards
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.table import Cell, Number, PageTable, interval, plain, text
from drcmitsuba.standards import Refusal, Verdict
from drcmitsuba.standards.standard import Standard
from drcmitsuba.standards.verdict import Margin, Outcome, likelihood

YES, NO, OPEN = "✓ ", "✗ ", "? "
MANY = 4
"""Number of standards from which on those without a verdict for one reason share a row."""


@dataclass(frozen=True)
class Judgement:
    """One verdict in full, for a façade."""

    facade: str
    title: str
    stated: str
    tables: tuple[PageTable, ...]
    remarks: tuple[str, ...]


def overview(facades: list[EvaluatedFacade], names: list[str]) -> PageTable:
    """Table with a row for each standard and a column for each façade.

    Many standards that cannot be judged for the same reason have one row together.
    """
    t = labels()
    rows = []
    by_standard = list(zip(*(f.verdicts for f in facades), strict=True))
    alike: dict[tuple[Cell, ...], list[str]] = {}
    for verdicts in sorted(by_standard, key=lambda each: not any(map(_is_decided, each))):
        title, short = _title(verdicts[0]), tuple(map(_short, verdicts))
        if all(isinstance(verdict, Refusal) for verdict in verdicts):
            alike.setdefault(short, []).append(title)
        else:
            rows.append((plain(title), *short))
    for short, titles in alike.items():
        shown = titles if len(titles) < MANY else [t["standards_alike"].format(count=len(titles))]
        rows += [(plain(title), *short) for title in shown]
    judged = [each for verdicts in by_standard for each in verdicts]
    own = any(isinstance(each, Verdict) and each.taken for each in judged)
    note = t["verdicts_note"] + (f" {t['verdicts_hours']}" if own else "")
    return PageTable(t["verdicts"], (t["standard"], *names), tuple(rows), note)


def _is_decided(verdict: Verdict | Refusal) -> bool:
    return isinstance(verdict, Verdict) and verdict.undecided is None


def _title(verdict: Verdict | Refusal) -> str:
    return text(f"{verdict.title} ({standards.read(verdict.standard).edition})")


def _short(verdict: Verdict | Refusal) -> Cell:
    """Level and probability in words."""
    t = labels()
    if isinstance(verdict, Refusal):
        return (OPEN + t["no_verdict"].format(reason=text(verdict.reason.got)),)
    if verdict.undecided is not None:
        return (OPEN + t["undecided"].format(reason=text(verdict.undecided)),)
    shown = next((o for o in reversed(verdict.levels) if o.reached), verdict.levels[0])
    words = t["reached"] if shown.reached else t["not_reached"]
    told = words.format(level=text(shown.name), probability=_likelihood(verdict.probability))
    margin = _margin(shown.margin, standards.read(verdict.standard))
    duties = "".join(f"; {t['duty'].format(text=text(duty))}" for duty in verdict.duties)
    conditions = "".join(f"; {text(condition)}" for condition in verdict.conditions)
    return (YES if shown.reached else NO) + told + conditions, "; ", *margin, duties


def _stated(verdict: Verdict | Refusal) -> str:
    """Level and probability as one text."""
    return "".join(map(str, _short(verdict)))


def judgements(facade: EvaluatedFacade, name: str) -> list[Judgement]:
    """Verdicts of a façade in full: quantities, levels, margins, what decides, sources."""
    return [
        _refused(verdict, name) if isinstance(verdict, Refusal) else _judged(verdict, name)
        for verdict in sorted(facade.verdicts, key=lambda each: not _is_decided(each))
    ]


def _refused(refusal: Refusal, name: str) -> Judgement:
    remark = text(refusal.reason.remedy)
    return Judgement(name, _title(refusal), _stated(refusal), (), (remark,))


def _judged(verdict: Verdict, name: str) -> Judgement:
    t, standard = labels(), standards.read(verdict.standard)
    rows = tuple(
        (plain(quantity.at_threshold(q)), _quantity(verdict, q), plain(quantity.meaning))
        for q, quantity in standard.quantities.items()
    )
    tables = [PageTable(t["quantities"], (t["quantity"], t["value"], t["meaning"]), rows)]
    outcomes = (*verdict.levels, *verdict.extras)
    if outcomes:
        head = (t["level"], t["is_reached"], t["probability"], t["nearest_limit"])
        tables.append(
            PageTable(t["levels"], head, tuple(_row(outcome, standard) for outcome in outcomes))
        )
    remarks = []
    if verdict.deciding is not None:
        remarks.append(t["decides"].format(text=verdict.deciding.text(t)))
    remarks += [t["duty"].format(text=duty) for duty in verdict.duties]
    remarks += [*verdict.taken, *verdict.notes]
    sources = standard.sources.items()
    remarks += [t["source"].format(sure=sure, text="; ".join(of)) for sure, of in sources]
    stated = _stated(verdict)
    return Judgement(name, _title(verdict), stated, tuple(tables), tuple(map(text, remarks)))


def _likelihood(probability: float | None) -> str:
    """Probability in the words of the report."""
    t, told = labels(), likelihood(probability)
    return {"certain": t["certain"], "ruled out": t["ruled_out"], "unknown": t["unknown"]}.get(
        told, told
    )


def _quantity(verdict: Verdict, name: str) -> Cell:
    i, unit = verdict.quantities[name], verdict.units[name]
    return interval(i.to_dict(), unit, digits=1 if unit == "%" else 0)


def _row(outcome: Outcome, standard: Standard) -> tuple[Cell, ...]:
    t = labels()
    reached = YES + t["yes"] if outcome.reached else NO + t["no"]
    failing = sum(not held for held in outcome.spaces.values())
    if len(outcome.spaces) > 1 and failing:
        reached += t["spaces_fail"].format(failing=failing, count=len(outcome.spaces))
    probability = _likelihood(outcome.probability)
    return plain(outcome.name), (reached,), (probability,), _margin(outcome.margin, standard)


def _margin(margin: Margin, standard: Standard) -> Cell:
    """Value, limit and distance: "sDA at 300 lx 71.2 % of 75 % (−3.8)"."""
    t, digits = labels(), 1 if margin.unit == "%" else 0
    value, distance = Number(margin.value, digits), Number(margin.distance, digits, signed=True)
    limit = f" {margin.unit} {t['of']} {margin.limit:g} {margin.unit} ("
    space = f" {t['in']} {text(margin.space)}" if margin.space else ""
    name = standard.quantities[margin.quantity].at_threshold(margin.quantity)
    return f"{name} ", value, limit, distance, f"){space}"
