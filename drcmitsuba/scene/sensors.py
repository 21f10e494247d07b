"""Points of a case at which illuminance is computed."""

from __future__ import annotations

from typing import Any

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import MOST_SENSORS, FloorSensors, Sensors
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components import inside
from drcmitsuba.scene.geometry import boxes, origin, recentred, rotation
from drcmitsuba.scene.sensors_of_model import above_floors, listed, on_a_surface


def sensor_points(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of the sensors in the world frame, shape (sensor, 3) each.

    Positions are relative to the case's `geometry.origin`.

    Raises
    ------
    InputError
        A sensor lies outside the room, inside furniture, or within 1 mm of a surface.
    """
    start, sensors = origin(case), recentred(case).sensors
    if isinstance(sensors, Sensors):
        points, normals = _box_grid(sensors)
    elif isinstance(sensors, FloorSensors):
        points, normals = above_floors(case, sensors)
        points = points - start
    else:
        points, normals = listed(case, sensors)
        points = points - start
    if len(points) > MOST_SENSORS:
        got = f"{len(points)} points"
        raise InputError(case.source, "sensors", got, f"at most {MOST_SENSORS}")
    _check_sensors(case, points, start)
    turn = rotation(case).T
    return points @ turn, normals @ turn


def _box_grid(grid: Sensors) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of a rectangular grid, shape (sensor, 3) each."""
    x = grid.corner[0] + (np.arange(grid.count[0]) + 0.5) * grid.spacing
    y = grid.corner[1] + (np.arange(grid.count[1]) + 0.5) * grid.spacing
    points = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
    points = np.column_stack([points, np.full(len(points), grid.corner[2])])
    return points, np.tile([0.0, 0.0, 1.0], (len(points), 1))


def _check_sensors(case: Case, points: np.ndarray, start: np.ndarray) -> None:
    """Refuse sensors in or on a surface of a room, a piece of furniture or a closed mesh.

    `start` (3,) is the origin of the points in the user's coordinates [m].
    """
    margin = 1e-3 - 1e-9  # 1 mm is allowed, with the rounding of decimals

    def refuse(bad: Any, where: str) -> None:
        if bad.any():
            i = int(np.argmax(bad))
            place = ", ".join(f"{round(v, 4):.10g}" for v in points[i] + start)
            more = f" ({int(bad.sum())} in all)" if bad.sum() > 1 else ""
            raise InputError(
                case.source, "sensors", f"sensor {i} at ({place}) lies {where}{more}",
                "move it at least 1 mm off every surface",
            )  # fmt: skip

    if case.building.layers:
        refuse(on_a_surface(case, points), "on a surface of the model")
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
