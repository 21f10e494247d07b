"""Tables of the report, the same for HTML and Markdown; numbers keep all their digits."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drcmitsuba.runtime.errors import on_a_line

NONE = "–"
"""Cell without a value."""
LINE = "\n"
"""End of a line within a cell."""


@dataclass(frozen=True)
class Number:
    """Number that is shown with few digits, and kept with those of `metrics.json`."""

    value: float
    digits: int = 1
    signed: bool = False

    @property
    def exact(self) -> str:
        """Number as JSON writes it."""
        return json.dumps(self.value)

    def __str__(self) -> str:
        value = round(self.value, self.digits) + 0.0  # −0 becomes 0
        shown = f"{value:{'+' if self.signed else ''}.{self.digits}f}"
        return shown.replace("-", "−")


Cell = tuple[str | Number, ...]
"""Parts of a cell, which follow each other."""


@dataclass(frozen=True)
class PageTable:
    """Table with a name for every row in its first column."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


def text(value: object) -> str:
    """Text from a file, on one line and without characters that would act on a page."""
    return on_a_line(str(value))


def plain(value: object) -> Cell:
    """Cell of text from a file."""
    return (text(value),)


def interval(number: Mapping[str, float] | None, unit: str = "%", digits: int = 1) -> Cell:
    """Cell of a value with its 95 % interval: "71.2 (70.1 … 72.4) %"."""
    if number is None:
        return (NONE,)
    value, low, high = (Number(number[key], digits) for key in ("value", "low", "high"))
    return value, " (", low, " … ", high, f") {unit}"


def in_columns(title: str, first: str, names: list[str], rows: Mapping[str, list[Cell]],
               note: str = "") -> PageTable:  # fmt: skip
    """Table with a column for each façade; `rows` are its cells by the name of the row."""
    cells = tuple((plain(name), *row) for name, row in rows.items())
    return PageTable(title, (first, *names), cells, note)


def share(value: Any) -> str:
    """Share of the time [%], where a plan states one."""
    known = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 1e6
    return f"{100 * value:.1f} %" if known else NONE
