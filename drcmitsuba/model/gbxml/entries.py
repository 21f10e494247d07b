"""Elements of a gbXML file, whose values are checked where they are read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from drcmitsuba.model.source_file import FARTHEST, opened, read_bytes
from drcmitsuba.runtime.errors import InputError, printable

LARGEST = 10**8
"""Largest file that is read [B]: its elements take some fifteen times as much memory."""
HEAD = 4096
"""Length of a file's beginning that tells its kind [B]."""


class GbxmlEntry(NamedTuple):
    """Element of a file; it knows its place for messages."""

    file: Path
    element: Element
    place: str
    """Kind and identifier of the element, or of the one that holds it."""

    def refuse(self, field: str, got: str, remedy: str) -> InputError:
        """Error that names the file, the place and the field."""
        where = f"{self.place}: {field}" if self.place else field
        return InputError(self.file, where, printable(got)[:120], remedy)

    def attribute(self, name: str) -> str:
        """Value of an attribute; "" where it is missing."""
        return self.element.get(name, "")

    def children(self, tag: str) -> Iterator[GbxmlEntry]:
        """Elements of a kind within this one, without a namespace."""
        for child in self.element:
            if _local(child) == tag:
                name = child.get("id")
                place = f"{tag} {printable(name)[:60]}" if name else self.place
                yield GbxmlEntry(self.file, child, place)

    def child(self, *path: str) -> GbxmlEntry | None:
        """First element at a path of kinds; None where the path ends early."""
        entry: GbxmlEntry | None = self
        for tag in path:
            entry = None if entry is None else next(entry.children(tag), None)
        return entry

    def text(self, *path: str) -> str:
        """Text of an element at a path; "" where it is missing."""
        entry = self.child(*path)
        return "" if entry is None else (entry.element.text or "").strip()

    def number(self, *path: str) -> float | None:
        """Finite number of an element at a path; None where it is missing."""
        text = self.text(*path)
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= FARTHEST:
            remedy = f"give a number of at most {FARTHEST:g}"
            raise self.refuse("/".join(path) or _local(self.element), text, remedy)
        return value

    def ring(self) -> np.ndarray:
        """Corners of the polygon of `PlanarGeometry`, shape (corner, 3), in the file's unit."""
        loop = self.child("PlanarGeometry", "PolyLoop")
        if loop is None:
            raise self.refuse("PlanarGeometry", "missing", "give it a PolyLoop")
        corners = []
        for point in loop.children("CartesianPoint"):
            numbers = [each.number() for each in point.children("Coordinate")]
            if len(numbers) != 3 or None in numbers:
                got = f"a point of {len(numbers)} coordinates"
                raise self.refuse("CartesianPoint", got, "give every point three Coordinates")
            corners.append(numbers)
        if len(corners) < 3:
            raise self.refuse("PolyLoop", f"{len(corners)} corners", "give at least three")
        return np.array(corners, float)


def is_gbxml(file: Path) -> bool:
    """Whether a file begins as gbXML, in any of XML's usual encodings."""
    with opened(file) as stream:
        head = stream.read(HEAD).replace(b"\0", b"")
    return b"<gbXML" in head or b":gbXML" in head


def read_entry(file: Path) -> GbxmlEntry:
    """Root element of a gbXML file, which is parsed without entities.

    Raises
    ------
    InputError
        The file is larger than `LARGEST`, no XML, or has another root.
    """
    raw = read_bytes(file, LARGEST)
    remedy = "give a file as the gbXML schema has it"
    try:
        root = ElementTree.fromstring(raw, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        got = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise InputError(file, "XML", printable(got), remedy) from None
    if _local(root) != "gbXML":
        raise InputError(file, "XML", f"a <{printable(_local(root))[:40]}>, no <gbXML>", remedy)
    return GbxmlEntry(file, root, "")


def _local(element: Element) -> str:
    """Name of an element without its namespace; "" of comments."""
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""
