"""Study file: rows of changed keys of one case."""

from __future__ import annotations

import copy
import csv
import itertools
import math
import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import MAX_BYTES, case_from
from drcmitsuba.case.shipped import locate_case
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Table, checked, choose, is_file, read_toml, shortened

qmc = lazy.module("scipy.stats.qmc")

MOST_ROWS = 100_000
"""Largest number of rows."""

PART = re.compile(r'"([^"]+)"|([^."]+)')
"""Part of a key; in quotes, as in TOML, it may hold dots."""
KEY = re.compile(rf"(?:{PART.pattern})(?:\.(?:{PART.pattern}))*")
"""Key of a value: its parts, with dots between them."""
NUMBER = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
"""Number of a CSV file; text such as 007 or 1_000 is a name."""
LONGEST = 40
"""Largest number of characters of a number; longer ones are text."""
Value = bool | int | float | str
Row = dict[str, Any]
"""Values by key, such as `metrics.sda_threshold`, `facade.south.strips.0.material` or
`materials."glass 0.64".transmittance`."""


class Sample(Table):
    """Values spread evenly between bounds, by Halton's sequence."""

    count: Annotated[int, Field(ge=1, le=MOST_ROWS)]
    """Number of rows."""
    seed: Annotated[int, Field(ge=0, le=1 << 30)] = 0
    """Seed of the scrambled sequence."""
    between: Annotated[dict[str, tuple[float, float]], Field(min_length=1, max_length=50)]
    """Lower and upper bound by key."""

    @model_validator(mode="after")
    def _rising(self) -> Sample:
        for key, (low, high) in self.between.items():
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                got = f"{low:g} to {high:g}"
                raise InputError("study", f"between.{key}", got, "give rising bounds")
        return self

    def rows(self) -> list[Row]:
        """Values of every row."""
        low, high = np.array([*self.between.values()]).T
        drawn = qmc.Halton(len(low), seed=self.seed).random(self.count)
        made = low + drawn * (high - low)
        return [dict(zip(self.between, row, strict=True)) for row in made.tolist()]


class Study(Table):
    """Rows of changed keys: all combinations, a list, a CSV file, or a sample."""

    case: str
    """Case file beside the study, or a shipped case by name."""
    grid: Annotated[dict[str, list[Value]], Field(max_length=50)] = Field(default_factory=dict)
    """Values by key, of which all combinations are rows."""
    columns: Annotated[dict[str, list[Value]], Field(max_length=50)] = Field(default_factory=dict)
    """Values by key, equally many of each: one row after another."""
    rows: Path | None = None
    """CSV file with a column for each key."""
    sample: Sample | None = None
    """Values between bounds."""

    _file: Path = PrivateAttr(Path())
    _tables: dict[str, Any] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _one_way(self) -> Study:
        ways = [n for n in ("grid", "columns", "rows", "sample") if getattr(self, n)]
        if len(ways) != 1:
            got = ", ".join(ways) or "none"
            raise InputError("study", "grid, columns, rows, sample", got, "give one of them")
        return self

    def each(self) -> list[Row]:
        """Values of every row by key.

        Raises
        ------
        InputError
            There are too many rows, the columns are unequal, or a key is that of no case.
        """
        rows = self._rows()
        for key in dict.fromkeys(key for row in rows for key in row):
            if not KEY.fullmatch(key):
                raise InputError(self._file, "key", shortened(key), "give one as a.b.0.c")
            if _parts(key) == [key] and key not in Case.model_fields:  # as a running number
                got = f"{shortened(key)} is no key of a case"
                raise InputError(self._file, "key", got, choose(key, [*Case.model_fields]))
        return rows

    def _rows(self) -> list[Row]:
        """Values of every row by key, as they stand."""
        if self.grid:
            count = math.prod(map(len, self.grid.values()))
            self._refuse_many(count)
            made = itertools.product(*self.grid.values())
            return [dict(zip(self.grid, values, strict=True)) for values in made]
        if self.columns:
            sizes = {len(values) for values in self.columns.values()}
            if len(sizes) > 1:
                got = f"{min(sizes)} and {max(sizes)} values"
                raise InputError(self._file, "columns", got, "give equally many for each key")
            self._refuse_many(sizes.pop())
            each = zip(*self.columns.values(), strict=True)
            return [dict(zip(self.columns, row, strict=True)) for row in each]
        if self.sample is not None:
            return self.sample.rows()
        assert self.rows is not None
        return self._of_csv(self._file.parent / self.rows)

    def _refuse_many(self, count: int) -> None:
        if not 0 < count <= MOST_ROWS:
            raise InputError(self._file, "rows", f"{count} rows", f"give 1 to {MOST_ROWS}")

    def _of_csv(self, file: Path) -> list[Row]:
        """Rows of a CSV file; an empty field leaves the case's value."""
        if not is_file(file, self._file, "rows"):
            raise InputError(self._file, "rows", f"{file}: no such file", "name a CSV file")
        if file.stat().st_size > 100 * MAX_BYTES:
            raise InputError(file, "size", "over 100 MiB", "give fewer rows")
        try:
            with file.open(newline="", encoding="utf-8-sig") as text:
                table = csv.DictReader(text, strict=True)
                if ";" in (head := (table.fieldnames or [""])[0]):
                    raise InputError(file, "row", f"semicolons in {head[:60]!r}", "write commas")
                for key, count in Counter(map(str.strip, table.fieldnames or ())).items():
                    if count > 1:
                        got = f"{count} columns {shortened(key)}"
                        raise InputError(file, "row", got, "give each key one column")
                made = list(itertools.islice(table, MOST_ROWS + 1))
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(file, "text", str(error)[:100], "write CSV in UTF-8") from None
        self._refuse_many(len(made))
        if any(None in row or None in row.values() for row in made):
            raise InputError(file, "row", "more or fewer fields than keys", "mend the row")
        return [{k.strip(): _value(v) for k, v in row.items() if v.strip()} for row in made]

    def case_of(self, row: Row) -> Case:
        """Case with the values of a row; InputError where a key or a value is unfit."""
        tables = copy.deepcopy(self._tables)
        for key, value in row.items():
            _set(tables, key, value)
        return case_from(tables, locate_case(self._case_path))

    def stated(self, key: str) -> Value | None:
        """Value that the case file has where a row leaves a key out; None for its default."""
        at: Any = self._tables
        for name in _parts(key):
            try:
                at = at[int(name)] if isinstance(at, list) else at[name]
            except (KeyError, IndexError, TypeError, ValueError):
                return None
        return at if isinstance(at, bool | int | float | str) else None

    @property
    def _case_path(self) -> str:
        beside = self._file.parent / self.case
        return str(beside) if beside.is_file() else self.case


def load_study(path: str | Path) -> Study:
    """Read and check a study file; InputError where it, or its case, is unfit."""
    file = Path(path)
    if not is_file(file, file, "study"):
        raise InputError(file, "study", "no such file", "give a TOML file")
    study = checked(Study, read_toml(file, MAX_BYTES), file)
    study._file = file
    case = locate_case(study._case_path)
    if case.suffix.lower() != ".toml":
        raise InputError(file, "case", f"{case.name} is no TOML file", "name a case file")
    study._tables = read_toml(case, MAX_BYTES)
    return study


def _value(text: str) -> Value:
    """Number, truth value or text of a field."""
    text = text.strip()
    if text in ("true", "false"):
        return text == "true"
    if len(text) > LONGEST or not NUMBER.fullmatch(text):
        return text
    return int(text) if text.lstrip("+-").isdecimal() else float(text)


def _parts(key: str) -> list[str]:
    """Names on the way to a value."""
    return [quoted or plain for quoted, plain in PART.findall(key)]


def _set(tables: dict[str, Any], key: str, value: Any) -> None:
    """Set a value by its key, making the tables on its way."""
    at: Any = tables
    if not (parts := _parts(key)):
        raise InputError("study", key, "no name", "give a key such as metrics.sda_threshold")
    *way, last = parts
    for name in way:
        at = _entry(at, name, key)
    if isinstance(at, list):
        at[_index(at, last, key)] = value
    elif isinstance(at, dict):
        at[last] = value
    else:
        raise InputError("study", key, "the case has a value where the key has a table", "mend it")


def _entry(at: Any, name: str, key: str) -> Any:
    if isinstance(at, list):
        return at[_index(at, name, key)]
    if isinstance(at, dict):
        return at.setdefault(name, {})
    raise InputError("study", key, "the case has a value where the key has a table", "mend it")


def _index(at: list[Any], name: str, key: str) -> int:
    if not (name.isdecimal() and len(name) < 5 and int(name) < len(at)):
        raise InputError("study", key, f"no entry {name}", f"give an index from 0 to {len(at) - 1}")
    return int(name)
