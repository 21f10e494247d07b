"""The command `drcmitsuba study`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import Output, Scheduler, WorkerCount, argument, option
from drcmitsuba.cli.terminal import show, show_notes, show_progress, stages
from drcmitsuba.runtime.errors import on_a_line

MOST_ROWS = 20
"""Largest number of rows in the table."""


def study(
    file: Annotated[Path, argument("STUDY", "Study file (TOML): a case, and keys with values.")],
    output: Output = Path("study"),
    cache: Annotated[
        Path | None, option("FOLDER", "Cache of coefficients; by default one in the output.")
    ] = None,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
) -> None:
    """Evaluate many variations of a case: a table of their metrics."""
    from pandas import isna

    from drcmitsuba.annual.study import SEPARATOR
    from drcmitsuba.annual.study import study as evaluate_rows
    from drcmitsuba.annual.workers import opened
    from drcmitsuba.case.study import load_study

    plan = load_study(file)
    with stages() as stage, opened(workers, scheduler) as others, stage("rows") as done:
        made = evaluate_rows(plan, output, cache, done, others, show_progress)
    frame, keys = made.frame, list(made.keys)
    table = Table("row", *map(escape, _tails(keys)), "sDA %", "ASE %")
    for _, row in frame.head(MOST_ROWS).iterrows():
        values = ("–" if isna(row[key]) else escape(on_a_line(str(row[key]))) for key in keys)
        shares = ("–" if row["error"] else f"{row[name]:.1f}" for name in ("sDA", "ASE"))
        table.add_row(str(row["row"]), *values, *shares)
    if len(frame) > MOST_ROWS:
        table.caption = f"{len(frame) - MOST_ROWS} more rows: table.csv"
    show(table)
    every = (note for notes in frame["notes"].dropna() for note in notes.split(SEPARATOR) if note)
    show_notes(dict.fromkeys(every))
    wrong = frame[frame["error"] != ""]
    for _, row in wrong.head(MOST_ROWS).iterrows():
        print(f"row {row['row']}: {on_a_line(row['error'])}")
    print(f"{len(frame) - len(wrong)} of {len(frame)} rows have metrics; table.csv in {output}")
    if len(wrong) == len(frame):
        raise SystemExit(2)


def _tails(keys: Sequence[str]) -> list[str]:
    """Ends of keys, as short as they differ: "glass.transmittance" of a longer one."""
    out = []
    for key in keys:
        parts, others = key.split("."), [f".{other}" for other in keys if other != key]
        tails = (".".join(parts[-n:]) for n in range(1, len(parts)))
        own = (tail for tail in tails if not any(o.endswith(f".{tail}") for o in others))
        out.append(next(own, key))
    return out
