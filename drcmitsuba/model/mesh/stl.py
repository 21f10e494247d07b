"""STL files, binary or as text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drcmitsuba.model.facets import facet_quads, join
from drcmitsuba.model.mesh.part import (
    LARGEST,
    MeshPart,
    check_count,
    check_vertices,
    doubles,
)
from drcmitsuba.model.mesh.text import numbers, statements, text_of
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.source_file import opened, read_bytes, size_of
from drcmitsuba.runtime.errors import InputError

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 84
"""Size of the header of a binary file [B]."""


def read_stl(file: Path, notes: Notes) -> list[MeshPart]:
    """Parts of an STL file: its solids. Corners decide on fronts, normals are left out."""
    size = size_of(file)
    with opened(file) as stream:
        header = stream.read(HEADER)
    count = int.from_bytes(header[80:HEADER], "little")
    if size == HEADER + count * FACET.itemsize:
        check_count(file, "polygons", count)
        facets = np.frombuffer(read_bytes(file, LARGEST), FACET, count, HEADER)
        return [_part(file, "", doubles(facets["corners"]))]
    if not header.lstrip().lower().startswith(b"solid"):
        got = "neither text nor as many triangles as its header says"
        raise InputError(file, "STL", got, "export the mesh again")
    return _read_text(file)


def _read_text(file: Path) -> list[MeshPart]:
    corners: dict[str, list[np.ndarray]] = {}
    name, count = "", 0
    for block in statements(file, "(?i:solid|vertex)"):
        rows: list[list[bytes]] = []
        for keyword, body in block:
            if keyword.lower() == b"vertex":
                rows.append(body.split())
                continue
            _add(file, corners, name, rows)
            name, rows = text_of(body), []
        _add(file, corners, name, rows)
        count += sum(keyword.lower() == b"vertex" for keyword, _ in block)
        check_count(file, "polygons", count // 3)
    solids = {name: np.concatenate(parts) for name, parts in corners.items()}
    if any(len(each) % 3 for each in solids.values()):
        raise InputError(file, "vertex", "a triangle without three", "export the mesh again")
    return [_part(file, name, each.reshape(-1, 3, 3)) for name, each in solids.items()]


def _add(
    file: Path, corners: dict[str, list[np.ndarray]], name: str, rows: list[list[bytes]]
) -> None:
    """Add the corners of a solid in one block of the file, where it has any."""
    if rows:
        corners.setdefault(name, []).append(numbers(file, rows, 3, "vertex"))
        check_count(file, "parts", len(corners))


def _part(file: Path, name: str, corners: np.ndarray) -> MeshPart:
    check_vertices(file, corners)
    return MeshPart((name or file.stem,), join(facet_quads(corners)[0])[0])
