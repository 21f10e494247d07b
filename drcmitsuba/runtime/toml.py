"""Tables of a TOML file, checked by pydantic; a mistake becomes one line with a remedy."""

from __future__ import annotations

import ast
import difflib
import inspect
import json
import re
import sys
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from drcmitsuba.runtime.errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def _refuse_percentage(value: object) -> object:
    """Refuse a number that looks like per cent in place of a fraction."""
    if type(value) in (int, float) and 2 <= value <= 100:  # type: ignore[operator]
        raise InputError("case", "", f"got {value}", f"did you mean {value / 100:g}?")  # type: ignore[operator]
    return value


def default_model(model: str) -> BeforeValidator:
    """Validator that gives a table without `model` this model."""
    return BeforeValidator(
        lambda table: {"model": model, **table} if type(table) is dict else table
    )


Fraction = Annotated[float, Field(ge=0, le=1, strict=True), BeforeValidator(_refuse_percentage)]
"""Number from 0 to 1 [–]."""
Percent = Annotated[float, Field(ge=0, le=100)]
Illuminance = Annotated[float, Field(gt=0, le=1e9)]
"""Threshold of illuminance [lx]; the largest is far beyond any sun."""
Length = Annotated[float, Field(gt=0, le=100_000, strict=True)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000, strict=True)]
OnMap = Annotated[float, Field(ge=-1e8, le=1e8, strict=True)]
"""Coordinate of any map [m]; Mercator coordinates reach 2e7 m."""
Point = tuple[OnMap, OnMap, OnMap]
Name = Annotated[str, Field(max_length=200)]
Side = Literal["south", "east", "north", "west"]
Text = Annotated[str, Field(max_length=400)]
Sure = Literal["read in public code", "read in quotations", "public page", "second-hand"]
"""How sure a number is, from the surest."""


class Table(BaseModel):
    """A table of a TOML file: frozen, no unknown keys, no NaN, no infinity.

    The docstring below a field, with its unit, is the field's description in the JSON schema.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Add the docstrings below the fields: reading them at every import takes too long."""
        schema = handler(core_schema)
        keys = handler.resolve_ref_schema(schema)["properties"]
        for table in cls.__mro__:
            if issubclass(table, Table):
                for name, text in _docstrings(table).items():
                    keys[name].setdefault("description", text)
        return schema


class Sourced(Table):
    """A table that says where its numbers come from."""

    source: Text
    """Publication or file that states the numbers."""
    sure: Sure
    """How the source was read."""


def _docstrings(table: type[Table]) -> dict[str, str]:
    """Docstrings of a table's own fields, by field."""
    [body] = ast.parse(textwrap.dedent(inspect.getsource(table))).body
    assert isinstance(body, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value)
        for field, text in pairwise(body.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        if isinstance(text.value.value, str)
    }


T = TypeVar("T", bound=Table)


def checked(table: type[T], data: dict[str, Any], source: str | Path) -> T:
    """Check plain values from TOML, whose origin is `source`, and make a table of them.

    An unknown or missing key, and a value out of its range, raise InputError.
    """
    try:
        return table.model_validate(data)
    except ValidationError as error:
        raise _as_input_error(source, data, error) from None


def _as_input_error(source: str | Path, data: dict[str, Any], error: ValidationError) -> InputError:
    """Turn pydantic's most specific complaint into one line: field, value and remedy.

    Where a value may be one of several kinds, pydantic complains once for each kind; the complaint
    deepest in the file is about the kind that the user meant. A missing key comes last: it may be
    misspelt.
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
        return InputError(
            source, ".".join(filter(None, [*keys, cause.field])), cause.got, cause.remedy
        )
    field = ".".join(keys) or "case"
    if chosen["type"] == "extra_forbidden":
        for key in path[:-1]:
            data = data[key]
        siblings = set(data) - {path[-1]}
        known = [key for key in _known_keys(siblings) if key != path[-1]]
        hint = choose(str(path[-1]), known, otherwise="remove it")
        return InputError(source, field, "unknown key", hint)
    context = chosen.get("ctx", {})
    if chosen["type"].startswith("union_tag"):  # `type` or `model`, which says what a table is
        key, tag = context["discriminator"].strip("'"), context.get("tag")
        known = re.findall("'(.*?)'", context.get("expected_tags", ""))
        got, remedy = "nothing", "say which it is"
        if tag is not None:
            got, remedy = shortened(tag), choose(tag, known)
        return InputError(source, f"{field}.{key}", f"got {got}", remedy)
    got = "nothing" if chosen["type"] == "missing" else shortened(chosen.get("input"))
    wanted = dict.fromkeys(_in_toml(complaints[i]["msg"]) for i in same if paths[i] == path)
    first, *others = wanted
    remedy = " or ".join([first, *(w.removeprefix("Input should be ") for w in others)])
    return InputError(source, field, f"got {got}", remedy[:1].lower() + remedy[1:])


def _path(data: Any, complaint: Any) -> list[Any]:
    """Keys that lead to a complaint in the file, without pydantic's own steps."""
    path = []
    for key in complaint["loc"]:
        keys = range(len(data)) if isinstance(data, list) else data
        if isinstance(data, dict | list) and key in keys:
            data = data[key]
            path.append(key)
    return [*path, complaint["loc"][-1]] if complaint["type"] == "missing" else path


def _in_toml(message: str) -> str:
    """Name types and lengths as TOML does, in place of pydantic's words."""
    message = re.sub("dictionary or .*", "table", message)
    message = re.sub(r"^(?:Tuple|List) should have (at \w+ \d+) items?.*", r"Give \1", message)
    return message.replace("Tuple", "List").replace("tuple", "list")


def shortened(value: object) -> str:
    """Write a value as in TOML, cut to 60 characters."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    text = text.encode("utf-8", "backslashreplace").decode()  # names of files may be no text
    return text if len(text) <= 60 else text[:57] + "..."


def named_of_kind(tables: Mapping[str, Table], kinds: tuple[type[Table], ...]) -> list[str]:
    """Names of the tables that are of one of these classes."""
    return [name for name, table in tables.items() if isinstance(table, kinds)]


def fits(name: str, patterns: Iterable[str]) -> bool:
    """Whether a name fits one of some patterns, in which `*` stands for any text.

    All other signs stand for themselves: brackets and question marks occur in names of rooms.
    """
    return any(_fits(name, pattern) for pattern in patterns)


def unmet(patterns: Iterable[str], names: Collection[str]) -> list[str]:
    """List the patterns that no name fits."""
    return [pattern for pattern in patterns if not any(_fits(name, pattern) for name in names)]


def _fits(name: str, pattern: str) -> bool:
    """Whether a name fits a pattern; its pieces are looked for one after another."""
    first, *pieces = pattern.split("*")
    if not pieces:
        return name == first
    *between, last = pieces
    if not name.startswith(first) or len(name) < len(first) + len(last):
        return False
    at, end = len(first), len(name) - len(last)
    for piece in between:
        place = name.find(piece, at, end)
        if place < 0:
            return False
        at = place + len(piece)
    return name.endswith(last)


def choose(name: str, known: Sequence[str], otherwise: str = "") -> str:
    """Advice that names the most similar known name, or the first known names."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    if near:
        return f"did you mean {shortened(near[0])}?"
    return otherwise or f"choose from: {', '.join(map(shortened, known[:8])) or 'none so far'}"


def _known_keys(siblings: set[str]) -> list[str]:
    """Keys of the tables that have most of the keys `siblings`."""
    tables = Table.__subclasses__()
    fits = [len(siblings & table.model_fields.keys()) for table in tables]
    best = [t for t, fit in zip(tables, fits, strict=True) if fit == max(fits)]
    return sorted({key for table in best for key in table.model_fields})


def is_file(path: Path, source: object, field: str) -> bool:
    """Whether a path names a file; a name that no file can have raises InputError."""
    try:
        return path.is_file()
    except OSError as error:
        remedy = "check the path and its rights"
        raise InputError(source, field, f"{path}: {error.strerror}", remedy) from None


def read_toml(file: Path, most: int) -> dict[str, Any]:
    """Read a TOML file of at most `most` bytes.

    A file that is missing, too large, a device, or no TOML raises InputError.
    """
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
