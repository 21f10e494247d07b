"""Sensors of a model: grids above its floors, lists of points, and points on its surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterable

import drjit as dr
import mitsuba as mi
import numpy as np
import shapely

from drcmitsuba.case.sensors import (
    MOST_SENSORS,
    FloorSensors,
    GridsByRule,
    PointSensors,
    SpaceSensors,
)
from drcmitsuba.model.model import Layer, Model, SensorGrid
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.toml import choose, fits, shortened, unmet
from drcmitsuba.scene.floors_of_model import FloorPart, rooms_of
from drcmitsuba.scene.panes_of_model import all_surfaces

NAME_SPACES = "outline rooms in [spaces.NAME], or give floors, grids or points in [sensors]"
"""Remedy where there are no spaces to choose from."""
NEAR = 1e-3
"""Least distance of a sensor from a surface [m]."""
FREE = 0.4
"""Share of directions that are free at points outside, at least: half of them before a façade."""
_ANGLES = np.arange(16) * (np.pi / 8)
_AROUND = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(16)])
"""Level directions to walls."""


def above_floors(model: Model, sensors: FloorSensors, source: str) -> tuple[SensorGrid, ...]:
    """Grids of points that face up, one above each room's floor, in the model's frame [m].

    Raises
    ------
    InputError
        As `rooms_of`; no point is left, or there are too many. The error names the case's `source`.
    """
    rooms = rooms_of(model, sensors.floors, sensors.height, source)
    return _by_rule(model, rooms, sensors, source)


def in_spaces(model: Model, sensors: SpaceSensors, source: str) -> tuple[SensorGrid, ...]:
    """Grids of points that face up, one in each space, by its name, in the model's frame [m].

    Raises
    ------
    InputError
        No space has a given name, no point is left, or there are too many.
    """
    names = [space.name for space in model.spaces]
    for pattern in unmet(sensors.spaces, names):
        got = f"there is no space {shortened(pattern)}"
        remedy = choose(pattern, names) if names else f"the model has none: {NAME_SPACES}"
        raise InputError(source, "sensors.spaces", got, remedy)
    parts = (
        FloorPart(f"{space.name} {k}" if len(space.floors) > 1 else space.name, z, outline)
        for space in model.spaces
        if fits(space.name, sensors.spaces)
        for k, (z, outline) in enumerate(space.floors, start=1)
    )
    return _by_rule(model, parts, sensors, source)


def _by_rule(
    model: Model, rooms: Iterable[FloorPart], sensors: GridsByRule, source: str
) -> tuple[SensorGrid, ...]:
    """Grids of rooms.

    The points of a room stand in the middles of equal squares, of `spacing` at most, that cover
    the extent of its floor without the margin. Points nearer than the margin to a partition, a
    column or another surface at their height are left out.
    """
    margin, grids, count = sensors.edge, list[tuple[str, np.ndarray]](), 0
    for room in rooms:
        with np.errstate(invalid="ignore"):  # GEOS warns of corners that nearly coincide
            within = room.outline.buffer(-margin, join_style="mitre")
        if within.is_empty:
            continue
        x0, y0, x1, y1 = within.bounds
        counts = [max(1, math.ceil(e / sensors.spacing - 1e-6)) for e in (x1 - x0, y1 - y0)]
        count += math.prod(counts)
        if count > 8 * MOST_SENSORS:
            got = f"{count} points above the floors"
            raise InputError(source, "sensors.spacing", got, "take a larger spacing")
        x, y = (
            low + (np.arange(n) + 0.5) * (high - low) / n
            for low, high, n in ((x0, x1, counts[0]), (y0, y1, counts[1]))
        )
        at = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
        at = at[shapely.contains_xy(within, at)]
        points = np.column_stack([at, np.full(len(at), room.height + sensors.height)])
        grids.append((room.name, points))
    if not sum(len(points) for _, points in grids):
        got = f"a margin of {margin:g} m leaves no floor"
        raise InputError(source, "sensors.margin", got, "take a smaller margin")
    every = np.concatenate([points for _, points in grids])
    free = ~_near(model, every, _AROUND, max(margin, NEAR))
    if not free.any():
        got = f"all points stand within {margin:g} m of a surface"
        raise InputError(source, "sensors.margin", got, "take a smaller margin")
    ends = np.cumsum([len(points) for _, points in grids])[:-1]
    kept = [
        (name, points[is_free])
        for (name, points), is_free in zip(grids, np.split(free, ends), strict=True)
    ]
    up = np.array([0.0, 0.0, 1.0])
    return tuple(SensorGrid(name, p, np.tile(up, (len(p), 1))) for name, p in kept if len(p))


def listed(model: Model, sensors: PointSensors, source: str) -> tuple[SensorGrid, ...]:
    """Points of a file or a case, or grids of a model by their names, in the model's frame [m]."""
    if isinstance(sensors.points, tuple):
        whole = [row if len(row) == 6 else (*row, 0, 0, 1) for row in sensors.points]
        rows = np.array(whole, float)
        normals = rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
        return (SensorGrid("", rows[:, :3], normals),)
    if sensors.points is not None:
        from drcmitsuba.model.radiance import read_points

        return (read_points(sensors.points),)
    names = [grid.name for grid in model.grids]
    for pattern in unmet(sensors.grids, names):
        got = f"the model has no grid {shortened(pattern)}"
        raise InputError(source, "sensors.grids", got, choose(pattern, names))
    wanted = (g for g in model.grids if fits(g.name, sensors.grids))
    grids = tuple(grid for grid in wanted if len(grid.points))
    if not grids:
        got = "the grids have no points"
        raise InputError(source, "sensors.grids", got, "name others, or floors")
    return grids


def on_a_surface(model: Model, points: np.ndarray) -> np.ndarray:
    """Whether points (sensor, 3) [m] lie within `NEAR` of a surface of the model, (sensor,)."""
    return _near(model, points, np.concatenate([np.eye(3), -np.eye(3)]), NEAR)


def outside_rooms(model: Model, points: np.ndarray) -> np.ndarray:
    """Whether points (sensor, 3) [m] lie outside of a model's rooms, bool (sensor,).

    From such a point the larger part of a half of all directions is free, up or down, and so are
    the level ones: a room whose roof is missing has its walls. Bodies outside do not count.
    """
    near = tuple(layer for layer in model.layers if layer.role != "context")
    if not near:
        return np.ones(len(points), bool)
    out = _free(near, points, _AROUND) > FREE
    if out.any():
        heights = (np.arange(32) + 0.5) / 32
        turns = np.arange(32) * np.pi * (3 - np.sqrt(5))  # an even spiral over a half-space
        level = np.sqrt(1 - heights**2)
        up = np.column_stack([level * np.cos(turns), level * np.sin(turns), heights])
        mine = points[out]
        out[out] = np.maximum(_free(near, mine, up), _free(near, mine, -up)) > FREE
    return out


def _free(layers: tuple[Layer, ...], points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Share of directions (direction, 3) in which points meet no surface of layers, (sensor,)."""
    scene, start, _ = all_surfaces(Model(layers), mi.variant())
    lane = dr.arange(mi.UInt32, len(points) * len(directions))
    p = dr.gather(mi.Point3f, flat(points - start), lane // len(directions))
    d = dr.gather(mi.Vector3f, flat(directions), lane % len(directions))
    hit = scene.ray_test(mi.Ray3f(p, d), coherent=False)
    return np.asarray(1 - hit.numpy().reshape(len(points), -1).mean(axis=1))


def _near(model: Model, points: np.ndarray, directions: np.ndarray, distance: float) -> np.ndarray:
    """Whether points (sensor, 3) meet a surface within a distance [m] in any of some directions."""
    scene, start, _ = all_surfaces(model, mi.variant())
    lane = dr.arange(mi.UInt32, len(points) * len(directions))
    p = dr.gather(mi.Point3f, flat(points - start), lane // len(directions))
    d = dr.gather(mi.Vector3f, flat(directions), lane % len(directions))
    # The rays begin a little behind the points, which may lie in a surface themselves.
    ray = mi.Ray3f(mi.Point3f(p - NEAR / 2 * d), d, distance + NEAR / 2 - 1e-6, 0, [])
    hit = scene.ray_test(ray, coherent=False)
    return np.asarray(hit.numpy().reshape(len(points), -1).any(axis=1))
