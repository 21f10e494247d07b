"""The command `drcmitsuba optimise`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from drcmitsuba.terminal import Output, stages

if TYPE_CHECKING:
    from drcmitsuba.design.layout import Layout
    from drcmitsuba.design.optimise import Front, Optimum

WRITTEN = (
    "pareto.csv", "pareto.png", "facade.png", "search.png", "fresh_metrics.json",
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
    """Find the best façade: film, window, transmittances; and what less sun costs.

    Ctrl-C ends the search and keeps the best so far.
    """
    from drcmitsuba import backend
    from drcmitsuba.case import load_case
    from drcmitsuba.design.layout import Layout
    from drcmitsuba.design.optimise import optimise as search
    from drcmitsuba.design.optimise import pareto
    from drcmitsuba.result import evaluate

    loaded = load_case(case).with_weather(weather)
    layout = Layout.of(loaded)
    backend.select()
    with stages() as stage:
        year = layout.year(stage)
        problem = layout.problem(year)
        with stage("search") as done:
            found = search(problem, layout.search, done, layout.known(problem))
        for old in WRITTEN:  # of another search, beside which the new numbers would be misread
            (output / old).unlink(missing_ok=True)
        found.save(output)
        front = None
        if layout.design.pareto > 0 and found.finished:
            with stage("Pareto front") as done:
                front = pareto(found, _limits(layout), layout.search, done)
            front.save(output / "pareto.csv")
        fresh = evaluate(layout.built(found), stage) if found.finished else None
        with stage("writing"):
            _save(layout, found, front, fresh, output)
    _print(found, front, fresh)
    print(f"results are in {output}")


def _limits(layout: Layout) -> list[float]:
    """Limits of the sweep [%], from 0 to beyond the one asked for."""
    most = min(100.0, LOOSEST * max(layout.design.ase_limit, 5.0))
    count = layout.design.pareto
    return [most * i / max(count - 1, 1) for i in range(count)]


def _save(layout: Layout, found: Optimum, front: Front | None, fresh: Any, output: Path) -> None:
    """Write the pictures, and what the fresh evaluation says."""
    from drcmitsuba import design_pictures as pictures
    from drcmitsuba import plots, schema

    year, best = found.problem.year, found.best
    numbers = f"ASE {best.hard.ase:.1f} %, {_aim(found)} {best.hard.aim:.1f} %"
    title = f"{layout.case.name}: {numbers}"
    drawn = pictures.facade(year.tiles, best.share, year.materials, layout.film, title)
    plots.save(drawn, output / "facade.png")
    plots.save(pictures.search(found), output / "search.png")
    if front is not None:
        plots.save(pictures.front(front, chosen=best.hard), output / "pareto.png")
    if fresh is not None:
        schema.save_json(fresh.metrics, output / "fresh_metrics.json")


def _aim(found: Optimum) -> str:
    """Name of what is to be large."""
    return "sDA" if found.problem.goal.aim == "sDA" else "msDA of the worst month"


def _print(found: Optimum, front: Front | None, fresh: Any) -> None:
    table = Table("", "found", "simulated afresh (95 %)", title="best façade", title_justify="left")
    again = dict.fromkeys(("sDA", "ASE"), "–")
    if fresh is not None:
        for name in again:
            v = fresh.metrics[name]
            again[name] = f"{v['value']:.1f} ({v['low']:.1f} … {v['high']:.1f}) %"
    hard, aim = found.best.hard, _aim(found)
    table.add_row(aim, f"{hard.aim:.1f} %", again["sDA"] if aim == "sDA" else "–")
    table.add_row("ASE", f"{hard.ase:.1f} %", again["ASE"])
    table.add_row("film", f"{hard.film_area:.2f} m²", "")
    table.add_row("panes", f"{hard.window_area:.2f} m²", "")
    for key, values in found.problem.named(found.best.x).items():
        if len(values) == 1:
            table.add_row(key, f"{values[0]:.3f}", "")
    Console().print(table)
    if not found.is_feasible:
        print("no façade that holds all limits was found; this one is the nearest")
    if not found.finished:
        print("stopped: the best so far")
    print(f"{found.evaluations} evaluations with gradients in {found.seconds:.1f} s")
    if front is not None:
        print(f"{len(front.points)} façades on the Pareto front (pareto.csv)")
