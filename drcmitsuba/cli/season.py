"""The command `drcmitsuba season`."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from drcmitsuba.cli.options import CaseName, Output, Weather, load
from drcmitsuba.cli.terminal import percent, show, show_notes, stages
from drcmitsuba.runtime.folder_lock import locked


def season(case: CaseName, output: Output = Path("season"), weather: Weather = None) -> None:
    """Compare msDA of each month with clear glazing and with an open window, to show the season."""
    from drcmitsuba.annual.season import season as compare

    with locked(output), stages() as stage:
        shares = compare(load(case, weather), stage)
        with stage("writing"):
            shares.save(output)
    table = Table("month", "msDA %", "clear glazing %", "opening %", "of the opening %")
    rows = zip(shares.design, shares.clear, shares.opening, shares.relative, strict=True)
    for month, (*metrics, relative) in enumerate(rows, start=1):
        share = "–" if relative is None else f"{relative:.0f}"
        table.add_row(str(month), *map(percent, metrics), share)
    show(table)
    show_notes(shares.notes)
    print(f"results are in {output}")
