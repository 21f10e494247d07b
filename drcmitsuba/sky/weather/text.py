"""Text that somebody else wrote: bounded, decoded, its rows counted, refused line by line."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import compress
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from drcmitsuba.runtime.errors import InputError

BYTES = 32 * 2**20
LINES = 600_000  # a year of minutes has 525 600
CUT = "the file is cut or damaged: get it again"
DAYS = np.array([0, 31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31])
"""Number of days of each month of a leap year, January at 1."""

T = TypeVar("T")


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
    columns: list[tuple[str, ...]]
    """Fields of the rows, column by column: month, day, hour, then what the format has."""
    month: np.ndarray
    day: np.ndarray
    """Date of each row, int."""
    numbers: np.ndarray
    """Line number of each row, int."""
    leap_rows: int

    def refuse(
        self, name: str, column: Sequence[str], bad: np.ndarray, what: str, remedy: str
    ) -> None:
        """Raise InputError for the first bad row of a column, and say how many there are."""
        if bad.any():
            row = int(np.argmax(bad))
            got = f"{show(column[row].strip())}, {what} (rows like it: {np.count_nonzero(bad)})"
            raise InputError(self.path, f"line {self.numbers[row]}, {name}", got, remedy)


def rows_of(
    path: Path,
    lines: list[str],
    first: int,
    split: Callable[[str], Sequence[str]],
    pick: Callable[[Sequence[str]], tuple[str, ...]],
    least: int,
) -> NumberedRows:
    """Rows from line `first` on, whole and dated; a row that was cut has fewer fields.

    `pick` takes month, day and hour from a row's fields, and then what else is needed of them.
    """
    picked, numbers, width, wrong = [], [], 0, None
    for number, line in enumerate(lines[first:], first + 1):
        if line.isspace() or not line:
            continue
        fields = split(line.rstrip())
        width = width or max(len(fields), least)
        if len(fields) != width:
            got = f"{len(fields)} fields, not {width}"
            wrong = InputError(path, f"line {number}", got, CUT)
            break
        picked.append(pick(fields))
        numbers.append(number)
    columns = list(zip(*picked, strict=True))
    if picked:
        _refuse_dates(path, lines, columns, numbers)
    if wrong is not None:
        raise wrong
    if not picked:
        raise InputError(path, "rows", "none", CUT)
    month, day = integers(columns[0]), integers(columns[1])
    kept = ~((month == 2) & (day == 29))
    leap_rows = len(kept) - int(kept.sum())
    if leap_rows:
        columns = [tuple(compress(column, kept)) for column in columns]
    if leap_rows == len(kept):
        raise InputError(path, "rows", "none", CUT)
    return NumberedRows(path, columns, month[kept], day[kept], np.array(numbers)[kept], leap_rows)


def _refuse_dates(
    path: Path, lines: list[str], columns: list[tuple[str, ...]], numbers: list[int]
) -> None:
    """Refuse the first row that does not begin with a day of a leap year and an hour of 1 to 24."""
    month, day, hour = (integers(column) for column in columns[:3])
    valid = (month >= 1) & (month <= 12) & (hour >= 1) & (hour <= 24) & (day >= 1)
    valid &= day <= DAYS[np.clip(month, 1, 12)]
    if not valid.all():
        number = numbers[int(np.argmin(valid))]
        got, remedy = show(lines[number - 1].rstrip()), "a row starts with month, day and hour"
        raise InputError(path, f"line {number}, date", got, remedy)


def integers(column: Sequence[str]) -> np.ndarray:
    """Whole numbers of texts, shape (row,); −1 where a text is none."""
    return np.array(_numbers(column, int, -1)).clip(-1, 10**6).astype(int)


def decimals(column: Sequence[str]) -> np.ndarray:
    """Numbers of texts, shape (row,); NaN where a text is none."""
    return np.array(_numbers(column, float, math.nan))


def _numbers(column: Sequence[str], kind: Callable[[str], T], otherwise: T) -> list[T]:
    """Numbers that texts are; Python also reads 1_0 and digits of other scripts."""

    def is_plain(text: str) -> bool:
        return text.isascii() and "_" not in text

    if is_plain("".join(column)):
        with suppress(ValueError):
            return list(map(kind, column))
    if len(column) == 1:
        return [otherwise]
    return [number for text in column for number in _numbers([text], kind, otherwise)]


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
    return line.replace('"', "").split(",")


def show(value: object) -> str:
    """Quote a value that came, cut to 60 characters."""
    text = str(value)
    return repr(text if len(text) <= 60 else text[:57] + "...")
