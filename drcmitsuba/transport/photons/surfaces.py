"""Surfaces as photons meet them: clear panes of components are passed without a search.

A pane that reflects nothing leaves a photon its way and takes some of its flux. The panes of a
double glazing with lamellae between them would be every second surface that a photon meets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.scene.flat_panes import FlatPanes
from drcmitsuba.scene.materials import ends_paths
from drcmitsuba.scene.met_faces import MetFaces
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import Scene, ScenePart


@dataclass(frozen=True)
class PhotonScene:
    """Surfaces of a scene for photons."""

    surfaces: mi.Scene
    """Surfaces that are searched."""
    met_faces: MetFaces
    """Their faces."""
    panes: FlatPanes | None
    """Panes that are not, where they are a few rectangles."""

    @classmethod
    def of(cls, scene: Scene) -> PhotonScene:
        """Take the clear panes of components out of a scene."""
        clear = [part for part in scene.parts if _only_takes(part)]
        panes = FlatPanes.of((part.quads, part.bsdf) for part in clear)
        if panes is None:
            return cls(scene.full, scene.met_faces, None)
        left = [shape for shape in scene.full.shapes() if not any(_is_of(shape, p) for p in clear)]
        surfaces = mitsuba_scene({f"shape{i}": shape for i, shape in enumerate(left)})
        return cls(surfaces, MetFaces.of(surfaces), panes)

    def intersect(self, ray: mi.Ray3f, active: mi.Bool) -> mi.SurfaceInteraction3f:
        """Surface that active rays meet first, but for the panes that are not searched."""
        return self.met_faces.intersect(self.surfaces, ray, active)

    def passed(self, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool) -> Passed:
        """Panes that flights from points pass."""
        planes = () if self.panes is None else self.panes.planes
        return Passed(tuple(plane.crossing(mi.Ray3f(p, d), active) for plane in planes))


class Passed(NamedTuple):
    """Panes that flights pass."""

    planes: tuple[tuple[mi.Float, mi.Float], ...]
    """Distance to each plane [m], and transmittance there; 1 for none."""

    def within(self, length: mi.Float) -> mi.Float:
        """Share of flux that panes leave over a length [m]."""
        share = mi.Float(1)
        for distance, transmittance in self.planes:
            share *= dr.select(distance < length, transmittance, 1)
        return share


def _only_takes(part: ScenePart) -> bool:
    """Whether a part is panes of a component that let light straight through."""
    m = part.material
    return bool(part.component) and isinstance(m, GlazingMaterial) and ends_paths(m)


def _is_of(shape: mi.Shape, part: ScenePart) -> bool:
    return bool(shape.bsdf() == part.bsdf)
