"""Wavefront OBJ files with their materials (MTL)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from drcmitsuba.model.facets import join, polygon_quads
from drcmitsuba.model.materials import Reflectance
from drcmitsuba.model.mesh.part import (
    MOST_CORNERS,
    MeshPart,
    beside,
    check_count,
    check_index,
    check_vertices,
)
from drcmitsuba.model.mesh.text import numbers, statements, text_of, whole_numbers
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.source_file import size_of
from drcmitsuba.runtime.errors import InputError

LARGEST_MTL = 16 * 10**6
"""Largest material library that is read [B]."""
MOST_LIBRARIES = 100
"""Largest number of lines that name material libraries; others are left out."""
Names = tuple[str, ...]


class _Mesh:
    """Vertices and faces of a file, block by block."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.vertices: list[np.ndarray] = []
        self.count = 0
        self.faces: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
        """Number of corners → parts and vertices of faces, (face,) and (face, corner)."""
        self.parts: dict[Names, int] = {}
        self.libraries: dict[str, None] = {}
        self.material = self.group = self.object = ""

    def add(self, block: list[tuple[bytes, bytes]]) -> None:
        """Add the statements of a block."""
        positions: list[list[bytes]] = []
        faces: list[bytes] = []
        at: list[tuple[int, int]] = []
        for keyword, body in block:
            if keyword == b"v":
                positions.append(body.split(None, 3)[:3])
            elif keyword == b"f":
                faces.append(body.partition(b"#")[0])
                at.append((self._part(), self.count + len(positions)))
            elif keyword == b"usemtl":
                self.material = text_of(body)
            elif keyword == b"g":
                self.group = text_of(body)
            elif keyword == b"o":
                self.object, self.group = text_of(body), ""
            elif len(self.libraries) < MOST_LIBRARIES:
                self.libraries[text_of(body)] = None
        if positions:
            self.vertices.append(numbers(self.file, positions, 3, "v"))
            self.count += len(positions)
            check_count(self.file, "vertices", self.count)
        if faces:
            self._add_faces(faces, np.array(at))

    def _part(self) -> int:
        names = tuple(dict.fromkeys(n for n in (self.material, self.group, self.object) if n))
        part = self.parts.setdefault(names, len(self.parts))
        check_count(self.file, "parts", part + 1)
        return part

    def _add_faces(self, faces: list[bytes], at: np.ndarray) -> None:
        rows = [row.split() for row in re.sub(rb"/\S*", b"", b"\n".join(faces)).split(b"\n")]
        corners = np.array([len(row) for row in rows])
        if corners.min() < 3 or corners.max() > MOST_CORNERS:
            bad = corners[(corners < 3) | (corners > MOST_CORNERS)][0]
            remedy = f"give faces of 3 to {MOST_CORNERS} corners"
            raise InputError(self.file, "f", f"a face of {bad} corners", remedy)
        for n in np.unique(corners).tolist():
            which = np.flatnonzero(corners == n)
            index = whole_numbers(self.file, [rows[k] for k in which], n, "f")
            index = np.where(index < 0, at[which, 1:] + index, index - 1)
            self.faces.setdefault(n, []).append((at[which, 0], index))
        total = sum(len(part) for faces in self.faces.values() for part, _ in faces)
        check_count(self.file, "polygons", total)


def read_obj(file: Path, notes: Notes) -> list[MeshPart]:
    """Parts of an OBJ file, by material, group and object; lines and curves are left out."""
    mesh, vertices, polygons = _read(file)
    colours = _libraries(file, mesh.libraries, notes)

    def refuse(_: int, wrong: str) -> InputError:
        return InputError(file, "f", f"a face that is {wrong}", "triangulate the mesh on export")

    pieces, parts = [np.empty((0, 4, 3))], [np.empty(0, int)]
    for n in sorted(polygons):
        part, index = polygons.pop(n)
        quads, polygon = polygon_quads(vertices[index], refuse)
        pieces.append(quads)
        parts.append(part[polygon])
    part = np.concatenate(parts)
    order = np.argsort(part, kind="stable")
    quads, part = join(np.concatenate(pieces)[order], part[order])
    ends = np.searchsorted(part, np.arange(1, len(mesh.parts)))
    return [
        MeshPart(names, each, colours.get(names[0]) if names else None)
        for names, each in zip(mesh.parts, np.split(quads, ends), strict=False)
    ]


def obj_polygons(file: Path) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Vertices (vertex, 3), and corners of faces by their number, (face, corner), of an OBJ."""
    _, vertices, polygons = _read(file)
    return vertices, {n: index for n, (_, index) in polygons.items()}


def _read(file: Path) -> tuple[_Mesh, np.ndarray, dict[int, tuple[np.ndarray, np.ndarray]]]:
    """Mesh of a file, vertices, and parts and corners of faces by their number of corners."""
    mesh = _Mesh(file)
    for block in statements(file, "v|f|usemtl|g|o|mtllib"):
        mesh.add(block)
    vertices = np.concatenate([np.empty((0, 3)), *mesh.vertices])
    check_vertices(file, vertices)
    polygons = dict[int, tuple[np.ndarray, np.ndarray]]()
    for n in sorted(mesh.faces):
        part, index = map(np.concatenate, zip(*mesh.faces.pop(n), strict=True))
        check_index(file, index, len(vertices))
        polygons[n] = part, index
    return mesh, vertices, polygons


def _libraries(file: Path, names: dict[str, None], notes: Notes) -> dict[str, Reflectance]:
    """Diffuse reflectance of the materials in the libraries that lie beside a file [–]."""
    colours: dict[str, Reflectance] = {}
    for name in names:
        whole = beside(file, name)
        several = [name] if _is_file(whole) else name.split()
        for each in several:
            path = beside(file, each)
            if path is None or not _is_file(path):
                notes.add("Material libraries that are not beside the file are left out", each)
            else:
                colours |= _read_mtl(path, notes)
    return colours


def _is_file(path: Path | None) -> bool:
    """Whether there is a plain file; a name that no file can have names none."""
    try:
        return path is not None and path.is_file()
    except OSError:
        return False


def _read_mtl(file: Path, notes: Notes) -> dict[str, Reflectance]:
    """Diffuse reflectance Kd of the materials that are opaque and without a texture [–]."""
    size_of(file, LARGEST_MTL)
    colours: dict[str, Reflectance] = {}
    other: set[str] = set()
    name = ""
    for block in statements(file, "newmtl|Kd|d|Tr|map_Kd|map_d"):
        for keyword, body in block:
            words = body.split()
            if keyword == b"newmtl":
                name = text_of(body)
            elif keyword == b"Kd":
                kd = _fractions(words)
                if len(kd) == 3:
                    colours[name] = kd[0] if len(set(kd)) == 1 else (kd[0], kd[1], kd[2])
            elif keyword.startswith(b"map"):
                notes.add("Textures are left out", name)
                other.add(name)
            elif _fractions(words[-1:]) != ([1.0] if keyword == b"d" else [0.0]):
                other.add(name)
    return {name: kd for name, kd in colours.items() if name not in other}


def _fractions(words: list[bytes]) -> list[float]:
    """Numbers between 0 and 1; none where a word is something else."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        return []
    return values if all(0 <= value <= 1 for value in values) else []
