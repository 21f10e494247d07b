"""The command `drcmitsuba tradeoff`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich import box
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import CaseName, Output, Weather, load, option
from drcmitsuba.cli.terminal import show, stages
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.folder_lock import locked

if TYPE_CHECKING:
    from drcmitsuba.annual.tradeoff import Tradeoff


def tradeoff(
    case: CaseName,
    output: Output = Path("tradeoff"),
    weather: Weather = None,
    minutes: Annotated[
        float, option("MINUTES", "Time limit of the command [min].", "--minutes")
    ] = 10.0,
) -> None:
    """Show what accuracy costs in time: error and seconds of many settings of a case."""
    from drcmitsuba.annual.tradeoff import tradeoff as measure
    from drcmitsuba.annual.tradeoff.errors import HEADER, NOT_RUN

    if not 0 < minutes < 1e6:
        raise InputError(
            "command line", "--minutes", f"{minutes:g}", "give minutes above 0 and below 1e6"
        )
    loaded = load(case, weather)

    def keep(so_far: Tradeoff) -> None:
        (output / "tradeoff.png").unlink(missing_ok=True)  # of another table
        so_far.save_csv(output)

    with locked(output), stages() as stage:
        measured = measure(loaded, minutes, stage, keep, print)
        measured.save(output)
    title = f"{escape(measured.name)}: what accuracy costs"
    table = Table(title=title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for name in HEADER:
        first = name == "setting"
        table.add_column(name, justify="left" if first else "right", no_wrap=first)
    for row in measured.rows:
        if row.status != NOT_RUN:
            table.add_row(*row.cells())
    show(table)
    for note in measured.notes():
        print(note)
    missed = [row.name for row in measured.rows if row.status == NOT_RUN]
    if missed:
        print(f"not run, the time was over: {'; '.join(missed)}")
    print(f"results are in {output}")
