"""The command `drcmitsuba optimise`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.terminal import Output, stages

if TYPE_CHECKING:
    from drcmitsuba.case.case import Case
    from drcmitsuba.design.layout import Layout
    from drcmitsuba.design.optimise import FacadeOptimum, Front, Optimum
    from drcmitsuba.design.tilt_search import TiltOptimum
    from drcmitsuba.runtime.progress import Stage

WRITTEN = (
    "pareto.csv", "pareto.png", "facade.png", "search.png", "tilt.png", "fresh_metrics.json",
)  # fmt: skip
LOOSEST = 2.0
"""Largest limit of the sweep over the one asked for."""


def optimise(
    case: Annotated[str, typer.Argument(help="Case file (TOML) with a table [design].")],
    output: Output = Path("design"),
    weather: Annotated[
        Path | None, typer.Option("--weather", help="Weather file in place of the case's own.")
    ] = None,
) -> None:
    """Find the best façade: film, window, transmittances; or the best tilt of lamellae.

    Ctrl-C ends the search and keeps the best so far.
    """
    from drcmitsuba.case.case import load_case

    loaded = load_case(case).with_weather(weather)
    is_tilt = loaded.design is not None and loaded.design.component is not None
    with stages() as stage:
        (_tilt if is_tilt else _facade)(loaded, output, stage)
    print(f"results are in {output}")


def _facade(case: Case, output: Path, stage: Stage) -> None:
    """Find a façade, and what less sun costs."""
    from drcmitsuba.annual.result import evaluate
    from drcmitsuba.design.layout import Layout
    from drcmitsuba.design.optimise import optimise as search
    from drcmitsuba.design.optimise import pareto
    from drcmitsuba.runtime import backend

    layout = Layout.of(case)
    backend.select()
    year = layout.year(stage)
    problem = layout.problem(year)
    with stage("search") as done:
        found = search(problem, layout.search, done, layout.known(problem))
    _save_numbers(found, output)
    front = None
    if layout.design.pareto > 0 and found.finished:
        with stage("Pareto front") as done:
            front = pareto(found, _limits(layout), layout.search, done)
        front.save(output / "pareto.csv")
    fresh = evaluate(layout.built(found), stage) if found.finished else None
    with stage("writing"):
        _save(layout, found, front, fresh, output)
    rows = [("film", found.best.hard.film_area), ("panes", found.best.hard.window_area)]
    _print(found, "best façade", fresh, [(key, f"{area:.2f} m²") for key, area in rows])
    print(f"{found.evaluations} evaluations with gradients in {found.seconds:.1f} s")
    if front is not None:
        print(f"{len(front.points)} façades on the Pareto front (pareto.csv)")


def _tilt(case: Case, output: Path, stage: Stage) -> None:
    """Find a tilt of lamellae."""
    from drcmitsuba.annual.result import evaluate
    from drcmitsuba.design.tilt import Turned
    from drcmitsuba.design.tilt_search import turn
    from drcmitsuba.runtime import backend

    backend.select()
    problem = Turned.of(case, stage)
    assert problem.case.design is not None
    with stage("search") as done:
        found = turn(problem, problem.case.design.sharpness[-1], done)
    _save_numbers(found, output)
    tilt = problem.at(found.best.x)
    fresh = evaluate(problem.afresh(tilt), stage) if found.finished else None
    with stage("writing"):
        _save_tilt(found, fresh, output)
    _print(found, "best tilt", fresh, [])
    if alike := problem.alike(tilt):
        print(f"{len(alike)} other tilts are not told apart from it: their intervals overlap")
    print(f"{len(problem.known)} tilts simulated in {found.seconds:.1f} s")


def _save_numbers(found: Optimum, output: Path) -> None:
    """Write what was found, after clearing what another search has left."""
    for old in WRITTEN:  # beside which the new numbers would be misread
        (output / old).unlink(missing_ok=True)
    found.save(output)


def _limits(layout: Layout) -> list[float]:
    """Limits of the sweep [%], from 0 to beyond the one asked for."""
    most = min(100.0, LOOSEST * max(layout.design.ase_limit, 5.0))
    count = layout.design.pareto
    return [most * i / max(count - 1, 1) for i in range(count)]


def _save(
    layout: Layout, found: FacadeOptimum, front: Front | None, fresh: Any, output: Path
) -> None:
    """Write the pictures, and what the fresh evaluation says."""
    from drcmitsuba.design import pictures
    from drcmitsuba.report import plots
    from drcmitsuba.runtime import storage

    year, best = found.problem.year, found.best
    numbers = f"ASE {best.hard.ase:.1f} %, {_aim(found)} {best.hard.aim:.1f} %"
    title = f"{layout.case.name}: {numbers}"
    drawn = pictures.facade(year.tiles, best.share, year.materials, layout.film, title)
    plots.save(drawn, output / "facade.png")
    plots.save(pictures.search(found), output / "search.png")
    if front is not None:
        plots.save(pictures.front(front, chosen=best.hard), output / "pareto.png")
    if fresh is not None:
        storage.save_json(fresh.metrics, output / "fresh_metrics.json")


def _save_tilt(found: TiltOptimum, fresh: Any, output: Path) -> None:
    """Write the pictures, and what the fresh evaluation says."""
    from drcmitsuba.design import pictures
    from drcmitsuba.report import plots
    from drcmitsuba.runtime import storage

    plots.save(pictures.tilts(found), output / "tilt.png")
    plots.save(pictures.search(found), output / "search.png")
    if fresh is not None:
        storage.save_json(fresh.metrics, output / "fresh_metrics.json")


def _aim(found: Optimum) -> str:
    """Name of what is to be large."""
    return "sDA" if found.problem.goal.aim == "sDA" else "msDA of the worst month"


def _print(found: Optimum, title: str, fresh: Any, rows: list[tuple[str, str]]) -> None:
    table = Table("", "found", "simulated afresh (95 %)", title=escape(title), title_justify="left")
    again = dict.fromkeys(("sDA", "ASE"), "–")
    if fresh is not None:
        for name in again:
            v = fresh.metrics[name]
            again[name] = f"{v['value']:.1f} ({v['low']:.1f} … {v['high']:.1f}) %"
    hard, aim = found.best.hard, _aim(found)
    table.add_row(aim, f"{hard.aim:.1f} %", again["sDA"] if aim == "sDA" else "–")
    table.add_row("ASE", f"{hard.ase:.1f} %", again["ASE"])
    for row in rows:
        table.add_row(*row, "")
    for key, values in found.problem.named(found.best.x).items():
        if len(values) == 1:
            table.add_row(key, f"{values[0]:.3f}", "")
    Console().print(table)
    if not found.is_feasible:
        print("nothing that holds all limits was found; this is the nearest")
    if not found.finished:
        print("stopped: the best so far")
