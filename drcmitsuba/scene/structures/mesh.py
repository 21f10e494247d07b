"""Triangles of PLY and OBJ files, in few of which a component or a structure is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drcmitsuba.model.facets import polygon_quads
from drcmitsuba.model.mesh.obj import obj_polygons
from drcmitsuba.model.mesh.ply import ply_polygons
from drcmitsuba.model.source_file import size_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import is_triangle

MAX_BYTES = 1 << 25
READERS = {".ply": ply_polygons, ".obj": obj_polygons}
"""Readers of vertices and faces by the ending of a file."""


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read the triangles of a mesh file.

    Parameters
    ----------
    path : Path
        PLY or OBJ, at most 32 MiB; materials, normals and texture coordinates are left out.

    Returns
    -------
    vertices : np.ndarray, shape (vertex, 3)
        Coordinates in units of the file.
    faces : np.ndarray, shape (face, 3)
        Indices of vertices. Polygons of more corners are cut, and have vertices of their own.

    Raises
    ------
    InputError
        The file is missing, too large or no mesh, or a face names a missing vertex.
    """
    remedy = "give a PLY or OBJ file of triangles"
    size_of(path, MAX_BYTES)
    kind = path.suffix.lower()
    if kind not in READERS:
        raise InputError(path, "mesh", f"the file ends in {kind or 'nothing'!r}", remedy)

    def refuse(_: int, wrong: str) -> InputError:
        return InputError(path, "mesh", f"a face that is {wrong}", remedy)

    vertices, rings = READERS[kind](path)
    if rings and kind == ".ply":
        _check_rounding(path, vertices)
    triangles = rings.pop(3, np.empty((0, 3), np.int64))
    quads = [polygon_quads(vertices[index], refuse)[0] for index in rings.values()]
    corners = np.concatenate([np.empty((0, 4, 3)), *quads])
    halves = np.concatenate([corners[:, [0, 1, 2]], corners[~is_triangle(corners)][:, [0, 2, 3]]])
    own = len(vertices) + np.arange(3 * len(halves)).reshape(-1, 3)
    faces = np.concatenate([triangles, own])
    if not len(faces):
        raise InputError(path, "mesh", "no triangle", remedy)
    return np.concatenate([vertices, halves.reshape(-1, 3)]), faces


def _check_rounding(path: Path, points: np.ndarray) -> None:
    """Refuse vertices (vertex, 3) that single precision rounds by more than 1e-4 of the mesh."""
    far, size = float(abs(points).max()), float(np.ptp(points, axis=0).max())
    rounding = float(np.spacing(np.float32(far)))
    if rounding > 1e-4 * size and (points == points.astype(np.float32)).all():
        got = f"its floats are rounded to {rounding:.2g} at {far:.7g}"
        raise InputError(path, "mesh", got, "write doubles")
