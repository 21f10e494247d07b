"""Outer faces of walls that are drawn with two faces, between which a window has reveals.

A face of a wall's own material stands parallel to the inner one, at most `DEEPEST` behind it. A
tile goes on through it where it is the only one: of several faces one behind the other, nobody
knows which are one wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mitsuba as mi
import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.model.space import space_at
from drcmitsuba.model.windows import DEEPEST, GRID, SAME_PLANE, shape_in
from drcmitsuba.scene.panes_of_model import AWAY, OFFSET, RAYS, all_surfaces, escaping
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.space_walls import SpaceWall
from drcmitsuba.scene.upright_planes import PlaneSurfaces, common, is_wall, upright_planes
from drcmitsuba.scene.wall_sides import INSIDE

NEAREST = 0.01
"""Least distance between the two faces of one wall [m]."""
COVERS = 0.5
"""Share of a tile that one face behind it, and no other one, covers, at least [–]."""
MOST_FACES = 8
"""Largest number of faces that are counted behind a wall."""


@dataclass(frozen=True, eq=False)
class FaceBehind:
    """Surfaces parallel to a wall, behind it."""

    depth: float
    """Distance from the wall [m]."""
    shape: Any
    """Shape in the wall's plane, as shapely's geometry [m]."""


@dataclass(frozen=True, eq=False)
class OuterFaces:
    """Upright surfaces of a model, as faces behind its walls."""

    case: Case

    @cached_property
    def planes(self) -> list[PlaneSurfaces]:
        """Upright planes of the model."""
        return upright_planes(self.case.building)

    def behind(self, wall: SpaceWall) -> list[FaceBehind]:
        """Faces parallel to a wall on its outer side, at most `DEEPEST` away, from the nearest."""
        layers, plane, faces = self.case.building.layers, wall.plane, []
        for surfaces in self.planes:
            depth = float((surfaces.plane.corner - plane.corner) @ plane.normal)
            across = np.linalg.norm(np.cross(surfaces.plane.normal, plane.normal))
            if across > SAME_PLANE or not NEAREST <= depth <= DEEPEST:
                continue
            quads = [layers[i].quads[q] for i, q in surfaces.quads.items() if is_wall(layers[i])]
            if quads:
                faces.append(FaceBehind(depth, shape_in(plane, np.concatenate(quads))))
        return sorted(faces, key=lambda face: face.depth)

    def only_one(
        self, wall: SpaceWall, faces: Sequence[FaceBehind], shape: Any
    ) -> FaceBehind | None:
        """Part of a shape in a wall that has one face behind it alone, as that face.

        None where that is less than `COVERS` of the shape, or where a space lies behind the face.
        """
        parts = [common(shape, face.shape) for face in faces]
        best = FaceBehind(0.0, shapely.Polygon())
        for k, face in enumerate(faces):
            others = shapely.union_all([*parts[:k], *parts[k + 1 :]])
            own = shapely.difference(parts[k], others, grid_size=GRID)
            if own.area > best.shape.area:
                best = FaceBehind(face.depth, own)
        if best.shape.area < COVERS * shape.area or self._is_space(wall, shape, best.depth):
            return None
        return best

    def _is_space(self, wall: SpaceWall, shape: Any, depth: float) -> bool:
        """Whether a space lies beyond a depth behind a shape in a wall [m]."""
        at = point_of(wall, shape) + (depth + INSIDE) * wall.plane.normal
        return bool(space_at(prepared(self.case).spaces, at[None])[0] >= 0)

    def unclear(self, walls: Sequence[SpaceWall], shapes: Sequence[Any]) -> tuple[int, int] | None:
        """Index of a shape that has faces before the outdoors, and their count; None without one.

        Each shape lies in the wall of the same index. Rays follow the wall's normal through at most
        `MOST_FACES` faces; a space among them ends a ray.
        """
        scene, low, extent = all_surfaces(self.case.building, mi.variant())
        offset = OFFSET * (1 + extent)
        outward = np.array([wall.plane.normal for wall in walls])
        start = np.array([point_of(w, s) for w, s in zip(walls, shapes, strict=True)])
        depth, count = np.zeros(len(walls)), np.zeros(len(walls), int)
        going = np.ones(len(walls), bool)
        for _ in range(MOST_FACES):
            at = start - low + (depth + offset)[:, None] * outward
            rays = mi.Ray3f(mi.Point3f(at.T), mi.Vector3f(outward.T))
            gap = scene.ray_intersect_preliminary(rays).t.numpy() + offset
            going &= depth + gap < DEEPEST
            depth[going] += gap[going]
            count[going] += 1
            beyond = start + (depth + INSIDE)[:, None] * outward
            going &= space_at(prepared(self.case).spaces, beyond) < 0
        at = start - low + (depth + offset)[:, None] * outward
        share = escaping(scene, np.repeat(at, RAYS, axis=0), np.repeat(outward, RAYS, axis=0))
        for i in np.flatnonzero((count > 0) & (share > AWAY)).tolist():
            return i, int(count[i])
        return None


def point_of(wall: SpaceWall, shape: Any) -> np.ndarray:
    """Point (3,) of a shape in a wall's plane [m]."""
    return wall.plane.points(shapely.get_coordinates(shape.representative_point())[0])
