"""Kinds of surfaces whose reflectance is a design parameter, and marks of rays that end on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.scene import scene
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import Scene
from drcmitsuba.scene.surfaces import surfaces_of

WALLS = tuple(f"wall {side}" for side in ("south", "east", "north", "west"))
FRAMES = tuple(name.replace("wall", "frame") for name in WALLS)


class Kinds:
    """Marks of rays: 1 + the number of the kind of surface that a ray ends on, 0 for all others.

    It is a rule of `gather.paths.Marks` for paths that end at their first diffuse vertex.

    Parameters
    ----------
    shapes : sequence of mi.Shape or None
        Mesh of each kind; None where a kind has no surface.
    """

    def __init__(self, shapes: Sequence[mi.Shape | None]) -> None:
        self.context = mi.BSDFContext()
        self.shapes = [None if shape is None else mi.ShapePtr(shape) for shape in shapes]

    def meet(
        self, si: mi.SurfaceInteraction3f, mark: mi.UInt32, number: mi.Float
    ) -> tuple[mi.BSDFPtr, mi.UInt32, mi.Float, mi.Bool, mi.Bool]:
        """Mark a ray where it meets a surface of a kind; see `gather.paths.Marks.meet`."""
        for k, shape in enumerate(self.shapes, start=1):
            if shape is not None:
                mark = dr.select(si.shape == shape, mi.UInt32(k), mark)
        return si.bsdf(), mark, mi.Float(1), mi.Bool(True), mi.Bool(False)


def marked(case: Case, state: State, values: Mapping[str, float]) -> tuple[Scene, Kinds]:
    """Scene with one mesh for every kind of surface, and the marks of rays that end on them.

    `values` are the reflectances by kind: `floor`, `ceiling`, `walls`, or the names of furniture.
    """
    quads: dict[str, list[np.ndarray]] = {key: [] for key in values}
    others = []
    for surface in surfaces_of(case, state):
        key = "walls" if surface.name in WALLS else surface.name
        if key in quads and isinstance(surface.material, Lambertian):
            quads[key].append(surface.quads)
        else:
            others.append(surface)
    meshes = [
        scene.quad_mesh(key, np.concatenate(of_kind), mi.load_dict(bsdf(Lambertian(values[key]))))
        if of_kind
        else None  # walls entirely of glass
        for key, of_kind in quads.items()
    ]
    shapes = [*scene.build(others).full.shapes(), *(mesh for mesh in meshes if mesh is not None)]
    named = {f"shape{i}": shape for i, shape in enumerate(shapes)}
    full = mitsuba_scene(named)
    return scene.load(case, state).searched(full=full), Kinds(meshes)
