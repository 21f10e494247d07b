"""The command `drcmitsuba glare`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import CaseName, Output, Weather, load, option
from drcmitsuba.cli.terminal import percent, show, show_notes, stages
from drcmitsuba.runtime.errors import InputError, on_a_line
from drcmitsuba.runtime.folder_lock import locked
from drcmitsuba.runtime.progress import rough

if TYPE_CHECKING:
    from drcmitsuba.case.accuracy import Accuracy

MOST_ROWS = 40
"""Largest number of views in the table."""


def _point(text: str) -> list[float]:
    """Coordinates x, y and z [m] of a text such as "4,3,1.2"."""
    try:
        numbers = [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise InputError("command line", "--around", repr(text), "give x,y,z [m], as 4,3,1.2")
    return numbers


def _tell(accuracy: Accuracy, seconds: float) -> None:
    """Print the forecast of the time [s], and of the rounds that may follow."""
    print(f"forecast: about {rough(seconds)} s{accuracy.rounds_toward(accuracy.eye_goal)}")


def glare(
    case: CaseName,
    output: Output = Path("glare"),
    weather: Weather = None,
    around: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y,Z", help="Eye that looks to eight sides [m]; may be repeated."),
    ] = None,
    threshold: Annotated[
        float, option("NUMBER", "Least luminance of sources [cd/m²]; up to 100 × the mean.")
    ] = 2000.0,
    paper: Annotated[
        bool, typer.Option("--paper", help="Constants of the paper on DGP, not of evalglare.")
    ] = False,
) -> None:
    """Evaluate a year of glare: DGP of every hour and view, classes of EN 17037, plots.

    Views are those of the case, or those of --around. The shade is open, closed and applied.
    Hours of the period with daylight are counted.
    """
    from drcmitsuba.glare_year import Rule
    from drcmitsuba.glare_year import glare as run
    from drcmitsuba.glare_year.result import EXCEEDED
    from drcmitsuba.picture.glare import EVALGLARE, PAPER

    points = [_point(text) for text in around] if around else None
    rule = Rule(threshold=threshold, constants=PAPER if paper else EVALGLARE)
    loaded = load(case, weather)
    with locked(output), stages() as stage:
        result = run(loaded, points, rule=rule, stage=stage, told=partial(_tell, loaded.accuracy))
        result.save(output, stage)
    numbers = result.numbers()
    show(*(_table(state, rows) for state, rows in numbers["DGP"].items()))
    for state, spaces in [*numbers.get("spaces", {}).items()][-1:]:
        show(_spaces_table(state, spaces))
    print(f"hours counted: {result.counting}; EN 17037 allows {100 * EXCEEDED:g} % of them")
    show_notes(numbers["settings"]["notes"])
    print(f"results are in {output}")


def _spaces_table(state: str, spaces: dict) -> Table:
    """Table of the worst view of every space in one state of the façade."""
    title = f"worst view of each space; façade {escape(state)}"
    table = Table("space", "views", "worst view", "EN 17037", title=title, title_justify="left")
    for name, row in list(spaces.items())[:MOST_ROWS]:
        words = (escape(on_a_line(text)) for text in (name, str(row["views"]), row["worst"]))
        chance = row["probability"][row["class"]]
        table.add_row(*words, f"{row['class']} ({chance:.2f})")
    if len(spaces) > MOST_ROWS:
        table.caption = f"{len(spaces) - MOST_ROWS} more spaces: glare.json, spaces"
    return table


def _table(state: str, rows: dict) -> Table:
    """Table of the views in one state of the façade."""
    title = f"hours [%] with DGP above a limit, 95 % interval; façade {escape(state)}"
    table = Table(title=title, title_justify="left")
    table.add_column("view")
    limits = next(iter(rows.values()))["above"]
    for limit in limits:
        table.add_column(f"above {limit}", justify="right")
    table.add_column("EN 17037", justify="right")
    for name, row in list(rows.items())[:MOST_ROWS]:
        shares = (percent(row["above"][limit]) for limit in limits)
        chance = row["probability"][row["class"]]
        table.add_row(escape(on_a_line(name)), *shares, f"{row['class']} ({chance:.2f})")
    if len(rows) > MOST_ROWS:
        table.caption = f"{len(rows) - MOST_ROWS} more views: glare.json"
    return table
