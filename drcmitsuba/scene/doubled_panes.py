"""Panes of a model of one material that lie close behind one another: glass drawn as a thin body.

Light passes each of them, so that a body of glass, or two copies of a pane, let through the square
of its transmittance.
"""

from __future__ import annotations

from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.model import ModelShape
from drcmitsuba.model.notes import Notes
from drcmitsuba.scene.geometry import normals, points_on
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene

DOUBLED = (
    "model: panes lie close behind one another, and light passes both; draw glass as one sheet"
)
THICKEST = 0.05
"""Largest distance of two panes that may be the faces of one [m]."""
THINNEST = 2e-4
"""Distance within which panes are one for the tracer [m]."""
PARALLEL = 0.99
"""Least cosine of the angle between two faces of a pane [–]."""
SHARE = 0.25
"""Share of the area of a material's panes with another one behind, from which on it is noted."""


def doubled_notes(case: Case) -> list[str]:
    """Note panes of a material that lie close behind one another."""
    if not case.building.layers:
        return []
    notes = Notes()
    for name, gap in doubled(case.building.shape, mi.variant()):
        notes.add(DOUBLED, f"{name} ({1000 * gap:.2g} mm)")
    return [sentence.removesuffix(".") for sentence in notes.sentences()]


@lru_cache(maxsize=4)
def doubled(shape: ModelShape, variant: str) -> tuple[tuple[str, float], ...]:
    """Names of layers of panes with another pane close behind, and the median distance [m]."""
    out = []
    for layer in shape.model.layers:
        if layer.role != "pane":
            continue
        quads = layer.quads - layer.quads.min(axis=(0, 1))
        n = normals(quads)
        u, v = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
        area = np.linalg.norm(np.cross(u, v), axis=1)
        behind = _distance(quads, n)
        close = np.isfinite(behind)
        if area[close].sum() > SHARE * area.sum():
            out.append((layer.name, float(np.median(behind[close]))))
    return tuple(out)


def _distance(quads: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Distance (quad,) to a parallel quad before or behind each [m]; ∞ without one close by."""
    scene = mitsuba_scene({"all": quad_mesh("all", quads)})
    p = points_on(quads, np.tile([0.31, 0.27], (len(quads), 1)))
    start, out = mi.Point3f(*p.T.astype(np.float32)), np.full(len(quads), np.inf)
    for side in (1.0, -1.0):
        d = mi.Vector3f(*(side * n.T).astype(np.float32))
        met = scene.ray_intersect(mi.Ray3f(start + THINNEST * d, d, THICKEST, 0, []))
        parallel = dr.abs(dr.dot(met.n, d)) > PARALLEL
        far = dr.select(met.is_valid() & parallel, met.t + THINNEST, dr.inf).numpy()
        out = np.minimum(out, far)
    return out
