"""Panes of a model that lie close behind one another.

Glass that is drawn as a thin body, or twice, lets through the square of its transmittance. Panes
that scatter, and glass that mirrors before them, send light to and fro.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.model import Layer, ModelShape, areas
from drcmitsuba.model.notes import Notes
from drcmitsuba.scene.geometry import normals, points_on
from drcmitsuba.scene.like_panes import NO_GROUP
from drcmitsuba.scene.materials import is_mirroring_glass
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.prepared_case import prepared

DOUBLED = (
    "model: panes lie close behind one another, and light passes both; draw glass as one sheet"
)
THICKEST, CAVITY = 0.05, 2.0
"""Largest distance of two panes that may be the faces of one, and of panes that send light to and
fro [m]."""
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
    for name, gap in _doubled(case.building.shape, mi.variant()):
        notes.add(DOUBLED, f"{name} ({1000 * gap:.2g} mm)")
    return [sentence.removesuffix(".") for sentence in notes.sentences()]


def mirroring_before(case: Case) -> list[str]:
    """Names of glass that mirrors, and stands before or behind a pane that reflects diffusely."""
    panes = [
        (layer, _kinds(case, i))
        for i, layer in enumerate(case.building.layers)
        if layer.role == "pane" and len(layer.quads)
    ]
    matt = [layer for layer, kinds in panes if any(map(_is_matt, kinds))]
    if not matt:
        return []
    names = []
    for layer, kinds in panes:
        if (
            any(map(is_mirroring_glass, kinds))
            and np.isfinite(_distance(matt, [layer], CAVITY)).any()
        ):
            names.append(layer.name)
    return names


def _kinds(case: Case, layer: int) -> list[SurfaceMaterial | None]:
    """Materials that a layer of panes has in any state of its groups."""
    groups, own = prepared(case).groups, case.building.layers[layer]
    kinds = [case.materials.get(own.name, own.material), *(s.material for s in own.states)]
    for group in np.unique(groups.of_quads[layer]).tolist():
        if group != NO_GROUP and groups.materials:
            kinds += groups.materials[group]
    return kinds


def _is_matt(material: SurfaceMaterial | None) -> bool:
    """Whether a pane reflects, and not as a mirror."""
    if isinstance(material, DiffuserMaterial):
        return any(material.sides)
    return isinstance(material, BsdfMaterial)


@lru_cache(maxsize=4)
def _doubled(shape: ModelShape, variant: str) -> tuple[tuple[str, float], ...]:
    """Names of layers of panes with another pane close behind, and the median distance [m]."""
    out = []
    for layer in shape.model.layers:
        if layer.role == "pane" and len(layer.quads):
            behind, area = _distance([layer], [layer], THICKEST), areas(layer.quads)
            close = np.isfinite(behind)
            if area[close].sum() > SHARE * area.sum():
                out.append((layer.name, float(np.median(behind[close]))))
    return tuple(out)


def _distance(panes: Iterable[Layer], others: Iterable[Layer], most: float) -> np.ndarray:
    """Distance (quad,) of panes to others that stand parallel before or behind them [m].

    It is ∞ without one within `most`.
    """
    quads, there = (np.concatenate([layer.quads for layer in some]) for some in (panes, others))
    low = quads.min(axis=(0, 1))
    scene, n = mitsuba_scene({"all": quad_mesh("all", there - low)}), normals(quads)
    p = points_on(quads - low, np.tile([0.31, 0.27], (len(quads), 1)))
    start, out = mi.Point3f(*p.T.astype(np.float32)), np.full(len(quads), np.inf)
    for side in (1.0, -1.0):
        d = mi.Vector3f(*(side * n.T).astype(np.float32))
        met = scene.ray_intersect(mi.Ray3f(start + THINNEST * d, d, most, 0, []))
        parallel = dr.abs(dr.dot(met.n, d)) > PARALLEL
        far = dr.select(met.is_valid() & parallel, met.t + THINNEST, dr.inf).numpy()
        out = np.minimum(out, far)
    return out
