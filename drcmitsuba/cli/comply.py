"""The command `drcmitsuba comply`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import AsJson, OptionalOutput, Weather, argument, load, option
from drcmitsuba.cli.terminal import show, show_notes, stages
from drcmitsuba.runtime.errors import InputError, on_a_line
from drcmitsuba.runtime.folder_lock import locked

if TYPE_CHECKING:
    from drcmitsuba.annual.result import Result
    from drcmitsuba.case.case import Case
    from drcmitsuba.design.change import Change
    from drcmitsuba.runtime.progress import Stage
    from drcmitsuba.standards import Refusal, Verdict, ViewOut
    from drcmitsuba.standards.verdict import Margin, Outcome

CONDITION = "*"
"""Mark of a verdict on a case that lacks something of its standard's terms."""
CHANGE = "Find the least change of the façade that reaches the next level (a case with [design])."


def comply(
    source: Annotated[str, argument("CASE|RESULTS", "Case, or folder of an evaluation.")],
    standard: Annotated[
        list[str] | None, option("NAME", "Standard, such as leed-v4.1; by default all of them.")
    ] = None,
    output: OptionalOutput = None,
    as_json: AsJson = False,
    weather: Weather = None,
    view: Annotated[
        bool, typer.Option("--view", help="Trace the view out of EN 17037, too (a case only).")
    ] = False,
    change: Annotated[bool, typer.Option("--change", help=CHANGE)] = False,
) -> None:
    """Judge an evaluation by standards: level, margin and probability of passing.

    A case is evaluated first, by each standard's own hours, and on a grid as the standard asks for
    where its own is too coarse; -o then keeps these results, too. The probability is the share of
    the draws of the year, from which the 95 % intervals follow, in which a level is reached.
    """
    from drcmitsuba import standards

    for name in standard or ():
        standards.read(name)
    is_folder = Path(source).is_dir()
    if is_folder and weather is not None:
        got = "results have their own weather"
        raise InputError("command line", "--weather", got, "give it with a case")
    if is_folder and (view or change):
        name, got = "--view" if view else "--change", "results have no geometry"
        raise InputError("command line", name, got, "give it with a case")
    if change and not standard:
        raise InputError("command line", "--change", "no standard", "name one: --standard NAME")
    with nullcontext() if output is None else locked(output):
        _judge(source, standard, output, as_json, weather, view, change)


def _judge(
    source: str, standard: list[str] | None, output: Path | None, as_json: bool,
    weather: Path | None, view: bool, change: bool,
) -> None:  # fmt: skip
    """Judge, and print or write the verdicts; arguments as of `comply`."""
    from drcmitsuba import standards
    from drcmitsuba.runtime import storage

    changes: list[Change | Refusal] = []
    notes, drawn = list[str](), list[Path]()
    if Path(source).is_dir():
        evidence = standards.Evidence.of_folder(source)
        judged: list[Verdict | Refusal] = (
            [*standards.each(standard, evidence)] if standard else standards.verdicts(evidence)
        )
    else:
        judged, changes, notes = _of_case(load(source, weather), standard or [], output, change)
    told: dict[str, Any] = {
        "source": str(source),
        "standards": [verdict.to_dict() for verdict in judged],
    }
    seen = _view(source, weather) if view else None
    if notes:
        told["notes"] = notes
    if seen is not None:
        told["view_out"] = seen.to_dict()
    if changes:
        told["changes"] = [each.to_dict() for each in changes]
    if output is not None:
        storage.save_json(told, output / "compliance.json")
        told_changes = (each for each in changes if not isinstance(each, standards.Refusal))
        drawn = [file for each in told_changes for file in each.save(output)]
    if as_json:
        print(json.dumps(told, indent=2, ensure_ascii=False))
    elif standard:
        for verdict in judged:
            _show_verdict(verdict)  # type: ignore[arg-type]
    else:
        _show_all(judged)
    if not as_json:
        for line in _lines(changes):
            print(line)
        show_notes(notes)
    if seen is not None and not as_json:
        print("\n".join(seen.text()))
    if output is not None and not as_json:
        print(f"verdicts are in {output / 'compliance.json'}")
        for file in drawn:
            print(f'{file.name}: new windows of the change, windows = "{file.name}" in [model]')


def _of_case(
    case: Case, named: list[str], output: Path | None, change: bool
) -> tuple[list[Verdict | Refusal], list[Change | Refusal], list[str]]:
    """Evaluate a case by the hours and points of standards, and judge it; all of them by default.

    Results of the user's own points go to `output`, those of a grid that was laid to a folder in
    it. The notes are those on the evaluations.
    """
    from drcmitsuba import standards
    from drcmitsuba.design.cheapest_change import cheapest_changes
    from drcmitsuba.runtime import backend

    backend.select()
    names = named or standards.names()
    every, refused = standards.terms(case, names)
    if refused and (named or not every):
        raise [*refused.values()][-1]
    judged: dict[str, Verdict | Refusal] = {
        name: standards.Refusal(name, standards.read(name).title, error)
        for name, error in refused.items()
    }
    changes: list[Change | Refusal] = []
    notes: list[str] = []
    for terms in every:
        with stages() as stage:
            folder = output / "laid_grid" if output is not None and terms.grid else output
            result = _evaluated(terms.case, folder, stage)
            notes += result.metrics["settings"]["notes"]
            verdicts = standards.on_terms(terms, standards.Evidence.of_result(result))
            judged |= {verdict.standard: verdict for verdict in verdicts}
            if change:
                sound = [verdict for verdict in verdicts if isinstance(verdict, standards.Verdict)]
                changes += cheapest_changes(terms.case, sound, stage)
    for name in named:
        if isinstance(refusal := judged[name], standards.Refusal):
            raise refusal.reason
    return [judged[name] for name in names], changes, [*dict.fromkeys(notes)]


def _evaluated(case: Case, folder: Path | None, stage: Stage) -> Result:
    """Evaluate a case, and write its results to a folder where one is named."""
    from drcmitsuba import evaluate

    result = evaluate(case, stage)
    if folder is not None:
        result.save(folder, stage)
    return result


def _view(case: str, weather: Path | None) -> ViewOut:
    """View out of the sensors of a case."""
    from drcmitsuba import view_distances
    from drcmitsuba.standards import view_out

    return view_out(view_distances(load(case, weather)))


def _lines(changes: Sequence[Change | Refusal]) -> Iterator[str]:
    """Lines of the changes, headed by their standards where there are several."""
    from drcmitsuba.standards import Refusal

    for change in changes:
        head = f"{change.standard}: " if len(changes) > 1 else ""
        if isinstance(change, Refusal):
            yield f"{head}cheapest change: cannot be told: {change.reason}"
            continue
        first, *others = change.text()
        yield from (head + first, *others)


def _show_all(judged: list[Verdict | Refusal]) -> None:
    """Table with a row for each standard; what they took, and why there is no verdict."""
    from drcmitsuba.standards import Refusal
    from drcmitsuba.standards.verdict import likelihood

    table = Table()
    table.add_column("standard", no_wrap=True)
    for column in ("verdict", "probability", "nearest limit"):
        table.add_column(column)
    reasons = []
    for verdict in judged:
        if isinstance(verdict, Refusal):
            reasons.append(f"{verdict.standard}: {verdict.reason.got}; {verdict.reason.remedy}")
            table.add_row(verdict.standard, "no verdict", "", "")
            continue
        if verdict.undecided is not None:
            reasons.append(f"{verdict.standard}: {verdict.undecided}")
            values = ", ".join(_quantity(verdict, name) for name in verdict.quantities)
            table.add_row(verdict.standard, "cannot be decided", "", values)
            continue
        shown = next((o for o in reversed(verdict.levels) if o.reached), verdict.levels[0])
        reached = likelihood(verdict.probability)
        if verdict.level is None:
            reached += f" ({verdict.levels[0].name})"
        stated = verdict.stated() + (f" {CONDITION}" if verdict.conditions else "")
        table.add_row(verdict.standard, stated, reached, _margin(shown.margin))
    show(table)
    show_notes([*_by_standard(judged), *reasons])
    print("details: drcmitsuba comply … --standard NAME")


def _by_standard(judged: list[Verdict | Refusal]) -> list[str]:
    """Lines on what a case lacks and what standards took in its place, each with their names."""
    from drcmitsuba.standards import Refusal

    names = dict[str, list[str]]()
    for verdict in judged:
        if isinstance(verdict, Refusal):
            continue
        for line in (*(f"{CONDITION} {c}" for c in verdict.conditions), *verdict.taken):
            names.setdefault(line, []).append(verdict.standard)
    return [f"{', '.join(of_line)}: {line}" for line, of_line in names.items()]


def _show_verdict(verdict: Verdict) -> None:
    """Verdict in full: levels, what decides, duties, notes and sources."""
    from drcmitsuba.standards import read
    from drcmitsuba.standards.verdict import likelihood

    standard = read(verdict.standard)
    print(f"{verdict.title} ({verdict.edition}; sources read {standard.read})")
    if verdict.undecided is None:
        lowest = "" if verdict.level is not None else f" of {verdict.levels[0].name}"
        print(
            f"verdict: {verdict.stated()}; probability{lowest}: {likelihood(verdict.probability)}"
        )
    else:
        print(f"verdict: {verdict.stated()}")
    for name, quantity in standard.quantities.items():
        print(f"{_quantity(verdict, name)}: {quantity.meaning}")
    if verdict.levels:
        table = Table("level", "reached", "probability", "nearest limit")
        for outcome in (*verdict.levels, *verdict.extras):
            table.add_row(*_row(outcome, likelihood(outcome.probability)))
        show(table)
    if verdict.deciding is not None:
        print(f"what decides: {verdict.deciding.text()}")
    for duty in verdict.duties:
        print(f"duty: {on_a_line(duty)}")
    show_notes([*verdict.conditions, *verdict.taken, *verdict.notes])
    for sure, sources in standard.sources.items():
        print(f"source, {sure}: {'; '.join(sources)}")


def _row(outcome: Outcome, probability: str) -> tuple[str, ...]:
    reached = "yes" if outcome.reached else "no"
    failing = sum(not held for held in outcome.spaces.values())
    if len(outcome.spaces) > 1 and failing:
        reached += f", {failing} of {len(outcome.spaces)} spaces fail"
    return outcome.name, reached, probability, _margin(outcome.margin)


def _margin(margin: Margin) -> str:
    """Write a margin: "sDA 71.2 % of 75 % (−3.8)"."""
    space = f" in {on_a_line(margin.space)}" if margin.space else ""
    digits = 1 if margin.unit == "%" else 0
    value, distance = f"{margin.value:.{digits}f}", f"{margin.distance:+.{digits}f}"
    distance = distance.replace("-", "−")
    of = f"{margin.quantity} {value} {margin.unit} of {margin.limit:g} {margin.unit}"
    return escape(f"{of} ({distance}){space}")


def _quantity(verdict: Verdict, name: str) -> str:
    """Write a quantity with its interval: "sDA 71.2 (70.1 … 72.4) %"."""
    i, unit = verdict.quantities[name], verdict.units[name]
    digits = 1 if unit == "%" else 0
    value, low, high = (f"{x:.{digits}f}" for x in (i.value, i.low, i.high))
    return f"{name} {value} ({low} … {high}) {unit}"
