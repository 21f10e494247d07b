"""Walls of spaces: upright opaque surfaces of a model, plane by plane, with the space behind them.

The surfaces in one plane are joined. A line just inside the plane tells which spaces lie behind
it. Spaces are known in plan: where one lies on either side, as of a wall between rooms, of a screen
and of a clerestory above the roof of a lower part, rays tell whether the outer side is outdoors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.model.model import Model
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.windows import GRID
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, fits, shortened, unmet
from drcmitsuba.scene.geometry import turn
from drcmitsuba.scene.panes_of_model import side_name
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.upright_planes import (
    LEAST,
    PlaneSurfaces,
    common,
    filled,
    is_wall,
    upright_plane,
    upright_planes,
)
from drcmitsuba.scene.wall_sides import SpaceFloors, outdoors


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


def walls_of(case: Case) -> list[SpaceWall]:
    """Walls of all spaces of a model that have no space on their outer side."""
    spaces = prepared(case).spaces
    if not spaces:
        return []
    floors = SpaceFloors(spaces)
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
        for pattern in unmet(patterns, known):
            got = f"none is called {shortened(pattern)}"
            raise InputError(case.source, f"design.{key}", got, choose(pattern, known))
    facings = sorted({wall.facing for wall in every})
    if design.side is not None and design.side not in facings:
        got = f"no outer wall faces {design.side}"
        remedy = choose(design.side, facings) if facings else "give its rooms upright walls"
        raise InputError(case.source, "design.side", got, remedy)

    def is_named(name: str, patterns: Sequence[str]) -> bool:
        return not patterns or fits(name, patterns)

    meant = []
    for wall in every:
        shapes = {i: s for i, s in wall.shapes.items() if is_named(layers[i].name, design.walls)}
        if shapes and is_named(wall.space, design.spaces) and design.side in (None, wall.facing):
            meant.append(replace(wall, shapes=shapes))
    if not meant:
        got, remedy = "no wall has this side, space and material", "leave one of them out"
        raise InputError(case.source, "design.walls", got, remedy)
    return sorted(meant, key=lambda wall: (spaces.index(wall.space), wall.azimuth))


def _walls_in(model: Model, surfaces: PlaneSurfaces, floors: SpaceFloors) -> Iterator[SpaceWall]:
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
            here = shapely.union_all([here, *outdoors(model, surfaces, shapes, across, outward)])
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
            outline = filled(shapely.union_all([*of_space.values()], grid_size=GRID))
            openings = shapely.difference(outline, opaque, grid_size=GRID)
            outline, openings = _turned(outline, sign), _turned(openings, sign)
            yield SpaceWall(name, floor, plane, facing, free, outline, openings)


def _turned(shape: Any, sign: int) -> Any:
    """Shape as it is, or seen from behind."""
    if sign > 0:
        return shape
    return shapely.transform(shape, lambda uv: uv * [-1.0, 1.0])
