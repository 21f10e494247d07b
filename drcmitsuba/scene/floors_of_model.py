"""Floors of a model in plan, and the rooms into which walls cut them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely

from drcmitsuba.model.model import Layer, Model, areas
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, fits, shortened
from drcmitsuba.scene.geometry import normals

sparse, csgraph = lazy.module("scipy.sparse"), lazy.module("scipy.sparse.csgraph")

LEVEL = 1e-3
"""Largest deviation of a floor's normal from the vertical [–]."""
SAME_HEIGHT = 0.01
"""Floors within this height are one floor [m]."""
GAP = 0.005
"""Half the width of gaps between walls that count as closed [m]."""
MOST_LINES, MOST_PAIRS = 200_000, 1_000_000
"""Largest number of lines that walls are looked for among, and of pairs of them that touch."""
BLOCK = 128
"""Number of lines whose neighbours are looked for at once."""
LEAST_WALL = 1.0
"""Least extent of walls that hang together [m]; chairs and small columns have less."""
LEAST_ROOM = 1.0
"""Area of the smallest room [m²]: what surfaces cut off below it is a column or a cupboard."""


class FloorPart(NamedTuple):
    """Part of a floor that walls cut off from its other parts."""

    name: str
    """Material of most of its floor, with a number where there are several."""
    height: float
    """Height of its floor [m]."""
    outline: Any
    """Shape in plan, a `shapely.Polygon` [m]."""


@lru_cache(maxsize=4)  # grids lie in rooms, which are spaces as well
def rooms_of(
    model: Model, patterns: tuple[str, ...], above: float, source: str
) -> tuple[FloorPart, ...]:
    """Rooms on the level polygons of some materials, floor by floor from the lowest.

    Polygons that are level count, whichever side is their front; those of one height are joined.
    The walls are the surfaces that cross the plane at a height `above` the floor [m]: rooms that an
    opening joins at this height are one room. Rooms of a floor go from south to north. A floor that
    more than `MOST_LINES` cross stays whole.

    Raises
    ------
    InputError
        No level polygon is of a named material.
    """
    quads: dict[str, np.ndarray] = {}
    named: list[tuple[str, Layer]] = []
    for pattern in patterns:
        mine = [
            (name, layer)
            for layer in model.layers
            for name in layer.names
            if fits(name, [pattern]) and layer.role != "context"
        ]
        if not mine:
            names = [name for layer in model.layers for name in layer.names]
            got = f"no surface has the material {shortened(pattern)}"
            raise InputError(source, "sensors.floors", got, choose(pattern, names))
        named += mine
        for name, layer in mine:
            level = layer.quads[_is_level(layer.quads)]
            quads[name] = np.concatenate([quads.get(name, level[:0]), level])
    heights = np.concatenate([level[:, 0, 2] for level in quads.values()])
    if len(heights) == 0:
        got = f"{', '.join(patterns)[:80]} has no level polygon"
        remedy = "name the material of a floor"
        if any(_is_level(layer.quads[..., [0, 2, 1]]).any() for _, layer in named):
            remedy += ', or give up = "y" in [model] where y is up in its files'
        raise InputError(source, "sensors.floors", got, remedy)
    rooms: list[FloorPart] = []
    for rounded in np.unique(np.round(heights / SAME_HEIGHT)) * SAME_HEIGHT:
        at = np.abs(heights - rounded) <= SAME_HEIGHT / 2 + 1e-9
        height = float(heights[at].mean())
        shapes = {}
        for name, level in quads.items():
            here = np.abs(level[:, 0, 2] - rounded) <= SAME_HEIGHT / 2 + 1e-9
            if here.any():
                shapes[name] = in_plan(level[here])
        whole = _grown(shapely.union_all([_grown(s, 1e-3) for s in shapes.values()]), -1e-3)
        for part in parted(model, whole, height + above):
            rooms.append(FloorPart(_name(shapes, part), height, part))
    return tuple(_numbered(rooms))


def _is_level(quads: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(np.abs(normals(quads)[:, 2]) - 1) < LEVEL)


def _name(shapes: Mapping[str, Any], part: Any) -> str:
    """Name of the material that most of a room's floor has."""
    if len(shapes) == 1:
        return next(iter(shapes))
    return max(shapes, key=lambda name: shapes[name].intersection(part).area)


def _numbered(rooms: list[FloorPart]) -> list[FloorPart]:
    """Rooms with a number behind names that come more than once."""
    names, numbers = [room.name for room in rooms], dict[str, int]()
    out = []
    for room in rooms:
        numbers[room.name] = numbers.get(room.name, 0) + 1
        number = f" {numbers[room.name]}" if names.count(room.name) > 1 else ""
        out.append(room._replace(name=room.name + number))
    return out


def in_plan(quads: np.ndarray) -> Any:
    """Union of quads (quad, 4, 3) in plan, as shapely's geometry [m]."""
    # A millimetre closes the seams between polygons that were drawn one by one.
    grown = shapely.buffer(shapely.polygons(quads[:, :, :2]), 1e-3, join_style="mitre")
    return _grown(shapely.union_all(grown), -1e-3)


def _grown(shape: Any, distance: float) -> Any:
    """Shape whose outline is moved outward by a distance [m]; corners stay sharp."""
    return shape.buffer(distance, join_style="mitre")


def parted(model: Model, floor: Any, height: float) -> list[Any]:
    """Parts of a floor that surfaces cut apart at a height [m], as polygons, from the south."""
    lines = shapely.linestrings(section(model, height))
    lines = _walls(lines[shapely.intersects(lines, floor.envelope)])
    walls = shapely.union_all(shapely.buffer(lines, GAP, cap_style="square"))
    pieces = shapely.get_parts(floor.difference(walls))
    whole = [shapely.intersection(_grown(piece, GAP), floor) for piece in pieces]
    parts = [part for one in whole for part in shapely.get_parts(one)]
    parts = [part for part in parts if part.geom_type == "Polygon" and part.area > GAP**2]
    parts = [part for part in parts if part.area >= LEAST_ROOM] or parts
    return sorted(parts, key=lambda p: (round(p.centroid.y, 2), round(p.centroid.x, 2)))


def _walls(lines: np.ndarray) -> np.ndarray:
    """Lines that hang together over `LEAST_WALL` at least: others cannot cut off a room.

    There are none where the lines are too many, or cross too often, to be joined in seconds.
    """
    tree, pairs, count = shapely.STRtree(lines), [np.zeros((2, 0), np.int64)], 0
    if len(lines) > MOST_LINES:
        return lines[:0]
    for start in range(0, len(lines), BLOCK):
        near = tree.query(lines[start : start + BLOCK], "dwithin", 2 * GAP)
        count += near.shape[1]
        if count > MOST_PAIRS:
            return lines[:0]
        pairs.append(near + [[start], [0]])
    first, second = np.concatenate(pairs, axis=1)
    links = sparse.coo_matrix(
        (np.ones(len(first), bool), (first, second)), (len(lines), len(lines))
    )
    _, body = csgraph.connected_components(links, directed=False)
    low, high = np.full((2, len(lines), 2), np.inf)  # of every body, from 0
    high *= -1
    bounds = shapely.bounds(lines)
    np.minimum.at(low, body, bounds[:, :2])
    np.maximum.at(high, body, bounds[:, 2:])
    return np.asarray(lines[(np.hypot(*(high - low).T) >= LEAST_WALL)[body]])


def section(model: Model, height: float) -> np.ndarray:
    """Lines in plan in which a model without its context crosses a height [m], (line, 2, 2) [m]."""
    layers = [layer.quads for layer in model.layers if layer.role != "context"]
    quads = np.concatenate(layers) if layers else np.zeros((0, 4, 3))
    above = quads[:, :, 2] >= height
    crossing = above.any(axis=1) & ~above.all(axis=1)
    start, above = quads[crossing], above[crossing]
    end = np.roll(start, -1, axis=1)
    cut = above != np.roll(above, -1, axis=1)  # two edges of each, since they are convex
    start, end = start[cut], end[cut]
    share = (height - start[:, 2]) / (end[:, 2] - start[:, 2])
    points = start[:, :2] + share[:, None] * (end - start)[:, :2]
    return np.asarray(points.reshape(-1, 2, 2))


@lru_cache(maxsize=16)
def floor_below(model: Model, height: float, lowest: float = -np.inf) -> tuple[Any, float]:
    """Floor in plan and its height [m]: of the levels between two heights [m], the largest.

    Desks are level, too: the floor is the level with the largest area.
    """
    layers = [x.quads for x in model.layers if x.role == "surface"]
    quads = np.concatenate(layers) if layers else np.zeros((0, 4, 3))
    quads = quads[_is_level(quads)]
    z = quads[:, 0, 2]
    below = quads[(z < height) & (z >= lowest)]
    if len(below) == 0:
        return shapely.Polygon(), height
    levels = np.round(below[:, 0, 2] / SAME_HEIGHT)
    values, number = np.unique(levels, return_inverse=True)
    largest = int(np.argmax(np.bincount(number.ravel(), areas(below))))
    return in_plan(below[number.ravel() == largest]), float(values[largest] * SAME_HEIGHT)
