"""The command `drcmitsuba tradeoff`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.terminal import Output, stages
from drcmitsuba.runtime.errors import InputError


def tradeoff(
    case: Annotated[str, typer.Argument(help="Case file (TOML), or a shipped case by name.")],
    output: Output = Path("tradeoff"),
    weather: Annotated[
        Path | None, typer.Option("--weather", help="Weather file in place of the case's own.")
    ] = None,
    minutes: Annotated[float, typer.Option(help="Time after which it stops.")] = 10.0,
) -> None:
    """Show what accuracy costs in time: error and seconds of many settings of a case."""
    from drcmitsuba.annual.tradeoff import tradeoff as measure
    from drcmitsuba.annual.tradeoff.errors import HEADER, NOT_RUN
    from drcmitsuba.case.case import load_case

    if not 0 < minutes < 1e6:
        raise InputError("command line", "--minutes", f"{minutes:g}", "give minutes above 0")
    loaded = load_case(case).with_weather(weather)
    with stages() as stage:
        found = measure(loaded, minutes, stage, lambda so_far: so_far.save_csv(output), print)
        found.save(output)
    title = f"{escape(found.name)}: what accuracy costs"
    table = Table(title=title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for name in HEADER:
        first = name == "setting"
        table.add_column(name, justify="left" if first else "right", no_wrap=first)
    for row in found.rows:
        if row.status != NOT_RUN:
            table.add_row(*row.cells())
    Console().print(table)
    for note in found.notes():
        print(note)
    missed = [row.name for row in found.rows if row.status == NOT_RUN]
    if missed:
        print(f"not run, the time was over: {'; '.join(missed)}")
    print(f"results are in {output}")
