"""Text that somebody else wrote: bounded, decoded, its rows counted, refused line by line."""

from __future__ import annotations

import calendar
import csv
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from drcmitsuba.runtime.errors import InputError

BYTES = 32 * 2**20
LINES = 600_000  # a year of minutes has 525 600
CUT = "the file is cut or damaged: get it again"


def read_text(path: str | Path) -> str:
    r"""Read a text file of at most 32 MiB and 600 000 lines, in UTF-8 or, failing that, Latin-1.

    Lines of the text end in "\n", whatever they ended in. A file that is missing, unreadable,
    empty, binary or too large raises InputError.
    """
    path = Path(path)
    try:
        if not path.is_file():
            raise InputError(path, "file", "no such file", "give the path of a file")
        with path.open("rb") as file:
            raw = file.read(BYTES + 1)
    except OSError as error:
        raise InputError(path, "file", error.strerror or "unreadable", "check the file") from error
    remedy = "give the text file as its publisher made it"
    if not raw.strip():
        raise InputError(path, "file", "empty", remedy)
    if len(raw) > BYTES:
        raise InputError(path, "file", f"more than {BYTES // 2**20} MiB", remedy)
    if b"\0" in raw:
        raise InputError(path, "file", "binary data (zero bytes)", remedy)
    raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if raw.count(b"\n") > LINES:
        raise InputError(path, "file", f"more than {LINES} lines", remedy)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


class NumberedRows(NamedTuple):
    """Rows of a file without 29 February, each with its line number."""

    path: Path
    lines: list[str]
    numbers: list[int]
    leap_rows: int

    def refuse(self, name: str, column: pd.Series, bad: np.ndarray, what: str, remedy: str) -> None:
        """Raise InputError for the first bad row of a column, and say how many there are."""
        if bad.any():
            row = int(np.argmax(bad))
            got = f"{show(column.iloc[row])}, {what} (rows like it: {np.count_nonzero(bad)})"
            raise InputError(self.path, f"line {self.numbers[row]}, {name}", got, remedy)


def rows_of(
    path: Path,
    lines: list[str],
    first: int,
    split: Callable[[str], list[str]],
    day_and_hour: Callable[[list[str]], Sequence[str]],
    least: int,
) -> NumberedRows:
    """Rows from line `first` on, whole and dated; a row that was cut has fewer fields."""
    kept, numbers, leap_rows, width = [], [], 0, 0
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        fields = split(line.rstrip())
        width = width or max(len(fields), least)
        if len(fields) != width:
            got = f"{len(fields)} fields, not {width}"
            raise InputError(path, f"line {number}", got, CUT)
        try:
            month, day, hour = (int(field) for field in day_and_hour(fields))
            valid = 1 <= month <= 12 and 1 <= day <= calendar.monthrange(2016, month)[1]
        except ValueError:
            valid = False
        if not (valid and 1 <= hour <= 24):
            remedy = "a row starts with month, day and hour"
            raise InputError(path, f"line {number}, date", show(line), remedy)
        if (month, day) == (2, 29):
            leap_rows += 1
        else:
            kept.append(line.rstrip())
            numbers.append(number)
    if not kept:
        raise InputError(path, "rows", "none", CUT)
    return NumberedRows(path, kept, numbers, leap_rows)


def number(path: Path, field: str, got: str | float, low: float, high: float) -> float:
    """Number of a head line from `low` to `high`; anything else raises InputError."""
    try:
        value = float(got)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise InputError(path, field, show(got), f"use a number from {low} to {high}")
    return value


def quoted(path: Path, line: str) -> list[str]:
    """Fields of a head line, where a name in quotes may hold a comma."""
    try:
        return [field.strip() for field in next(csv.reader([line], skipinitialspace=True))] or [""]
    except csv.Error as error:
        raise InputError(path, "line 1", show(line), CUT) from error


def fields(line: str) -> list[str]:
    """Split a row at its commas."""
    return [field.strip() for field in line.replace('"', "").split(",")]


def show(value: object) -> str:
    """Quote a value that came, cut to 60 characters."""
    text = str(value)
    return repr(text if len(text) <= 60 else text[:57] + "...")
