"""Text files of meshes, in blocks of whole lines, so that memory stays bounded."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np

from drcmitsuba.model.source_file import opened
from drcmitsuba.runtime.errors import InputError

BLOCK = 2**22
"""Size of a block [B]."""
LONGEST = 2**20
"""Largest length of a line [B]."""


def line_of(file: Path, stream: IO[bytes]) -> bytes:
    """Next line of a file; empty at its end."""
    line = stream.readline(LONGEST)
    if len(line) == LONGEST:
        raise InputError(file, "line", "longer than 1 MiB", "export the mesh again")
    return line


def blocks_of(file: Path) -> Iterator[bytes]:
    """Blocks of whole lines; a line that ends with a backslash is one with the next."""
    with opened(file) as stream:
        while block := stream.read(BLOCK):
            block += line_of(file, stream)
            while block.rstrip(b"\r\n").endswith(b"\\") and len(block) < 2 * BLOCK:
                more = line_of(file, stream)
                if not more:
                    break
                block += more
            yield re.sub(rb"\\\r?\n", b" ", block)


def statements(file: Path, keywords: str) -> Iterator[list[tuple[bytes, bytes]]]:
    """Keywords, of those separated by |, and the rest of their lines, a list for each block."""
    statement = re.compile(
        rb"^[ \t]*(" + keywords.encode() + rb")(?:[ \t]+([^\r\n]*))?[ \t]*$", re.MULTILINE
    )
    for block in blocks_of(file):
        yield statement.findall(block.replace(b"\r", b"\n"))


def numbers(file: Path, rows: list[list[bytes]], columns: int, what: str) -> np.ndarray:
    """Numbers of rows of words, shape (row, columns)."""
    try:
        return np.array(rows, float).reshape(len(rows), columns)
    except ValueError:
        got = f"a line that has not {columns} numbers"
        raise InputError(file, what, got, "export the mesh again") from None


def whole_numbers(file: Path, rows: list[list[bytes]], columns: int, what: str) -> np.ndarray:
    """Whole numbers of rows of words, shape (row, columns)."""
    try:
        return np.array(rows, np.int64).reshape(len(rows), columns)
    except (ValueError, OverflowError):
        got = f"a line that has not {columns} whole numbers"
        raise InputError(file, what, got, "export the mesh again") from None


def text_of(name: bytes) -> str:
    """Name in a file, which is UTF-8 or Latin-1."""
    try:
        return name.strip().decode()
    except UnicodeDecodeError:
        return name.strip().decode("latin-1")
