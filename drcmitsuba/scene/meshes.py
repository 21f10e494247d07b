"""Meshes that Mitsuba traces."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices


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
    """One mesh of quadrilaterals (quad, 4, 3); quad i has triangles 2i and 2i + 1."""
    corner = np.arange(len(quads))[:, None] * 4
    faces = np.concatenate([corner + [0, 1, 2], corner + [0, 2, 3]], axis=1)
    return mesh(name, quads.reshape(-1, 3), faces.reshape(-1, 3), bsdf)
