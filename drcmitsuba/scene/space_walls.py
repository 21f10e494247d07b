"""Walls of spaces: upright opaque surfaces of a model, plane by plane, with the space behind them.

The surfaces in one plane are joined. A line just inside the plane tells which spaces lie behind
it. Spaces are known in plan: where one lies on either side, as of a wall between rooms, of a screen
and of a clerestory above the roof of a lower part, rays tell whether the outer side is outdoors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.model import Layer, Model, areas
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.space import Space
from drcmitsuba.model.windows import GRID, SAME_PLANE, shape_in
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.geometry import normals, turn
from drcmitsuba.scene.panes_of_model import (
    AWAY,
    OFFSET,
    RAYS,
    all_surfaces,
    escaping,
    side_name,
)
from drcmitsuba.scene.prepared_case import prepared

sparse, csgraph = lazy.module("scipy.sparse"), lazy.module("scipy.sparse.csgraph")
spatial = lazy.module("scipy.spatial")

UPRIGHT = 0.02
"""Largest vertical part of an upright wall's normal [–]."""
INSIDE = 0.05
"""Distance from a wall at which its space is looked for [m]."""
LEAST = 0.01
"""Area of the smallest wall [m²]."""


@dataclass(frozen=True, eq=False)
class PlaneSurfaces:
    """Surfaces of a model in one plane."""

    plane: Plane
    quads: Mapping[int, np.ndarray]
    """Indices of the quads in the plane, by layer."""

    def shape(self, model: Model, layer: int) -> Any:
        """Union of a layer's quads in the plane, as shapely's geometry [m]."""
        return shape_in(self.plane, model.layers[layer].quads[self.quads[layer]])


@dataclass(frozen=True, eq=False)
class SpaceWall:
    """Wall of a space in one plane."""

    space: str
    """Name of the space behind it."""
    floor: float
    """Height of that space's floor [m]."""
    plane: Plane
    """Plane whose normal leads out of the space; seen from there, u goes from left to right, and v
    is the height above the model's origin."""
    facing: str
    """Direction that it faces, such as "south"."""
    shapes: Mapping[int, Any]
    """Parts of opaque layers that nothing else in the plane covers, in the plane [m], by layer."""
    outline: Any
    """All surfaces of the wall, holes filled, in the plane [m]."""
    openings: Any
    """Panes and holes in it, in the plane [m]."""

    @property
    def azimuth(self) -> float:
        """Direction that it faces, clockwise from the model's y axis [deg]."""
        x, y, _ = self.plane.normal
        return float(np.degrees(np.arctan2(x, y)) % 360)


def upright_plane(corner: np.ndarray, outward: np.ndarray) -> Plane:
    """Plane through a corner (3,) [m]; seen from outside, u goes to the right, and v up."""
    u = np.cross([0.0, 0.0, 1.0], outward)
    u /= np.linalg.norm(u)
    return Plane(outward * (corner @ outward), u, np.cross(outward, u), outward)


def upright_planes(model: Model) -> list[PlaneSurfaces]:
    """Upright surfaces and panes of a model, without its context, by plane."""
    members: list[tuple[int, np.ndarray]] = []
    for i, layer in enumerate(model.layers):
        if layer.role != "context":
            n, size = _normals(layer.quads)
            members.append((i, np.flatnonzero((size > GRID) & (np.abs(n[:, 2]) < UPRIGHT))))
    of_layer = np.repeat([i for i, _ in members], [len(some) for _, some in members])
    index = np.concatenate([np.zeros(0, int), *(some for _, some in members)])
    if not len(index):
        return []
    quads = np.concatenate([model.layers[i].quads[some] for i, some in members])
    n, size = _normals(quads)
    n = n * np.where(n @ [0.61, 0.77, 0.0] < 0, -1, 1)[:, None]
    start = quads.min(axis=(0, 1))
    keys = np.column_stack([n, np.einsum("qi,qi->q", n, quads[:, 0] - start)]) / SAME_PLANE
    rough, place = np.unique(np.round(keys), axis=0, return_inverse=True)
    pairs = spatial.cKDTree(rough).query_pairs(1.8, output_type="ndarray").T
    links = sparse.coo_matrix((np.ones(pairs.shape[1], bool), pairs), (len(rough), len(rough)))
    number = csgraph.connected_components(links, directed=False)[1][place.ravel()]
    planes = []
    for k in range(number.max() + 1):
        mine = np.flatnonzero(number == k)
        largest = mine[np.argmax(size[mine])]
        plane = upright_plane(quads[largest, 0], n[largest])
        by_layer = {i: index[mine[of_layer[mine] == i]] for i in np.unique(of_layer[mine]).tolist()}
        planes.append(PlaneSurfaces(plane, by_layer))
    return planes


def is_wall(layer: Layer) -> bool:
    """Whether a layer is opaque, diffuse and always stands."""
    changes = layer.group or layer.stands_in or layer.states
    return layer.role == "surface" and isinstance(layer.material, Lambertian) and not changes


def walls_of(case: Case) -> list[SpaceWall]:
    """Walls of all spaces of a model that have no space on their outer side."""
    spaces = prepared(case).spaces
    if not spaces:
        return []
    floors = _Floors(spaces)
    return [
        wall
        for surfaces in upright_planes(case.building)
        if any(is_wall(case.building.layers[i]) for i in surfaces.quads)
        for wall in _walls_in(case.building, surfaces, floors)
    ]


def meant_walls(case: Case, design: Design) -> list[SpaceWall]:
    """Walls that `[design]` means by side, space and material, with these materials alone.

    They come space by space, each clockwise from the model's y axis.

    Raises
    ------
    InputError
        The model has no spaces, a name is that of none, or no wall is meant.
    """
    layers, every = case.building.layers, walls_of(case)
    spaces = [space.name for space in prepared(case).spaces]
    if not spaces:
        remedy = "state its rooms in [spaces], or give sensors above floors"
        raise InputError(case.source, "design.spaces", "the model has no spaces", remedy)
    names = list(dict.fromkeys(layers[i].name for wall in every for i in wall.shapes))
    for key, patterns, known in (("spaces", design.spaces, spaces), ("walls", design.walls, names)):
        for pattern in patterns:
            if not any(fnmatchcase(name, pattern) for name in known):
                got = f"none is called {shortened(pattern)}"
                raise InputError(case.source, f"design.{key}", got, choose(pattern, known))
    facings = sorted({wall.facing for wall in every})
    if design.side is not None and design.side not in facings:
        got = f"no outer wall faces {design.side}"
        remedy = choose(design.side, facings) if facings else "give its rooms upright walls"
        raise InputError(case.source, "design.side", got, remedy)

    def is_named(name: str, patterns: Sequence[str]) -> bool:
        return not patterns or any(fnmatchcase(name, pattern) for pattern in patterns)

    meant = []
    for wall in every:
        shapes = {i: s for i, s in wall.shapes.items() if is_named(layers[i].name, design.walls)}
        if shapes and is_named(wall.space, design.spaces) and design.side in (None, wall.facing):
            meant.append(replace(wall, shapes=shapes))
    if not meant:
        got, remedy = "no wall has this side, space and material", "leave one of them out"
        raise InputError(case.source, "design.walls", got, remedy)
    return sorted(meant, key=lambda wall: (spaces.index(wall.space), wall.azimuth))


def _walls_in(model: Model, surfaces: PlaneSurfaces, floors: _Floors) -> Iterator[SpaceWall]:
    """Walls in a plane, with spaces on either side of it."""
    shapes = {i: surfaces.shape(model, i) for i in surfaces.quads}
    every = shapely.union_all([*shapes.values()], grid_size=GRID)
    low, _, high, _ = every.bounds
    sides = [floors.behind(surfaces.plane, sign, low, high) for sign in (-1, 1)]
    unions = [shapely.union_all([region for *_, region in side]) for side in sides]
    for sign, side, beyond in ((1, sides[0], unions[1]), (-1, sides[1], unions[0])):
        outward = sign * surfaces.plane.normal
        plane = upright_plane(surfaces.plane.corner, outward)
        facing = side_name(-outward @ turn(-model.north).T, True)
        for name, floor, region in side:
            here = shapely.difference(region, beyond)
            across = common(region, beyond)
            here = shapely.union_all([here, *_outdoors(model, surfaces, shapes, across, outward)])
            of_space = {i: common(shape, here) for i, shape in shapes.items()}
            walls = {i: s for i, s in of_space.items() if is_wall(model.layers[i])}
            free = {}
            for i, own in walls.items():
                others = [s for j, s in of_space.items() if j != i]
                free[i] = shapely.difference(own, shapely.union_all(others), grid_size=GRID)
            free = {i: _turned(s, sign) for i, s in free.items() if s.area > LEAST}
            if not free:
                continue
            opaque = shapely.union_all(
                [s for i, s in of_space.items() if model.layers[i].role == "surface"]
            )
            outline = _filled(shapely.union_all([*of_space.values()], grid_size=GRID))
            openings = shapely.difference(outline, opaque, grid_size=GRID)
            outline, openings = _turned(outline, sign), _turned(openings, sign)
            yield SpaceWall(name, floor, plane, facing, free, outline, openings)


def _outdoors(
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
        for part in shapely.get_parts(common(_filled(every), shapely.box(left, low, right, high)))
        if (wall := common(opaque, part)).area > LEAST
    ]
    if not parts:
        return []
    uv = np.array([shapely.get_coordinates(point)[0] for _, point in parts])
    at = plane.corner + uv[:, :1] * plane.u + uv[:, 1:] * plane.v
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


@dataclass(frozen=True, eq=False)
class _Floors:
    """Floors of spaces, from the highest."""

    spaces: Sequence[Space]

    @cached_property
    def rows(self) -> list[tuple[Space, float, Any]]:
        rows = [(s, floor.height, floor.outline) for s in self.spaces for floor in s.floors]
        return sorted(rows, key=lambda row: -row[1])

    @cached_property
    def tree(self) -> Any:
        return shapely.STRtree([outline for *_, outline in self.rows])

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
        for k in sorted(self.tree.query(line, "intersects").tolist()):
            space, floor, outline = self.rows[k]
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


def _normals(quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (quad, 3), and areas (quad,) [m²]."""
    size = areas(quads)
    n = np.zeros((len(quads), 3))
    some = size > 0
    n[some] = normals(quads[some])
    return n, size


def common(one: Any, other: Any) -> Any:
    """Polygons that two shapes share; lines where they only touch are left out."""
    both = shapely.intersection(one, other, grid_size=GRID)
    parts = [p for p in shapely.get_parts(both) if p.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def _filled(shape: Any) -> Any:
    """Shape without its holes."""
    return shapely.union_all([shapely.Polygon(p.exterior) for p in shapely.get_parts(shape)])


def _turned(shape: Any, sign: int) -> Any:
    """Shape as it is, or seen from behind."""
    if sign > 0:
        return shape
    return shapely.transform(shape, lambda uv: uv * [-1.0, 1.0])
