"""Digest of content: equal for equal geometry, materials, files and settings."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

DIGITS = 32
"""Number of hexadecimal digits of a key."""


def file_numbers(file: Path) -> tuple[int, ...]:
    """Return numbers that differ where another file takes the place of one and keeps its time."""
    status = file.stat()
    return status.st_mtime_ns, status.st_size, status.st_ino


def content_key(*content: Any) -> str:
    """Digest of values, by type and content.

    Parameters
    ----------
    *content
        Numbers, texts, arrays, tables of a case, dataclasses, and mappings or sequences of these.
        A path stands for the bytes of its file.

    Returns
    -------
    str
        Key of `DIGITS` hexadecimal digits.

    Raises
    ------
    TypeError
        A value of another type: its content is unknown, and a key must leave nothing out.
    """
    digest = hashlib.sha256()
    for piece in _pieces(content):
        digest.update(len(piece).to_bytes(8, "little"))
        digest.update(piece)
    return digest.hexdigest()[:DIGITS]


def _pieces(value: Any) -> Iterator[bytes]:
    """Bytes that stand for a value; its type comes first."""
    yield type(value).__name__.encode()
    if isinstance(value, Enum):
        yield value.name.encode()
    elif value is None or isinstance(value, bool | int | float | str):
        yield repr(value).encode()
    elif isinstance(value, np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        if array.dtype.hasobject:
            yield from _pieces(array.tolist())
        else:
            yield f"{array.dtype.str} {array.shape}".encode()
            yield array.tobytes()
    elif isinstance(value, Path):
        yield hashlib.sha256(value.read_bytes()).digest()
    elif isinstance(value, BaseModel):
        yield from _pieces({name: getattr(value, name) for name in type(value).model_fields})
    elif dataclasses.is_dataclass(value):
        fields = (field.name for field in dataclasses.fields(value))
        yield from _pieces({name: getattr(value, name) for name in fields})
    elif isinstance(value, Mapping):
        for key in sorted(value, key=repr):
            yield from _pieces(key)
            yield from _pieces(value[key])
    elif isinstance(value, tuple | list):
        yield len(value).to_bytes(8, "little")
        for each in value:
            yield from _pieces(each)
    else:
        raise TypeError(f"no digest of {type(value).__name__}")
