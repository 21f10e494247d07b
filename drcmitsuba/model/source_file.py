"""Files from strangers: their size is known before a byte is read."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from drcmitsuba.runtime.errors import InputError

FARTHEST = 1e10
"""Largest coordinate, in the units of a file."""
LARGEST = 2 * 10**9
"""Largest file that is read [B]."""


def size_of(file: Path, largest: int = LARGEST) -> int:
    """Size of a file [B]; InputError where it is no file or larger than the largest [B]."""
    try:
        state = file.stat()
    except (OSError, ValueError) as error:
        missing = isinstance(error, FileNotFoundError)
        reason = "no such file" if missing else getattr(error, "strerror", None) or str(error)
        raise InputError(file, "file", reason, "check the path") from None
    if not stat.S_ISREG(state.st_mode):
        raise InputError(file, "file", "not a file", "give the path of a file")
    if state.st_size > largest:
        got = f"{state.st_size / 1e9:.3g} GB"
        raise InputError(file, "size", got, f"give a file of at most {largest / 1e9:g} GB")
    return state.st_size


@contextmanager
def opened(file: Path, largest: int = LARGEST) -> Iterator[IO[bytes]]:
    """Open a file; InputError where it cannot be read or is larger than the largest [B]."""
    size_of(file, largest)
    try:
        with file.open("rb") as stream:
            yield stream
    except OSError as error:
        raise InputError(file, "file", error.strerror or str(error), "check the path") from None


def read_bytes(file: Path, largest: int = LARGEST) -> bytes:
    """Content of a file; InputError where it cannot be read or is larger than the largest [B]."""
    with opened(file, largest) as stream:
        return stream.read(size_of(file, largest))
