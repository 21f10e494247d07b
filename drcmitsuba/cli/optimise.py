"""The command `drcmitsuba optimise`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import Output, Weather, load
from drcmitsuba.cli.terminal import show, stages

if TYPE_CHECKING:
    from drcmitsuba.annual.result import Result
    from drcmitsuba.case.case import Case
    from drcmitsuba.design.layout import Layout
    from drcmitsuba.design.optimise import FacadeOptimum, Front
    from drcmitsuba.design.search import Optimum
    from drcmitsuba.design.tilt_search import TiltOptimum
    from drcmitsuba.runtime.progress import Stage

WRITTEN = (
    "pareto.csv", "pareto.png", "facade.png", "search.png", "tilt.png", "fresh_metrics.json",
)  # fmt: skip
LOOSEST = 2.0
"""Ratio of the largest ASE limit on the Pareto front to the limit of the case."""


def optimise(
    case: Annotated[
        str, typer.Argument(metavar="CASE", help="Case file (TOML) with a table [design].")
    ],
    output: Output = Path("design"),
    weather: Weather = None,
) -> None:
    """Find the best façade: film, window, transmittances; or the best tilt of lamellae.

    Ctrl-C or SIGTERM ends the search and keeps the best design so far.
    """
    loaded = load(case, weather)
    is_tilt = loaded.design is not None and loaded.design.component is not None
    with stages() as stage:
        (_tilt if is_tilt else _facade)(loaded, output, stage)
    print(f"results are in {output}")


def _facade(case: Case, output: Path, stage: Stage) -> None:
    """Search the best façade, and the best façades under other limits of ASE."""
    from drcmitsuba.design.layout import Layout
    from drcmitsuba.design.optimise import optimise as search
    from drcmitsuba.design.optimise import pareto
    from drcmitsuba.runtime import backend

    layout = Layout.of(case)
    backend.select()
    year = layout.year(stage)
    problem = layout.problem(year)
    with stage("search") as done:
        optimum = search(problem, layout.search, done, layout.known(problem))
    _save_numbers(optimum, output)
    front = None
    if layout.design.pareto > 0 and optimum.finished:
        with stage("Pareto front") as done:
            front = pareto(optimum, _limits(layout), layout.search, done)
        front.save(output / "pareto.csv")
    with stage("writing"):
        _save(layout, optimum, front, output)
    finished = front.finished if front is not None else optimum.finished
    fresh = _afresh(layout.built(optimum), stage, output) if finished else None
    hard = optimum.best.hard
    rows = [("film", hard.film_area), ("panes", hard.window_area)]
    _print(optimum, "best façade", fresh, [(key, f"{area:.2f} m²") for key, area in rows])
    print(f"{optimum.evaluations} evaluations with gradients in {optimum.seconds:.1f} s")
    if front is not None:
        print(f"{len(front.points)} façades on the Pareto front (pareto.csv)")


def _tilt(case: Case, output: Path, stage: Stage) -> None:
    """Search the best tilt of lamellae."""
    from drcmitsuba.design.tilt import TiltProblem
    from drcmitsuba.design.tilt_search import optimise_tilt
    from drcmitsuba.runtime import backend

    backend.select()
    problem = TiltProblem.of(case, stage)
    assert problem.case.design is not None
    with stage("search") as done:
        optimum = optimise_tilt(problem, problem.case.design.sharpness[-1], done)
    _save_numbers(optimum, output)
    tilt = problem.at(optimum.best.x)
    with stage("writing"):
        _save_tilt(optimum, output)
    fresh = _afresh(problem.afresh(tilt), stage, output) if optimum.finished else None
    _print(optimum, "best tilt", fresh, [])
    if indistinct := problem.indistinct(tilt):
        print(f"{len(indistinct)} other tilts may be as good: their intervals overlap")
    print(f"{len(problem.simulated)} tilts simulated in {optimum.seconds:.1f} s")


def _save_numbers(optimum: Optimum, output: Path) -> None:
    """Write numbers and history of an optimum, after deleting the files of another search."""
    for old in WRITTEN:  # files of an older search would belie the new numbers
        (output / old).unlink(missing_ok=True)
    optimum.save(output)


def _limits(layout: Layout) -> list[float]:
    """Limits of ASE on the Pareto front [%], from 0 to beyond the limit of the case."""
    most = min(100.0, LOOSEST * max(layout.design.ase_limit, 5.0))
    count = layout.design.pareto
    return [most * i / max(count - 1, 1) for i in range(count)]


def _afresh(case: Case, stage: Stage, output: Path) -> Result:
    """Evaluate an optimum as a case of its own, and write its metrics."""
    from drcmitsuba.annual.result import evaluate
    from drcmitsuba.runtime import storage

    fresh = evaluate(case, stage)
    storage.save_json(fresh.metrics, output / "fresh_metrics.json")
    return fresh


def _save(layout: Layout, optimum: FacadeOptimum, front: Front | None, output: Path) -> None:
    """Write the pictures of a façade."""
    from drcmitsuba.design import pictures
    from drcmitsuba.report import plots

    year, best = optimum.problem.year, optimum.best
    numbers = f"ASE {best.hard.ase:.1f} %, {_aim(optimum)} {best.hard.aim:.1f} %"
    title = f"{layout.case.name}: {numbers}"
    drawn = pictures.facade(year.tiles, best.share, year.materials, layout.film, title)
    plots.save(drawn, output / "facade.png")
    plots.save(pictures.search(optimum), output / "search.png")
    if front is not None:
        plots.save(pictures.front(front, chosen=best.hard), output / "pareto.png")


def _save_tilt(optimum: TiltOptimum, output: Path) -> None:
    """Write the pictures of a tilt."""
    from drcmitsuba.design import pictures
    from drcmitsuba.report import plots

    plots.save(pictures.tilts(optimum), output / "tilt.png")
    plots.save(pictures.search(optimum), output / "search.png")


def _aim(optimum: Optimum) -> str:
    """Name of the metric that is maximised."""
    return "sDA" if optimum.problem.goal.aim == "sDA" else "msDA of the worst month"


def _print(optimum: Optimum, title: str, fresh: Result | None, rows: list[tuple[str, str]]) -> None:
    """Print the metrics of the best design, by the search and by a fresh simulation."""
    table = Table(
        "", "by the search", "simulated afresh (95 %)", title=escape(title), title_justify="left"
    )
    again = dict.fromkeys(("sDA", "ASE"), "–")
    if fresh is not None:
        for name in again:
            v = fresh.metrics[name]
            again[name] = f"{v['value']:.1f} ({v['low']:.1f} … {v['high']:.1f}) %"
    hard, aim = optimum.best.hard, _aim(optimum)
    table.add_row(aim, f"{hard.aim:.1f} %", again["sDA"] if aim == "sDA" else "–")
    table.add_row("ASE", f"{hard.ase:.1f} %", again["ASE"])
    for row in rows:
        table.add_row(*row, "")
    for key, values in optimum.values.items():
        if len(values) == 1:
            table.add_row(key, f"{values[0]:.3f}", "")
    show(table)
    if not optimum.is_feasible:
        print("no evaluated design holds all limits; this design comes nearest")
    if not optimum.finished:
        print("stopped: this is the best design so far")
