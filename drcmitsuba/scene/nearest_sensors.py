"""Sensors nearest to points that a user names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.runtime.errors import InputError

MOST_POINTS = 24
"""Largest number of points."""
NEAR = 1.0
"""Largest distance from a point to its nearest sensor [m]."""


def positions_of(sensors: xr.Dataset) -> np.ndarray:
    """Positions x, y, and z where there are heights [m], shape (sensor, axis)."""
    return np.column_stack([sensors[axis].values for axis in "xyz" if axis in sensors.coords])


def nearest_sensors(
    sensors: xr.Dataset, points: Sequence[Sequence[float]], source: Path | str
) -> list[int]:
    """Numbers of the sensors nearest to points (x, y) or (x, y, z) [m], each once.

    Errors name the `source` of the points.

    Raises
    ------
    InputError
        Too many points, or one that is far from all sensors.
    """
    at, chosen = positions_of(sensors), []
    if len(points) > MOST_POINTS:
        got = f"{len(points)} points"
        raise InputError(source, "points", got, f"give at most {MOST_POINTS} of them")
    for point in points:
        if len(point) not in (2, 3) or not np.isfinite(point).all():
            got = ", ".join(f"{v:g}" for v in point)
            raise InputError(source, "points", got, "give x,y or x,y,z in metres")
        axes = min(len(point), at.shape[1])
        away = np.linalg.norm(at[:, :axes] - np.asarray(point)[:axes], axis=1)
        sensor = int(away.argmin())
        if away[sensor] > NEAR:
            near = ", ".join(f"{v:g}" for v in at[sensor].round(3))
            got = f"no sensor within {NEAR:g} m of {', '.join(f'{v:g}' for v in point)}"
            raise InputError(source, "points", got, f"the nearest one is at {near}")
        chosen.append(sensor)
    return [*dict.fromkeys(chosen)]
