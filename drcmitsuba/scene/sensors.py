"""Points of a case at which illuminance is computed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import (
    MOST_GRIDS,
    MOST_SENSORS,
    AnySensors,
    FloorSensors,
    Sensors,
)
from drcmitsuba.model.model import Grid, Model
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components import inside
from drcmitsuba.scene.geometry import boxes, origin, recentred, rotation
from drcmitsuba.scene.sensors_of_model import above_floors, listed, on_a_surface

FACES_UP = 1 - 1e-6
"""Least vertical part of the normal of a sensor that faces up [–]."""


def sensor_points(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of the sensors in the world frame, shape (sensor, 3) each.

    Positions are relative to the case's `geometry.origin`.

    Raises
    ------
    InputError
        A sensor lies outside the room, inside furniture, or within 1 mm of a surface.
    """
    start, grids = origin(case), _grids(case)
    points = np.concatenate([grid.points for grid in grids]) - start
    normals = np.concatenate([grid.normals for grid in grids])
    refuse_in_solids(case, points, start)
    turn = rotation(case).T
    return points @ turn, normals @ turn


def sensor_coordinates(case: Case) -> xr.Dataset:
    """Coordinates of the sensors, dim (sensor,): where they are and which grid they are of.

    Returns
    -------
    xr.Dataset
        `x`, `y`, `z` in the world frame [m]; the normals `nx`, `ny`, `nz` where one does not face
        up; `grid`, the name of each sensor's grid, where there are several.

    Raises
    ------
    InputError
        As `sensor_points`.
    """
    points, normals = sensor_points(case)
    grids = _grids(case)
    at = dict(zip("xyz", (points + origin(case)).T, strict=True))
    if (normals[:, 2] < FACES_UP).any():
        at |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    names = [grid.name for grid in grids]
    if len(set(names)) > 1:
        at["grid"] = np.repeat(np.array(names, dtype=object), [len(g.points) for g in grids])
    return xr.Dataset(coords={name: ("sensor", values) for name, values in at.items()})


def _grids(case: Case) -> tuple[Grid, ...]:
    """Grids of a case in the frame of its file [m]; points on a surface of a model are refused."""
    if case.building.layers:
        return grids_of_model(case.building, case.sensors, case.source, mi.variant())
    return _placed(case.building, case.sensors, case.source)


@lru_cache(maxsize=4)
def grids_of_model(
    model: Model, sensors: AnySensors, source: str, variant: str
) -> tuple[Grid, ...]:
    """Grids of the sensors of a model, in its own frame [m].

    They are made once for a model and a variant of Mitsuba.

    Raises
    ------
    InputError
        The sensors are unfit, or one lies within 1 mm of a surface; the error names the `source`.
    """
    grids = _placed(model, sensors, source)
    points = np.concatenate([grid.points for grid in grids])
    _refuse(on_a_surface(model, points), points, "on a surface of the model", source)
    return grids


def _placed(model: Model, sensors: AnySensors, source: str) -> tuple[Grid, ...]:
    """Grids of the sensors, at most `MOST_GRIDS` with `MOST_SENSORS` points."""
    if isinstance(sensors, Sensors):
        return (_box_grid(sensors),)
    if isinstance(sensors, FloorSensors):
        grids = above_floors(model, sensors, source)
    else:
        grids = listed(model, sensors, source)
    count = sum(len(grid.points) for grid in grids)
    for got, most in ((f"{count} points", MOST_SENSORS), (f"{len(grids)} grids", MOST_GRIDS)):
        if int(got.split()[0]) > most:
            raise InputError(source, "sensors", got, f"at most {most}")
    return grids


def _box_grid(grid: Sensors) -> Grid:
    """Rectangular grid of points that face up [m]."""
    x = grid.corner[0] + (np.arange(grid.count[0]) + 0.5) * grid.spacing
    y = grid.corner[1] + (np.arange(grid.count[1]) + 0.5) * grid.spacing
    points = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
    points = np.column_stack([points, np.full(len(points), grid.corner[2])])
    return Grid("", points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))


def refuse_in_solids(
    case: Case, points: np.ndarray, start: np.ndarray, views: Sequence[str] = ()
) -> None:
    """Refuse sensors in or on a surface of a room, a piece of furniture or a closed mesh.

    `start` (3,) is the origin of the points in the user's coordinates [m]. Points of `views`, by
    their names, are also refused on a surface of the model, which grids have been.
    """
    margin = 1e-3 - 1e-9  # 1 mm is allowed, with the rounding of decimals

    def refuse(bad: Any, where: str) -> None:
        _refuse(bad, points + start, where, case.source, views)

    if views and case.building.layers:
        refuse(on_a_surface(case.building, points + start), "on a surface of the model")
    if case.room is not None:
        size = np.array(case.room.size)
        outside = (points <= margin) | (points >= size - margin)
        refuse(outside.any(axis=1), "in, on or beyond a wall of the room")
    for piece in recentred(case).furniture:
        for corner, size in boxes(piece):
            near = (points > corner - margin) & (points < corner + size + margin)
            refuse(near.all(axis=1), f"in or on {piece.name!r}")
    for name, within in inside(recentred(case), points):
        refuse(within, f"in component {name!r}")


def _refuse(
    bad: np.ndarray, points: np.ndarray, where: str, source: str, views: Sequence[str] = ()
) -> None:
    """Raise InputError with the first of the points (sensor, 3) [m] that are bad."""
    if bad.any():
        i = int(np.argmax(bad))
        place = ", ".join(f"{round(v, 4):.10g}" for v in points[i])
        more = f" ({int(bad.sum())} in all)" if bad.sum() > 1 else ""
        field, name = ("views", f"view {views[i]!r}") if views else ("sensors", f"sensor {i}")
        raise InputError(
            source, field, f"{name} at ({place}) lies {where}{more}",
            "move it at least 1 mm off every surface",
        )  # fmt: skip
