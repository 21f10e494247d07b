"""Either side of an upright plane of a model: spaces, by their plans, and outdoors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np
import shapely

from drcmitsuba.model.model import Model
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.space import Space
from drcmitsuba.model.windows import GRID, SAME_PLANE
from drcmitsuba.scene.panes_of_model import AWAY, OFFSET, RAYS, all_surfaces, escaping
from drcmitsuba.scene.upright_planes import LEAST, PlaneSurfaces, common, filled, is_wall

INSIDE = 0.05
"""Distance from a wall at which its space is looked for [m]."""


@dataclass(frozen=True, eq=False)
class SpaceFloors:
    """Floors of spaces, from the highest."""

    spaces: Sequence[Space]

    @cached_property
    def _rows(self) -> list[tuple[Space, float, Any]]:
        rows = [(s, floor.height, floor.outline) for s in self.spaces for floor in s.floors]
        return sorted(rows, key=lambda row: -row[1])

    @cached_property
    def _tree(self) -> Any:
        return shapely.STRtree([outline for *_, outline in self._rows])

    def behind(
        self, plane: Plane, sign: int, low: float, high: float
    ) -> list[tuple[str, float, Any]]:
        """Name, floor [m] and region in a plane of each space on one side, `sign` times its normal.

        Regions lie between `low` and `high` along u [m]; a space ends where the next one above it
        begins.
        """
        ends = np.array([[low], [high]]) * plane.u + plane.corner + sign * INSIDE * plane.normal
        line = shapely.LineString(ends[:, :2])
        taken, found = shapely.Polygon(), []
        for k in sorted(self._tree.query(line, "intersects").tolist()):
            space, floor, outline = self._rows[k]
            parts = shapely.get_parts(shapely.intersection(line, outline))
            spans = [
                sorted(((np.array(part.coords) - plane.corner[:2]) @ plane.u[:2]).tolist())
                for part in parts
                if part.geom_type == "LineString"
            ]
            top = space.ceiling if np.isfinite(space.ceiling) else floor + 1e3
            z = np.array([floor, top]) - plane.corner[2]
            boxes = [shapely.box(span[0], z[0], span[-1], z[1]) for span in spans]
            region = shapely.difference(shapely.union_all(boxes), taken)
            taken = shapely.union(taken, region)
            if region.area > LEAST:
                found.append((space.name, floor, region))
        return found


def outdoors(
    model: Model, surfaces: PlaneSurfaces, shapes: Mapping[int, Any], region: Any,
    outward: np.ndarray,
) -> list[Any]:  # fmt: skip
    """Parts of a region in a plane that are wall, with the outdoors on its outer side alone.

    They end at the heights at which other surfaces meet the plane, as the roof of a lower part.
    """
    every = common(shapely.union_all([*shapes.values()], grid_size=GRID), region)
    if every.area <= LEAST:
        return []
    opaque = shapely.union_all([s for i, s in shapes.items() if is_wall(model.layers[i])])
    plane, (left, bottom, right, top) = surfaces.plane, every.bounds
    heights = [z for z in _heights(model, plane) if bottom < z < top]
    parts = [
        (part, wall.representative_point())
        for low, high in pairwise([bottom, *heights, top])
        for part in shapely.get_parts(common(filled(every), shapely.box(left, low, right, high)))
        if (wall := common(opaque, part)).area > LEAST
    ]
    if not parts:
        return []
    uv = np.array([shapely.get_coordinates(point)[0] for _, point in parts])
    at = plane.points(uv)
    scene, low, extent = all_surfaces(model, mi.variant())
    fronts = np.repeat([outward, -outward], len(parts) * RAYS, axis=0)
    starts = np.repeat(np.concatenate([at, at]) - low, RAYS, axis=0)
    share = escaping(scene, starts + OFFSET * (1 + extent) * fronts, fronts).reshape(2, -1)
    return [
        part for (part, _), out, within in zip(parts, *share, strict=True) if out > AWAY >= within
    ]


def _heights(model: Model, plane: Plane) -> list[float]:
    """Heights in a plane of all corners of surfaces that lie in it [m], rounded to 1 mm."""
    corners = np.concatenate([layer.quads.reshape(-1, 3) for layer in model.layers]) - plane.corner
    near = np.abs(corners @ plane.normal) < SAME_PLANE
    heights: list[float] = np.unique(np.round(corners[near] @ plane.v, 3)).tolist()
    return heights
