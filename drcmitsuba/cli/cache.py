"""The command `drcmitsuba cache`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import argument, option
from drcmitsuba.cli.terminal import show
from drcmitsuba.runtime.errors import InputError, on_a_line

MOST_ROWS = 40
"""Largest number of entries in the table."""


def cache(
    folder: Annotated[Path, argument("FOLDER", "Folder of evaluate --cache.")],
    prune: Annotated[
        str | None, option("SIZE", 'Remove what was not used for longest, down to "2 GiB".')
    ] = None,
    limit: Annotated[
        str | None, option("SIZE", "Largest size from now on; each evaluation keeps to it.")
    ] = None,
) -> None:
    """List the coefficients that a cache keeps, or remove some."""
    from drcmitsuba.blocks.block_folder import BlockFolder
    from drcmitsuba.runtime.byte_size import byte_size, in_words

    most = None if limit is None else byte_size(limit, "--limit")
    down_to = None if prune is None else byte_size(prune, "--prune")
    if not folder.is_dir():
        raise InputError(folder, "cache", "no such folder", "name the folder of evaluate --cache")
    blocks = BlockFolder.cache(folder)
    if most is not None:
        blocks.set_limit(most)
    if down_to is not None or most is not None:
        removed = blocks.prune(down_to)
        print(f"removed {in_words(removed)}")
    entries = blocks.entries()
    table = Table("coefficients", "key")
    for column in ("size", "last used"):
        table.add_column(column, justify="right")
    for entry in entries[:MOST_ROWS]:
        used = time.strftime("%Y-%m-%d %H:%M", time.localtime(entry.used))
        about = escape(on_a_line(entry.about))
        table.add_row(about, entry.folder.name[:8], in_words(entry.size), used)
    show(table)
    whole = in_words(sum(entry.size for entry in entries))
    print(f"{len(entries)} entries, {whole} of at most {in_words(blocks.limit)}")
