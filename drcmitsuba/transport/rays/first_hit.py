"""First surface that a ray meets: in a box room by closed form, elsewhere by a search.

The walls of a room are few large triangles that nearly all rays meet, and that a search finds
slowly. From within a box, a ray ends at the face that it reaches first, unless furniture stands
before it, or it passes an aperture of the face. Only then is there anything to search for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices, vectors_of
from drcmitsuba.scene.met_faces import MetFaces
from drcmitsuba.scene.scene import Scene
from drcmitsuba.scene.surfaces import NEAR
from drcmitsuba.transport.rays.openings import Openings


@lru_cache(maxsize=8)  # every round of rays in a room asks for the same ones
def _numbers(
    room: bytes, parts: tuple[int, ...], variant: str
) -> tuple[tuple[mi.Vector3f, ...], mi.Vector3f, mi.Float, mi.UInt32]:
    """Last fields of `InBox`, from a room's axes and its size, and the parts of its faces."""
    rows = np.frombuffer(room).reshape(4, 3)
    *axes, size = vectors_of(rows)
    inward = np.kron(rows[:3], [[1], [-1]])
    # Directions about a normal depend on the signs of its zeros: those of meshes have none.
    normals, shape = flat(np.where(inward == 0, 0, inward)), flat_indices(parts)
    dr.eval(normals, shape)
    return tuple(axes), size, normals, shape


class Searched(NamedTuple):
    """Surfaces of any scene."""

    full: mi.Scene
    met_faces: MetFaces

    def intersect(self, ray: mi.Ray3f, active: mi.Bool) -> mi.SurfaceInteraction3f:
        """Surface that active rays meet first."""
        return self.met_faces.intersect(self.full, ray, active)


@dataclass(frozen=True)
class InBox:
    """Surfaces of a box room with plain faces, as kernels read them."""

    full: mi.Scene
    """All surfaces."""
    apart: mi.Scene
    """All but the faces, outside of their apertures."""
    met_faces: MetFaces
    """Faces of both."""
    apertures: Openings
    axes: tuple[mi.Vector3f, ...]
    """Axes of the room in the world's frame."""
    size: mi.Vector3f
    """Extent of the room along them [m]."""
    normals: mi.Float
    """Inward normal of each face, three numbers each."""
    shape: mi.UInt32
    """Index of the shape whose material each face has."""

    @classmethod
    def of(cls, scene: Scene) -> InBox | Searched:
        """Surfaces of a scene, searched where its room is no such box."""
        room, faces, apart = scene.enclosure, scene.faces, scene.apart
        if room is None or faces is None or apart is None:
            return Searched(scene.full, scene.met_faces)
        apertures = Openings(faces.apertures, occluders=apart)
        for i in range(len(apertures.quads)):
            apertures.axes(i)  # not within a loop that is being recorded
        numbers = np.array([*room.turn.T, room.size], float).tobytes()
        axes = _numbers(numbers, faces.parts, str(mi.variant()))
        return cls(scene.full, apart, scene.met_faces, apertures, *axes)

    def intersect(self, ray: mi.Ray3f, active: mi.Bool) -> mi.SurfaceInteraction3f:
        """Surface that active rays meet first."""
        inside, t, face = mi.Bool(True), mi.Float(dr.inf), mi.UInt32(0)
        for k, (axis, size) in enumerate(zip(self.axes, self.size, strict=True)):
            o, d = dr.dot(ray.o, axis), dr.dot(ray.d, axis)
            inside &= (o > -NEAR) & (o < size + NEAR)
            reaches = dr.select(d > 0, size - o, -o) / d
            nearer = (d != 0) & (reaches < t)
            t = dr.select(nearer, reaches, t)
            face = dr.select(nearer, 2 * k + dr.select(d > 0, mi.UInt32(1), 0), face)
        leaves = self.apertures.passed(mi.UInt32(0), ray.o, ray.d)
        ends = inside & ~leaves
        before = mi.Ray3f(ray)
        before.maxt = dr.select(ends, t, ray.maxt)
        within, outside = active & inside, active & ~inside
        met = self.apart.ray_intersect_preliminary(before, coherent=False, active=within)
        other = self.full.ray_intersect_preliminary(ray, coherent=False, active=outside)
        met = dr.select(inside, met, other)
        si = self.met_faces.surface(met, ray, active)
        wall = active & ends & ~met.is_valid()
        inward = dr.gather(mi.Normal3f, self.normals, face, wall)
        si.t = dr.select(wall, t, si.t)
        si.p = dr.select(wall, ray(t), si.p)
        si.n = dr.select(wall, inward, si.n)
        si.sh_frame = dr.select(wall, mi.Frame3f(inward), si.sh_frame)
        at = dr.gather(mi.UInt32, self.shape, face, wall)
        of_face = dr.gather(mi.ShapePtr, self.full.shapes_dr(), at, wall)
        si.shape = dr.select(wall, of_face, si.shape)
        si.wi = si.to_local(-ray.d)
        return si
