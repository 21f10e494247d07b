"""Triangles from PLY and OBJ files; the memory taken is bounded by the size of the file."""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np

from drcmitsuba.runtime.errors import InputError

MAX_BYTES = 1 << 25

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


class _UnfitError(ValueError):
    """Fault in the text of a mesh, without the name of its file."""


def _obj(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (vertex, 3) and triangles (face, 3) of a Wavefront OBJ; polygons become fans."""
    vertices, faces = array("d"), array("q")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                if len(words) < 4:
                    raise _UnfitError(f"line {number} has no three coordinates")
                vertices.extend(float(w) for w in words[1:4])
            elif words[:1] == ["f"]:
                at = [int(w.split("/")[0]) for w in words[1:]]
                at = [i - 1 if i > 0 else len(vertices) // 3 + i for i in at]
                for k in range(1, len(at) - 1):
                    faces.extend((at[0], at[k], at[k + 1]))
        except _UnfitError:
            raise
        except ValueError:
            raise _UnfitError(f"line {number} cannot be read") from None
    return np.array(vertices, float).reshape(-1, 3), np.array(faces, np.int64).reshape(-1, 3)


def _header(raw: bytes) -> tuple[str, dict[str, tuple[int, list[list[str]]]], int]:
    """Format, elements (count and properties) and length [byte] of a PLY header."""
    end = raw.find(b"end_header")
    newline = raw.find(b"\n", max(end, 0))
    if not raw.startswith(b"ply") or end < 0 or newline < 0:
        raise _UnfitError("no PLY header")
    form = ""
    elements: dict[str, tuple[int, list[list[str]]]] = {}
    properties: list[list[str]] = []
    for line in raw[:end].decode("ascii", "replace").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                properties = []
                elements[words[1]] = (int(words[2]), properties)
            elif words[:1] == ["property"]:
                properties.append(words[1:])
        except (ValueError, IndexError):
            raise _UnfitError(f"header line {' '.join(words)[:40]!r}") from None
    if list(elements)[:2] != ["vertex", "face"]:
        raise _UnfitError("the elements do not begin with vertex and face")
    return form, elements, newline + 1


def _dtype(properties: list[list[str]], order: str) -> np.dtype:
    """Layout of one record of an element; every list has three entries."""
    fields: list[tuple] = []
    for p in properties:
        types = p[1:3] if p[:1] == ["list"] else p[:1]
        if len(p) != (4 if p[:1] == ["list"] else 2) or not all(t in _TYPES for t in types):
            raise _UnfitError(f"property {' '.join(p)[:40]!r}")
        if p[0] == "list":
            fields += [(f"#{p[3]}", order + _TYPES[p[1]]), (p[3], order + _TYPES[p[2]], (3,))]
        else:
            fields.append((p[1], order + _TYPES[p[0]]))
    try:
        return np.dtype(fields)
    except ValueError:
        raise _UnfitError("a property comes twice") from None


def _ply(raw: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (vertex, 3) and triangles (face, 3) of a PLY file."""
    form, elements, at = _header(raw)
    orders = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
    if form not in orders:
        raise _UnfitError(f"format {form[:30]!r}")
    tables = {}
    words = raw[at:].split() if form == "ascii" else []
    for name in ("vertex", "face"):
        count, properties = elements[name]
        layout = _dtype(properties, orders[form])
        if form == "ascii":
            width = sum(int(np.prod(layout[i].shape)) for i in range(len(layout.names or ())))
            here, words = words[: count * width], words[count * width :]
            if count < 0 or len(here) < count * width:
                raise _UnfitError(f"fewer than {count} triangles or vertices")
            rows = np.array(here, float).reshape(count, width)
            tables[name] = _columns(rows, layout)
        else:
            if count < 0 or at + count * layout.itemsize > len(raw):
                raise _UnfitError(f"fewer than {count} triangles or vertices")
            tables[name] = np.frombuffer(raw, layout, count, at)
            at += count * layout.itemsize
    vertex, face = tables["vertex"], tables["face"]
    names = face.dtype.names or ()
    corners = next((n for n in ("vertex_indices", "vertex_index") if n in names), None)
    if corners is None or f"#{corners}" not in names:
        raise _UnfitError("faces have no list vertex_indices")
    if (face[f"#{corners}"] != 3).any():
        raise _UnfitError("a face is no triangle")
    if not {"x", "y", "z"} <= set(vertex.dtype.names or ()):
        raise _UnfitError("vertices have no x, y, z")
    points = np.stack([vertex[c].astype(float) for c in "xyz"], axis=-1)
    if any(vertex.dtype[c] == np.float32 for c in "xyz") and len(points):
        _check_rounding(points)
    return points, face[corners].astype(np.int64)


def _check_rounding(points: np.ndarray) -> None:
    """Refuse vertices (vertex, 3) that single precision rounds by more than 1e-4 of the mesh."""
    far, size = float(abs(points).max()), float(np.ptp(points, axis=0).max())
    rounding = float(np.spacing(np.float32(far)))
    if np.isfinite(far) and rounding > 1e-4 * size:
        raise _UnfitError(f"its floats are rounded to {rounding:.2g} at {far:.7g}, write doubles")


def _columns(rows: np.ndarray, layout: np.dtype) -> np.ndarray:
    """Records with a layout from a table of numbers (record, column)."""
    out = np.zeros(len(rows), layout)
    at = 0
    for name in layout.names or ():
        width = int(np.prod(layout[name].shape))
        out[name] = rows[:, at] if layout[name].shape == () else rows[:, at : at + width]
        at += width
    return out


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read the triangles of a mesh file.

    Parameters
    ----------
    path : Path
        PLY (ASCII or binary, triangles only) or OBJ, at most 32 MB; materials, normals and
        texture coordinates are left out.

    Returns
    -------
    vertices : np.ndarray, shape (vertex, 3)
        Coordinates in units of the file.
    faces : np.ndarray, shape (face, 3)
        Indices of vertices.

    Raises
    ------
    InputError
        The file is missing, too large or no mesh, or a face names a missing vertex.
    """
    remedy = "give a PLY or OBJ file of triangles"
    try:
        if not path.is_file():  # a device would never end
            raise InputError(path, "mesh", "no such file", remedy)
        if path.stat().st_size > MAX_BYTES:
            got = f"{path.stat().st_size >> 20} MB"
            raise InputError(path, "size", got, f"give at most {MAX_BYTES >> 20} MB")
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(path, "mesh", str(error.strerror), remedy) from None
    try:
        kind = path.suffix.lower()
        if kind not in (".ply", ".obj"):
            raise _UnfitError(f"the file ends in {kind or 'nothing'!r}")
        with np.errstate(all="ignore"):
            vertices, faces = _ply(raw) if kind == ".ply" else _obj(raw.decode("utf-8", "replace"))
    except (_UnfitError, ValueError, OverflowError) as error:
        got = str(error) if isinstance(error, _UnfitError) else "something that is no number"
        raise InputError(path, "mesh", got, remedy) from None
    if not len(faces):
        raise InputError(path, "mesh", "no triangle", remedy)
    if faces.min() < 0 or faces.max() >= len(vertices):
        got = f"a face names vertex {int(faces.max())} of {len(vertices)}"
        raise InputError(path, "mesh", got, "correct the faces")
    if not np.isfinite(vertices).all():
        raise InputError(path, "mesh", "a coordinate is not finite", "correct the vertices")
    return vertices, faces
