"""Objects of an HBJSON file, whose values are checked where they are read."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drcmitsuba.model.source_file import FARTHEST, LARGEST, opened, size_of
from drcmitsuba.runtime.errors import InputError

MOST_MEMORY = 2**30
"""Largest estimate of the memory that a file's values take [B]."""
MEMORY = {b"{": 232, b"[": 96, b",": 32, b'"': 25}
"""Memory that Python takes for what a character begins or ends [B]."""


class JsonEntry(NamedTuple):
    """JSON object of a file; it knows its place for messages."""

    file: Path
    key: str
    """Field that holds the object; a name for an object that none holds."""
    fields: Mapping[str, Any]
    parent: JsonEntry | None = None

    @property
    def place(self) -> str:
        """Type and identifier of the object, or its path within the one that has them."""
        kind, name = self.fields.get("type"), self.fields.get("identifier")
        if self.parent is None:
            return self.key
        if isinstance(kind, str) and isinstance(name, str):
            return f"{kind} {name}"
        return f"{self.parent.place}: {self.key}"

    def refuse(self, field: str, got: str, remedy: str) -> InputError:
        """Error that names the file, the place and the field."""
        return InputError(self.file, f"{self.place}: {field}", got, remedy)

    def text(self, key: str) -> str | None:
        """Text of a field; None where it is missing or null."""
        value = self.fields.get(key)
        if value is not None and not isinstance(value, str):
            raise self.refuse(key, _shown(value), "give a text")
        return value

    def identifier(self) -> str:
        """Identifier of the object, which it must have."""
        name = self.text("identifier")
        if not name:
            raise self.refuse("identifier", "missing", "give the object an identifier")
        return name

    def number(self, key: str, default: float) -> float:
        """Finite number of a field; the default where it is missing or null."""
        value = self.fields.get(key)
        if value is None:
            return default
        try:
            if isinstance(value, (int, float)) and math.isfinite(value):
                return float(value)
        except OverflowError:
            pass
        raise self.refuse(key, _shown(value), "give a finite number")

    def fraction(self, key: str, default: float) -> float:
        """Number between 0 and 1 of a field [–]."""
        value = self.number(key, default)
        if not 0 <= value <= 1:
            raise self.refuse(key, f"{value:g}", "give a number between 0 and 1")
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """Whether a field is true."""
        value = self.fields.get(key)
        if value is not None and not isinstance(value, bool):
            raise self.refuse(key, _shown(value), "give true or false")
        return default if value is None else value

    def entry(self, key: str) -> JsonEntry | None:
        """Object of a field; None where it is missing or null."""
        value = self.fields.get(key)
        return None if value is None else self._inner(value, key)

    def entries(self, key: str) -> list[JsonEntry]:
        """Objects of a field that holds a list; none where it is missing or null."""
        return [
            self._inner(value, f"{key}[{k}]")
            for k, value in enumerate(self.sequence(key))
            if value is not None
        ]

    def sequence(self, key: str) -> list[Any]:
        """List of a field; empty where it is missing or null."""
        value = self.fields.get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.refuse(key, _shown(value), "give a list")
        return value

    def corners(self, key: str, value: object = None) -> np.ndarray:
        """Points of a field, or of one value in it, shape (point, 3)."""
        value = self.fields.get(key) if value is None else value
        try:
            points = np.array(value, float)
        except (TypeError, ValueError, OverflowError):
            points = np.empty(0)
        sound = points.ndim == 2 and points.shape[1] == 3 and len(points) > 0
        if not sound or not np.abs(points).max() <= FARTHEST:
            remedy = f"give a list of points of three numbers of at most {FARTHEST:g}"
            raise self.refuse(key, _shown(value), remedy)
        return points

    def vector(self, key: str) -> np.ndarray:
        """Three finite numbers of a field."""
        return self.corners(key, [self.sequence(key)])[0]

    def inner(self, *keys: str) -> JsonEntry:
        """Object at a path of fields, empty where the path ends early."""
        entry = self
        for key in keys:
            entry = entry.entry(key) or self._inner({}, key)
        return entry

    def _inner(self, value: object, key: str) -> JsonEntry:
        """Object within this one."""
        if not isinstance(value, dict):
            raise self.refuse(key, _shown(value), "give an object")
        return JsonEntry(self.file, key, value, self)


def read_entry(file: Path) -> JsonEntry:
    """Object that a JSON file holds; its memory is estimated before it is parsed."""
    size = size_of(file, LARGEST)
    parts, memory = [], 3 * size  # the file in parts, in one piece, and as text
    with opened(file, LARGEST) as stream:
        while part := stream.read(2**20):
            memory += sum(cost * part.count(mark) for mark, cost in MEMORY.items())
            memory += 0 if part.isascii() else 3 * size  # four bytes a character
            if memory > MOST_MEMORY:
                got = f"more than {MOST_MEMORY / 2**30:g} GiB of memory for its values"
                raise InputError(file, "size", got, "leave out or split large meshes and grids")
            parts.append(part)
    try:
        value = json.loads(b"".join(parts))
    except RecursionError:
        got = "objects within objects without end"
        raise InputError(file, "JSON", got, "give a Honeybee model") from None
    except ValueError as error:
        raise InputError(file, "JSON", str(error), "give a Honeybee model") from None
    if not isinstance(value, dict):
        raise InputError(file, "JSON", _shown(value), "give a Honeybee model")
    return JsonEntry(file, "model", value)


def by_identifier(entries: Iterable[JsonEntry], *, alike: bool = False) -> dict[str, JsonEntry]:
    """Objects of one kind by their identifiers, which must differ.

    With `alike`, objects of equal fields may stand several times.
    """
    out: dict[str, JsonEntry] = {}
    for entry in entries:
        name = entry.identifier()
        if name in out and alike and out[name].fields == entry.fields:
            continue
        if name in out:
            raise entry.refuse("identifier", "twice", "give every object its own identifier")
        out[name] = entry
    return out


def _shown(value: object) -> str:
    """Value in a message, without its inner values where it has some."""
    if value is None:
        return "missing"
    return repr(value) if isinstance(value, (str, int, float)) else f"a {type(value).__name__}"
