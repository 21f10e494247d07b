"""Meshes that Mitsuba traces."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.geometry import is_triangle


def mesh(name: str, vertices: np.ndarray, faces: np.ndarray, bsdf: mi.BSDF | None) -> mi.Mesh:
    """Triangle mesh of vertices (vertex, 3) and faces (face, 3)."""
    props = mi.Properties()
    if bsdf is not None:
        props["bsdf"] = bsdf
    made = mi.Mesh(name, vertex_count=len(vertices), face_count=len(faces), props=props)
    params = mi.traverse(made)
    params["vertex_positions"] = flat(vertices)
    params["faces"] = flat_indices(faces)
    params.update()
    return made


def quad_mesh(name: str, quads: np.ndarray, bsdf: mi.BSDF | None = None) -> mi.Mesh:
    """One mesh of quadrilaterals (quad, 4, 3), of which triangles repeat their last corner.

    Without triangles among them quad i has the faces 2i and 2i + 1; a triangle has one face, which
    halves the memory of large meshes.
    """
    each = np.ones((len(quads), 2), bool)
    each[:, 1] = ~is_triangle(quads)
    return mesh(name, quads.reshape(-1, 3), _halves(len(quads))[each], bsdf)


def paired_mesh(name: str, quads: np.ndarray) -> mi.Mesh:
    """One mesh of quadrilaterals (quad, 4, 3); quad i has the faces 2i and 2i + 1 in any case."""
    return mesh(name, quads.reshape(-1, 3), _halves(len(quads)).reshape(-1, 3), None)


def _halves(count: int) -> np.ndarray:
    """Corners of the two triangles of each quad, shape (quad, 2, 3)."""
    corner = np.arange(count, dtype=np.uint32)[:, None, None] * np.uint32(4)
    return corner + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
