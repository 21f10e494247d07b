"""Output of the commands on the terminal: progress bars, tables, notes."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, Task, TaskProgressColumn, TextColumn
from rich.progress import TimeRemainingColumn as TimeLeft
from rich.table import Table
from rich.text import Text

from drcmitsuba.runtime import progress
from drcmitsuba.runtime.errors import printable
from drcmitsuba.runtime.progress import Stage

COMPILING = ("forecast", "open façade", "shaded façade", "light by tile", "rays", "search")
"""Stages that begin by compiling kernels, unless earlier runs have."""


class _Share(TaskProgressColumn):
    """Column with the share of a stage that is done, or with "compiling"."""

    def render(self, task: Task) -> Text:
        if task.completed == 0 and task.description in COMPILING:
            return Text("compiling", style="progress.percentage")
        return super().render(task)


@contextmanager
def stages() -> Iterator[Stage]:
    """Progress bars on a terminal: yields a function that opens a stage by its name.

    The bars vanish where the work fails or is stopped; the line with the reason remains. Below the
    bars stands what was compiled, as in the first run after installation.
    """
    from drcmitsuba.runtime.compilation import recorded

    columns = (TextColumn("{task.description:<24}"), BarColumn(), _Share())
    console = Console(stderr=True)
    with Progress(
        *columns,
        TimeLeft(elapsed_when_finished=True),
        console=console,
        disable=not console.is_interactive,
    ) as bar:

        @contextmanager
        def stage(name: str) -> Iterator[progress.Progress]:
            task = bar.add_task(name, total=1.0)
            yield lambda share: bar.update(task, completed=share)
            bar.update(task, completed=1.0)

        try:
            if not console.is_interactive:
                yield stage
                return
            with recorded(stage) as (known, compilation):
                yield known
        except BaseException:
            bar.live.transient = True
            raise
    if compilation.line():
        console.print(compilation.line(), highlight=False)


def show_progress(line: str) -> None:
    """Print a line on the work that is going on, on stderr; it stands above the bars."""
    print(printable(line), file=sys.stderr)


def show(*tables: Table) -> None:
    """Print tables on stdout."""
    console = Console()
    for table in tables:
        console.print(table)


def percent(value: dict[str, float] | None, to: str = " … ") -> str:
    """Write a metric [%] with its 95 % interval, `to` between the ends."""
    if value is None:
        return "–"
    return f"{value['value']:.1f} ({value['low']:.1f}{to}{value['high']:.1f})"


def show_notes(notes: Iterable[str]) -> None:
    """Print notes on the results, one on each line."""
    for note in notes:
        print(f"note: {printable(note)}")
