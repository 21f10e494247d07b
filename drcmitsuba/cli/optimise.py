"""The command `drcmitsuba optimise`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import Output, Weather, argument, load
from drcmitsuba.cli.terminal import percent, show, show_notes, stages
from drcmitsuba.runtime.errors import on_a_line
from drcmitsuba.runtime.folder_lock import locked

if TYPE_CHECKING:
    from drcmitsuba.annual.result import Result
    from drcmitsuba.case.case import Case
    from drcmitsuba.design.optimise import FacadeOptimum
    from drcmitsuba.design.search import Optimum
    from drcmitsuba.glare_year import GlareYear
    from drcmitsuba.runtime.progress import Stage

WRITTEN = (
    "optimum.json", "history.csv", "pareto.csv", "pareto.png", "facade.png", "panes.png",
    "search.png", "tilt.png", "fresh_metrics.json", "windows.csv",
)  # fmt: skip
LOOSEST = 2.0
"""Ratio of the largest ASE limit on the Pareto front to the limit of the case."""


def optimise(
    case: Annotated[str, argument("CASE", "Case file (TOML) with a table [design].")],
    output: Output = Path("design"),
    weather: Weather = None,
) -> None:
    """Find the best façade: film, window, transmittances; or the best tilt of lamellae.

    Ctrl-C or SIGTERM ends the search and keeps the best design so far.
    """
    loaded = load(case, weather)
    is_tilt = loaded.design is not None and loaded.design.component is not None
    from drcmitsuba.plan import without_rounds

    with locked(output), stages() as stage:
        notes = (_tilt if is_tilt else _facade)(loaded, output, stage)
    show_notes(dict.fromkeys([*notes, *without_rounds(loaded.accuracy.goal)]))
    print(f"results are in {output}")


def _facade(case: Case, output: Path, stage: Stage) -> Sequence[str]:
    """Search the best façade, and the best façades under other limits of ASE; return notes."""
    from drcmitsuba.design import pictures
    from drcmitsuba.design.any_layout import layout_of
    from drcmitsuba.design.measure import NAMES
    from drcmitsuba.design.optimise import optimise as search
    from drcmitsuba.design.optimise import pareto
    from drcmitsuba.glare_year import EyesOfSearch
    from drcmitsuba.report import plots
    from drcmitsuba.runtime import backend, storage

    backend.select()
    layout = layout_of(case)
    problem = layout.problem(layout.year(stage, EyesOfSearch.of))
    with stage("search") as done:
        optimum = search(problem, layout.search, done, layout.known(problem))
    _save_numbers(optimum, output)
    front = None
    if layout.design.pareto > 0 and optimum.finished:
        most = min(100.0, LOOSEST * max(layout.design.ase_limit, 5.0))
        count = layout.design.pareto
        limits = [most * i / max(count - 1, 1) for i in range(count)]
        with stage("Pareto front") as done:
            front = pareto(optimum, limits, layout.search, done)
        optimum = front.optimum
        _save_numbers(optimum, output)
        front.save(output / "pareto.csv")
    tables = layout.tables(optimum.best.share)
    for name, table in tables.items():
        storage.save_csv(table, output / name)
    hard = optimum.best.hard
    title = f"{case.name}: ASE {hard.ase:.1f} %, {NAMES[problem.goal.aim]} {hard.aim:.1f} %"
    with stage("writing"):
        for name, picture in layout.pictures(optimum, title).items():
            plots.save(picture, output / name)
        plots.save(pictures.search(optimum), output / "search.png")
        if front is not None:
            plots.save(pictures.front(front, chosen=hard), output / "pareto.png")
    fresh = _saved(layout.afresh(optimum, stage), output) if optimum.finished else None
    areas = {"film": hard.film_area, "panes": hard.window_area}
    _print(optimum, "best façade", fresh, areas)
    if fresh is not None:
        for line in _compared(optimum, str(layout.design.standard), fresh, layout.cuts_tiles):
            print(line)
    if fresh is not None and layout.design.asks_glare:
        print(_glare(layout.glare_afresh(optimum, stage), hard.glare, layout.design.glare_limit))
    print(f"{optimum.evaluations} façades by all hours in {optimum.seconds:.1f} s")
    for name in tables:
        print(
            f"{name}: to draw the new windows into the model, lay it beside the case, and give "
            f'windows = "{name}" in [model]'
        )
    if front is not None:
        print(f"{len(front.points)} façades on the Pareto front (pareto.csv)")
    return [*layout.notes, *_notes(fresh)]


def _tilt(case: Case, output: Path, stage: Stage) -> Sequence[str]:
    """Search the best tilt of lamellae."""
    from drcmitsuba.annual.result import evaluate
    from drcmitsuba.design import pictures
    from drcmitsuba.design.tilt import TiltProblem
    from drcmitsuba.design.tilt_search import optimise_tilt
    from drcmitsuba.report import plots
    from drcmitsuba.runtime import backend

    backend.select()
    problem = TiltProblem.of(case, stage)
    assert case.design is not None
    with stage("search") as done:
        optimum = optimise_tilt(problem, case.design.sharpness[-1], done)
    _save_numbers(optimum, output)
    tilt = problem.at(optimum.best.x)
    with stage("writing"):
        plots.save(pictures.tilts(optimum), output / "tilt.png")
        plots.save(pictures.search(optimum), output / "search.png")
    fresh = _saved(evaluate(problem.afresh(tilt), stage), output) if optimum.finished else None
    _print(optimum, "best tilt", fresh, {})
    if indistinct := problem.indistinct(tilt):
        print(f"{len(indistinct)} other tilts may be as good: their intervals overlap")
    print(f"{len(problem.simulated)} tilts simulated in {optimum.seconds:.1f} s")
    return _notes(fresh)


def _notes(fresh: Result | None) -> list[str]:
    """Notes on an optimum that was simulated afresh."""
    return [] if fresh is None else list(fresh.metrics["settings"]["notes"])


def _save_numbers(optimum: Optimum, output: Path) -> None:
    """Write numbers and history of an optimum, after deleting the files of another search."""
    for old in WRITTEN:  # files of an older search would belie the new numbers
        (output / old).unlink(missing_ok=True)
    optimum.save(output)


def _saved(fresh: Result, output: Path) -> Result:
    """Write the metrics of an optimum that was simulated afresh."""
    from drcmitsuba.runtime import storage

    storage.save_json(fresh.metrics, output / "fresh_metrics.json")
    return fresh


def _nearest(optimum: Optimum) -> str:
    """Say that no design holds the limits, and how near a least aim was come."""
    hard, goal = optimum.best.hard, optimum.problem.goal
    if not optimum.problem.holds_limits(hard):
        return "no evaluated design holds all limits; this design comes nearest"
    if goal.requirement is not None:
        return (
            f"{goal.requirement.title} is not reached: by the best that holds the other limits, "
            f"its least margin is {hard.aim:.1f} %"
        )
    return (
        f"sDA ≥ {goal.least.aim:g} % is not reached: the highest that holds the other limits is "
        f"{hard.aim:.1f} %"
    )


def _glare(year: GlareYear, searched: float | None, limit: float | None) -> str:
    """Say how many hours of glare there are afresh, and whether they are within a limit [%]."""
    from drcmitsuba.glare_year.searched_eyes import LIMIT, worst_view

    view, share = worst_view(year)
    ends = {name: float(share[name]) for name in ("value", "low", "high")}
    words = f"hours with DGP above {LIMIT:.2f} at {on_a_line(view)}, the worst view: "
    words += f"{searched:.1f} % by the search, {percent(ends)} % afresh"
    if limit is None:
        return words
    held = "holds" if ends["value"] <= limit else "exceeds"
    return f"{words}, which {held} the limit of {limit:g} %"


def _compared(
    optimum: FacadeOptimum, standard: str, fresh: Result, cuts_tiles: bool
) -> Iterator[str]:
    """Yield lines on whether an optimum that was simulated afresh has what was asked for.

    Where the search has found otherwise, the tiles that were cut are told.
    """
    from drcmitsuba.standards import Evidence, verdict
    from drcmitsuba.standards.verdict import likelihood

    goal, best = optimum.problem.goal, optimum.best
    held, holds = best.hard.aim >= 0, True
    if goal.requirement is not None:
        judged = verdict(standard, Evidence.of_result(fresh))
        level = next(x for x in judged.levels if x.name == goal.requirement.level.name)
        holds = level.reached
        how = "reached" if holds else "not reached"
        title = goal.requirement.title
        yield f"{title}: {how} afresh, probability {likelihood(level.probability)}"
    elif goal.least is not None:
        held = best.hard.aim >= goal.least.aim
        holds = fresh.metrics["sDA"]["value"] >= goal.least.aim
    otherwise, limit = holds != held, goal.ase_limit
    if limit is not None and best.hard.ase <= limit < (ase := fresh.metrics["ASE"]["value"]):
        yield f"ASE is {ase:.1f} % afresh, above its limit of {limit:g} %"
        otherwise = True
    if cuts_tiles and best.mixed and otherwise:
        tiles = "1 tile was" if best.mixed == 1 else f"{best.mixed} tiles were"
        yield (
            f"the search finds otherwise: it mixes materials within a tile, and {tiles} cut in "
            "height afresh; give more rows"
        )


def _print(optimum: Optimum, title: str, fresh: Result | None, areas: dict[str, float]) -> None:
    """Print metrics and areas [m²] of the best design, by the search and simulated afresh."""
    from drcmitsuba.design.measure import AIMS_OF_METRICS, NAMES, interval_of_aim

    table = Table(
        "", "by the search", "simulated afresh (95 %)", title=escape(title), title_justify="left"
    )
    goal, numbers = optimum.problem.goal, {} if fresh is None else dict(fresh.metrics)
    if fresh is not None and goal.aim in AIMS_OF_METRICS:
        numbers[NAMES[goal.aim]] = interval_of_aim(fresh.metrics, goal.aim).to_dict()
    searched = {NAMES[goal.aim]: optimum.best.hard.aim, "ASE": optimum.best.hard.ase}
    for name in dict.fromkeys((NAMES[goal.aim], "sDA", "ASE")):
        own = f"{searched[name]:.1f} %" if name in searched else "–"
        again = f"{percent(numbers[name])} %" if name in numbers else "–"
        table.add_row(name, own, again)
    for key, area in areas.items():
        table.add_row(key, f"{area:.2f} m²", "")
    for key, values in optimum.values.items():
        if len(values) == 1:
            table.add_row(key, f"{values[0]:.3f}", "")
    show(table)
    if not optimum.is_feasible:
        print(_nearest(optimum))
    if not optimum.finished:
        print("stopped: this is the best design so far")
