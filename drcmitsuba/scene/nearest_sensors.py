"""Sensors nearest to points that a user names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drcmitsuba.runtime.errors import InputError

MOST_POINTS = 24
"""Largest number of points."""
NEAR = 1.0
"""Largest distance from a point to its nearest sensor [m]."""


def nearest_sensors(
    at: np.ndarray, points: Sequence[Sequence[float]], source: Path | str
) -> list[int]:
    """Numbers of the sensors nearest to points (x, y) or (x, y, z) [m], each once.

    `at` are all sensors [m], shape (sensor, 2 or 3); errors name the `source` of the points.

    Raises
    ------
    InputError
        Too many points, or one that is far from all sensors.
    """
    chosen = []
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
