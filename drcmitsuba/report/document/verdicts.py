"""Tables of the verdicts on standards, with probabilities, and what decides them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from drcmitsuba import standards
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.table import (
    LINE,
    Cell,
    Number,
    PageTable,
    interval,
    plain,
    text,
)
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


def overview(facades: list[EvaluatedFacade], names: list[str]) -> list[PageTable]:
    """Tables with a row for each standard and a column for each façade: of verdicts, and of
    standards that allow none for any façade, where there are such.

    Many standards that cannot be judged for the same reason have one row together.
    """
    t = labels()
    by_standard = list(zip(*(f.verdicts for f in facades), strict=True))
    decided = [verdicts for verdicts in by_standard if any(map(_is_decided, verdicts))]
    others = [verdicts for verdicts in by_standard if not any(map(_is_decided, verdicts))]
    tables, head = [], (t["standard"], *names)
    if decided:
        own = any(isinstance(each, Verdict) and each.taken for of in decided for each in of)
        note = t["verdicts_note"].format(draws=DRAWS)
        note += f" {t['verdicts_hours']}" if own else ""
        rows = tuple((plain(_title(each[0])), *map(_short, each)) for each in decided)
        tables.append(PageTable(t["verdicts"], head, rows, note))
    if others:
        title = t["no_verdicts"].format(count=len(others))
        tables.append(PageTable(title, head, tuple(_without_verdict(others))))
    return tables


def _without_verdict(
    by_standard: list[tuple[Verdict | Refusal, ...]],
) -> Iterator[tuple[Cell, ...]]:
    """Yield a row for each standard, or for many that are refused for the same reason."""
    alike: dict[tuple[Cell, ...], list[str]] = {}
    for verdicts in by_standard:
        short = tuple(map(_short, verdicts))
        if all(isinstance(verdict, Refusal) for verdict in verdicts):
            alike.setdefault(short, []).append(_title(verdicts[0]))
        else:
            yield plain(_title(verdicts[0])), *short
    for short, titles in alike.items():
        several = [labels()["standards_alike"].format(count=len(titles))]
        for title in titles if len(titles) < MANY else several:
            yield plain(title), *short


def _is_decided(verdict: Verdict | Refusal) -> bool:
    return isinstance(verdict, Verdict) and verdict.undecided is None


def _title(verdict: Verdict | Refusal) -> str:
    return text(f"{verdict.title} ({standards.read(verdict.standard).edition})")


def _short(verdict: Verdict | Refusal) -> Cell:
    """Level and probability in words, the nearest limit, conditions and duties on lines."""
    t = labels()
    if isinstance(verdict, Refusal):
        return (OPEN + t["no_verdict"].format(reason=text(verdict.reason.got)),)
    if verdict.undecided is not None:
        return (OPEN + t["undecided"].format(reason=text(verdict.undecided)),)
    shown = next((o for o in reversed(verdict.levels) if o.reached), verdict.levels[0])
    margin = _margin(shown.margin, standards.read(verdict.standard))
    further = [*verdict.conditions, *(t["duty"].format(text=duty) for duty in verdict.duties)]
    lines = "".join(f"{LINE}{text(line)}" for line in further)
    return _level(verdict, shown), LINE, *margin, lines


def _level(verdict: Verdict, shown: Outcome) -> str:
    """Level in words, with the probability of it, or of the lowest one where none is reached."""
    t, likely = labels(), _likelihood(verdict.probability)
    if likely.endswith("%"):
        likely = t["probability_of"].format(probability=likely)
    mark, words = (YES, t["reached"]) if shown.reached else (NO, t["not_reached"])
    return mark + words.format(level=text(shown.name), probability=likely)


def _stated(verdict: Verdict | Refusal) -> str:
    """Level and probability on one line."""
    return "".join(map(str, _short(verdict))).split(LINE)[0]


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
    remarks += [*verdict.conditions, *verdict.taken, *verdict.notes]
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
