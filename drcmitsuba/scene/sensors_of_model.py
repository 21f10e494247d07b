"""Sensors of a model: grids above its floors, lists of points, and points on its surfaces."""

from __future__ import annotations

import math
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import MOST_SENSORS, FloorSensors, PointSensors
from drcmitsuba.model.model import Model, areas
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.geometry import normals, origin
from drcmitsuba.scene.panes_of_model import all_surfaces

LEVEL = 1e-3
"""Largest deviation of a floor's normal from the vertical [–]."""
SAME_HEIGHT = 0.01
"""Floors within this height are one floor [m]."""
NEAR = 1e-3
"""Least distance of a sensor from a surface [m]."""
_ANGLES = np.arange(16) * (np.pi / 8)
_AROUND = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(16)])
"""Level directions to walls."""


@lru_cache(maxsize=4)
def floors_of(model: Model, patterns: tuple[str, ...], source: str) -> list[tuple[float, Any]]:
    """Floors of some materials, from the lowest: height [m] and outline in plan.

    Polygons that are level count, whichever side is their front; those of one height are joined.

    Raises
    ------
    InputError
        No level polygon is of a named material.
    """
    level: list[np.ndarray] = []
    for pattern in patterns:
        mine = [x for x in model.layers if fnmatchcase(x.name, pattern) and x.role != "context"]
        if not mine:
            names = [layer.name for layer in model.layers]
            got = f"no surface has the material {shortened(pattern)}"
            raise InputError(source, "sensors.floors", got, choose(pattern, names))
        level += [q[np.abs(np.abs(normals(q)[:, 2]) - 1) < LEVEL] for q in (x.quads for x in mine)]
    quads = np.concatenate(level)
    if len(quads) == 0:
        got = f"{', '.join(patterns)[:80]} has no level polygon"
        raise InputError(source, "sensors.floors", got, "name the material of a floor")
    heights = quads[:, 0, 2]
    floors = []
    for height in np.unique(np.round(heights / SAME_HEIGHT)) * SAME_HEIGHT:
        at = np.abs(heights - height) <= SAME_HEIGHT / 2 + 1e-9
        floors.append((float(heights[at].mean()), _in_plan(quads[at])))
    return floors


def _in_plan(quads: np.ndarray) -> Any:
    """Union of quads (quad, 4, 3) in plan, as shapely's geometry."""
    # A millimetre closes the seams between polygons that were drawn one by one.
    grown = shapely.buffer(shapely.polygons(quads[:, :, :2]), 1e-3, join_style="mitre")
    return shapely.union_all(grown).buffer(-1e-3, join_style="mitre")


def floor_below(model: Model, height: float) -> Any:
    """Floor in plan: of the level surfaces below a height [m], those of the largest level."""
    quads = np.concatenate([x.quads for x in model.layers if x.role == "surface"])
    quads = quads[np.abs(np.abs(normals(quads)[:, 2]) - 1) < LEVEL]
    below = quads[quads[:, 0, 2] < height]
    if len(below) == 0:
        return shapely.Polygon()
    # Desks are level, too: the floor is the level with the largest area.
    levels = np.round(below[:, 0, 2] / SAME_HEIGHT)
    sizes = {level: areas(below[levels == level]).sum() for level in np.unique(levels)}
    return _in_plan(below[levels == max(sizes, key=lambda level: sizes[level])])


def above_floors(case: Case, sensors: FloorSensors) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and upward normals of grids above floors, shape (sensor, 3) each.

    The points of a floor stand in the middles of equal squares, of `spacing` at most, that cover
    the extent of the floor without its margin. Points nearer than the margin to a partition, a
    column or another surface at their height are left out.
    """
    points = []
    for height, outline in floors_of(case.building, sensors.floors, case.source):
        within = outline.buffer(-sensors.margin, join_style="mitre")
        if within.is_empty:
            continue
        x0, y0, x1, y1 = within.bounds
        counts = [max(1, math.ceil(e / sensors.spacing - 1e-6)) for e in (x1 - x0, y1 - y0)]
        if math.prod(counts) > 8 * MOST_SENSORS:
            got = f"{math.prod(counts)} points above one floor"
            raise InputError(case.source, "sensors.spacing", got, "take a larger spacing")
        x, y = (
            low + (np.arange(n) + 0.5) * (high - low) / n
            for low, high, n in ((x0, x1, counts[0]), (y0, y1, counts[1]))
        )
        at = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
        at = at[shapely.contains_xy(within, at)]
        points.append(np.column_stack([at, np.full(len(at), height + sensors.height)]))
    if not sum(map(len, points)):
        got = f"a margin of {sensors.margin:g} m leaves no floor"
        raise InputError(case.source, "sensors.margin", got, "take a smaller margin")
    every = np.concatenate(points)
    every = every[~_near(case, every, _AROUND, max(sensors.margin, NEAR))]
    if len(every) == 0:
        got = f"all points stand within {sensors.margin:g} m of a surface"
        raise InputError(case.source, "sensors.margin", got, "take a smaller margin")
    return every, np.tile([0.0, 0.0, 1.0], (len(every), 1))


def listed(case: Case, sensors: PointSensors) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of a file's points or of a model's grids, (sensor, 3) each."""
    if sensors.points is not None:
        from drcmitsuba.model.radiance import read_points

        grids = [read_points(sensors.points)]
    else:
        names = [grid.name for grid in case.building.grids]
        for pattern in sensors.grids:
            if not any(fnmatchcase(name, pattern) for name in names):
                got = f"the model has no grid {shortened(pattern)}"
                raise InputError(case.source, "sensors.grids", got, choose(pattern, names))
        grids = [
            grid
            for grid in case.building.grids
            if any(fnmatchcase(grid.name, pattern) for pattern in sensors.grids)
        ]
    return np.concatenate([g.points for g in grids]), np.concatenate([g.normals for g in grids])


def on_a_surface(case: Case, points: np.ndarray) -> np.ndarray:
    """Whether points (sensor, 3) lie within `NEAR` of a surface of the model, shape (sensor,).

    The points are relative to the case's `geometry.origin`.
    """
    return _near(case, points + origin(case), np.concatenate([np.eye(3), -np.eye(3)]), NEAR)


def _near(case: Case, points: np.ndarray, directions: np.ndarray, distance: float) -> np.ndarray:
    """Whether points (sensor, 3) meet a surface within a distance [m] in any of some directions."""
    scene, start, _ = all_surfaces(case.building, mi.variant())
    lane = dr.arange(mi.UInt32, len(points) * len(directions))
    p = dr.gather(mi.Point3f, flat(points - start), lane // len(directions))
    d = dr.gather(mi.Vector3f, flat(directions), lane % len(directions))
    # The rays begin a little behind the points, which may lie in a surface themselves.
    ray = mi.Ray3f(mi.Point3f(p - NEAR / 2 * d), d, distance + NEAR / 2 - 1e-6, 0, [])
    hit = scene.ray_test(ray, coherent=False)
    return np.asarray(hit.numpy().reshape(len(points), -1).any(axis=1))
