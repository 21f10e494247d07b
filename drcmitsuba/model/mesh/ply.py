"""PLY files, binary or as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import IO, Literal, TypeVar

import numpy as np

from drcmitsuba.model.facets import join, polygon_quads
from drcmitsuba.model.mesh.part import (
    LARGEST,
    MOST_CORNERS,
    MeshPart,
    check_count,
    check_index,
    check_vertices,
    doubles,
)
from drcmitsuba.model.mesh.text import line_of, numbers, text_of, whole_numbers
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.source_file import opened, size_of
from drcmitsuba.runtime.errors import InputError

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types of properties as those of NumPy."""
CORNERS = ("vertex_indices", "vertex_index")
"""Names of the property that holds the corners of a face."""
BLOCK = 2**16
"""Number of lines that become numbers at once."""
Item = TypeVar("Item")
MOST_LINES = 100
"""Largest number of lines of a header."""


@dataclass
class _Element:
    """Element of a header: its name, number, and properties in turn."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)
    """Name, type of a list's length ("" for no list), type."""


def read_ply(file: Path, notes: Notes) -> list[MeshPart]:
    """The one part of a PLY file, whose name is that of the file."""
    vertices, rings = ply_polygons(file)

    def refuse(_: int, wrong: str) -> InputError:
        return InputError(file, "face", f"one that is {wrong}", "triangulate the mesh on export")

    quads = [polygon_quads(vertices[index], refuse)[0] for index in rings.values()]
    return [MeshPart((file.stem,), join(np.concatenate([np.empty((0, 4, 3)), *quads]))[0])]


def ply_polygons(file: Path) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Vertices (vertex, 3), and corners of faces by their number, (face, corner), of a PLY file."""
    size = size_of(file)
    with opened(file) as stream:
        order, elements = _header(file, stream)
        if order:
            size_of(file, LARGEST)
        read = _Binary(file, stream, order, size) if order else _Text(file, stream)
        vertices, rings = np.empty((0, 3)), dict[int, np.ndarray]()
        for element in elements:
            if element.name == "vertex":
                vertices = read.columns(element, ["x", "y", "z"])
            elif element.name == "face":
                rings = read.lists(element)
                break  # what follows is not needed
            else:
                read.columns(element, [])
    check_vertices(file, vertices)
    for index in rings.values():
        check_index(file, index, len(vertices))
    return vertices, rings


def _header(file: Path, stream: IO[bytes]) -> tuple[str, list[_Element]]:
    """Byte order ("" for text) and elements."""
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    order: str | None = None
    elements: list[_Element] = []
    if line_of(file, stream).strip() != b"ply":
        raise InputError(file, "PLY", "no header", "give a PLY file")
    for _ in range(MOST_LINES):
        words = text_of(line_of(file, stream)).split()
        if words[:1] == ["end_header"] and order is not None:
            return order, elements
        if words[:1] == ["format"] and len(words) > 1 and words[1] in orders:
            order = orders[words[1]]
        elif words[:1] == ["element"] and len(words) == 3 and words[2][:12].isdecimal():
            elements.append(_Element(words[1], int(words[2][:12])))
            check_count(file, "vertices", elements[-1].count)
            if words[1] == "face":
                check_count(file, "polygons", elements[-1].count)
        elif words[:1] == ["property"] and elements and len(words) == 3 and words[1] in TYPES:
            elements[-1].properties.append((words[-1], "", TYPES[words[1]]))
        elif words[:2] == ["property", "list"] and elements and len(words) == 5:
            kinds = [TYPES.get(word, "") for word in words[2:4]]
            if kinds[0][:1] in ("i", "u") and kinds[1]:
                elements[-1].properties.append((words[4], kinds[0], kinds[1]))
                continue
            raise InputError(file, "header", " ".join(words), "export the mesh again")
        elif words and words[0] not in ("comment", "obj_info"):
            raise InputError(file, "header", " ".join(words), "export the mesh again")
    raise InputError(file, "header", "without format or end", "export the mesh again")


class _Text:
    """Elements of a file of text: a line each."""

    def __init__(self, file: Path, stream: IO[bytes]) -> None:
        self.file, self.stream = file, stream

    def _rows(self, element: _Element) -> Iterator[list[bytes]]:
        """Words of each line of an element."""
        for _ in range(element.count):
            row = line_of(self.file, self.stream).split()
            if not row:
                got = f"fewer than {element.count} lines"
                raise InputError(self.file, element.name, got, "export the mesh again")
            yield row

    def columns(self, element: _Element, names: list[str]) -> np.ndarray:
        """Columns of numbers, shape (element, column)."""
        at = _columns_of(self.file, element, names)
        rows = ([row[k] for k in at if k < len(row)] for row in self._rows(element))
        blocks = [
            numbers(self.file, block, len(at), element.name) if at else np.empty((0, 0))
            for block in _blocks(rows)
        ]
        return np.concatenate([np.empty((0, len(at))), *blocks])

    def lists(self, element: _Element) -> dict[int, np.ndarray]:
        """Corners of faces by their number, shape (face, corner) each."""
        rings: dict[int, list[np.ndarray]] = {}
        for block in _blocks(self._rings(element)):
            alike: dict[int, list[list[bytes]]] = {}
            for n, words in block:
                alike.setdefault(n, []).append(words)
            for n, rows in alike.items():
                rings.setdefault(n, []).append(whole_numbers(self.file, rows, n, element.name))
        return {n: np.concatenate(blocks) for n, blocks in rings.items()}

    def _rings(self, element: _Element) -> Iterator[tuple[int, list[bytes]]]:
        """Number of corners and corners of each face."""
        before = _before_corners(self.file, element)
        for row in self._rows(element):
            try:
                at = 0
                for _, length, _ in before:
                    at += 1 + (int(row[at]) if length else 0)
                n = int(row[at])
            except (IndexError, ValueError):
                got = "a line that is no face"
                raise InputError(self.file, element.name, got, "export the mesh again") from None
            _check_corners(self.file, [n])
            yield n, row[at + 1 : at + 1 + n]


def _blocks(items: Iterator[Item]) -> Iterator[list[Item]]:
    """Lists of items that follow each other."""
    while block := list(islice(items, BLOCK)):
        yield block


class _Binary:
    """Elements of a binary file."""

    def __init__(self, file: Path, stream: IO[bytes], order: str, size: int) -> None:
        self.file, self.stream, self.order, self.size = file, stream, order, size

    def columns(self, element: _Element, names: list[str]) -> np.ndarray:
        """Columns of numbers, shape (element, column)."""
        _columns_of(self.file, element, names)
        kind = np.dtype([(name, self.order + each) for name, _, each in element.properties])
        content = self.stream.read(element.count * kind.itemsize)
        if len(content) < element.count * kind.itemsize:
            raise InputError(self.file, element.name, "cut short", "export the mesh again")
        rows = np.frombuffer(content, kind, element.count)
        return np.stack([doubles(rows[name]) for name in names], axis=1) if names else rows

    def lists(self, element: _Element) -> dict[int, np.ndarray]:
        """Corners of faces by their number, shape (face, corner) each."""
        _before_corners(self.file, element)
        content = self.stream.read(self.size)
        order: Literal["little", "big"] = "little" if self.order == "<" else "big"
        widths = [
            (name in CORNERS, np.dtype(length).itemsize if length else 0, np.dtype(kind).itemsize)
            for name, length, kind in element.properties
        ]
        corners = next(
            np.dtype(self.order + k) for name, _, k in element.properties if name in CORNERS
        )
        starts: dict[int, list[int]] = {}
        at = 0
        for _ in range(element.count):
            for is_ring, wide, item in widths:
                n = int.from_bytes(content[at : at + wide], order) if wide else 1
                at += wide
                if is_ring:
                    starts.setdefault(n, []).append(at)
                at += n * item
        if at > len(content):
            raise InputError(self.file, element.name, "cut short", "export the mesh again")
        _check_corners(self.file, list(starts))
        every = np.frombuffer(content, np.uint8)
        rings = {}
        for n, at_n in starts.items():
            index = np.array(at_n)[:, None] + np.arange(n * corners.itemsize)
            rings[n] = every[index].view(corners).astype(np.int64)
        return rings


def _columns_of(file: Path, element: _Element, names: list[str]) -> list[int]:
    """Positions of properties in an element without lists."""
    known = [name for name, _, _ in element.properties]
    lists = [name for name, length, _ in element.properties if length]
    missing = [name for name in names if name not in known]
    if missing or lists or len(set(known)) < len(known) or not known:
        got = f"without {missing[0]}" if missing else "with lists, or without properties"
        raise InputError(file, element.name, got, "export the mesh again")
    return [known.index(name) for name in names]


def _before_corners(file: Path, element: _Element) -> list[tuple[str, str, str]]:
    """Properties of a face that come before its corners."""
    for k, (name, length, kind) in enumerate(element.properties):
        if name in CORNERS and length and kind[0] in "iu":
            return element.properties[:k]
    raise InputError(file, element.name, f"without {CORNERS[0]}", "export the mesh again")


def _check_corners(file: Path, counts: list[int]) -> None:
    bad = [n for n in counts if not 3 <= n <= MOST_CORNERS]
    if bad:
        remedy = f"give faces of 3 to {MOST_CORNERS} corners"
        raise InputError(file, "face", f"one of {bad[0]} corners", remedy)
