"""Tables of plain values, checked by pydantic; what is wrong is told in one line."""

from __future__ import annotations

import difflib
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drcmitsuba.runtime.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Fraction = Annotated[float, Field(ge=0, le=1, strict=True)]
Length = Annotated[float, Field(gt=0, le=100_000, strict=True)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000, strict=True)]
OnMap = Annotated[float, Field(ge=-1e8, le=1e8, strict=True)]
"""Coordinate of any map [m]; Mercator's reach 2e7."""
Point = tuple[OnMap, OnMap, OnMap]
Name = Annotated[str, Field(max_length=200)]
Side = Literal["south", "east", "north", "west"]


class Table(BaseModel):
    """A table of the case file: frozen, no unknown keys, no NaN, no infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


T = TypeVar("T", bound=Table)


def checked(table: type[T], data: dict[str, Any], source: str | Path) -> T:
    """Make a table from plain values, told to come from `source` where they are wrong."""
    try:
        return table.model_validate(data)
    except ValidationError as error:
        raise _as_input_error(source, data, error) from None


def _as_input_error(source: str | Path, data: dict[str, Any], error: ValidationError) -> InputError:
    """Turn pydantic's most telling complaint into one line: field, value and remedy.

    Where a value may be one of several kinds, pydantic complains once for each kind: the complaint
    that goes deepest into the file is the one about the kind that was meant. A key that is missing
    comes last: it may be there, misspelt.
    """
    complaints: list[Any] = error.errors(include_url=False)
    complaints.sort(key=lambda complaint: complaint["type"] == "missing")
    paths = [_path(data, complaint) for complaint in complaints]
    same = [i for i, path in enumerate(paths) if path[: len(paths[0])] == paths[0]]
    deepest = max(same, key=lambda i: len(paths[i]))
    chosen, path = complaints[deepest], paths[deepest]
    keys = [str(k) if str(k).isprintable() and len(str(k)) <= 60 else shortened(k) for k in path]
    cause = chosen.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return InputError(source, ".".join([*keys, cause.field]), cause.got, cause.remedy)
    field = ".".join(keys) or "case"
    if chosen["type"] == "extra_forbidden":
        for key in path[:-1]:
            data = data[key]
        siblings = set(data) - {path[-1]}
        known = [key for key in _known_keys(siblings) if key != path[-1]]
        hint = choose(str(path[-1]), known, otherwise="remove it")
        return InputError(source, field, "unknown key", hint)
    got = "nothing" if chosen["type"] == "missing" else shortened(chosen.get("input"))
    wanted = dict.fromkeys(_in_toml(complaints[i]["msg"]) for i in same if paths[i] == path)
    first, *others = wanted
    remedy = " or ".join([first, *(w.removeprefix("Input should be ") for w in others)])
    return InputError(source, field, f"got {got}", remedy[:1].lower() + remedy[1:])


def _path(data: Any, complaint: Any) -> list[Any]:
    """Keys that lead to a complaint in the file, without the names of pydantic's own steps."""
    path = []
    for key in complaint["loc"]:
        keys = range(len(data)) if isinstance(data, list) else data
        if isinstance(data, dict | list) and key in keys:
            data = data[key]
            path.append(key)
    return [*path, complaint["loc"][-1]] if complaint["type"] == "missing" else path


def _in_toml(message: str) -> str:
    """Say what TOML calls pydantic's types."""
    message = re.sub("dictionary or .*", "table", message)
    return message.replace("Tuple", "List").replace("tuple", "list")


def shortened(value: object) -> str:
    """Write a value as it stands in TOML, cut to 60 characters."""
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def choose(name: str, known: Sequence[str], otherwise: str = "") -> str:
    """Hint at the known name that was meant, or at the first known ones."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    if near:
        return f"did you mean {shortened(near[0])}?"
    return otherwise or f"choose from: {', '.join(map(shortened, known[:8])) or 'none so far'}"


def _known_keys(siblings: set[str]) -> list[str]:
    """Keys of the tables that know most of these keys."""
    tables = Table.__subclasses__()
    fits = [len(siblings & table.model_fields.keys()) for table in tables]
    best = [t for t, fit in zip(tables, fits, strict=True) if fit == max(fits)]
    return sorted({key for table in best for key in table.model_fields})


def read_toml(file: Path, most: int) -> dict[str, Any]:
    """Read a TOML file of at most `most` bytes; what is wrong is told in one line."""
    try:
        if file.exists() and not file.is_file():  # a device would never end
            raise InputError(file, "file", "no plain file", "give a TOML file")
        size = file.stat().st_size
        if size > most:
            raise InputError(file, "size", f"{size} bytes", f"keep below {most}")
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(file, "file", str(error.strerror), "check its path and rights") from None
    except UnicodeDecodeError as error:
        raise InputError(file, f"byte {error.start}", "not UTF-8", "save as UTF-8") from None
    except InputError:
        raise
    except ValueError as error:  # not only TOMLDecodeError: an integer of 5000 digits
        raise InputError(file, "TOML", str(error), "correct the syntax") from None
    except RecursionError:
        raise InputError(file, "TOML", "nested too deeply", "remove the nesting") from None
