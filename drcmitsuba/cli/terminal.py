"""What the commands share: folders for results, progress bars."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from drcmitsuba.runtime import progress
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage


def writable(folder: Path | None) -> Path | None:
    """Refuse a folder that cannot be written, before any work is done for it."""
    if folder is not None:
        there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
        if not there.is_dir():
            raise InputError(folder, "-o", f"{there} is a file", "name a folder")
        if not os.access(there, os.W_OK | os.X_OK):
            raise InputError(folder, "-o", f"{there} may not be written", "name another folder")
    return folder


Output = Annotated[
    Path, typer.Option("-o", "--output", callback=writable, help="Folder for the results.")
]


@contextmanager
def stages() -> Iterator[Stage]:
    """Progress bars on a terminal, one for each stage; yields what opens a stage.

    They vanish where the work fails or is stopped: what remains is the line that says why.
    """
    columns = (TextColumn("{task.description:<24}"), BarColumn(), TaskProgressColumn())
    console = Console(stderr=True)
    with Progress(
        *columns,
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console,
        disable=not console.is_interactive,
    ) as bar:

        @contextmanager
        def stage(name: str) -> Iterator[progress.Progress]:
            task = bar.add_task(name, total=1.0)
            yield lambda share: bar.update(task, completed=share)
            bar.update(task, completed=1.0)

        try:
            yield stage
        except BaseException:
            bar.live.transient = True
            raise
