"""Sensors nearest to points that a user names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.prepared_case import prepared

MOST_POINTS = 24
"""Largest number of points."""
NEAR = 1.0
"""Largest distance from a point to its nearest sensor [m]."""


def nearest_sensors(case: Case, points: Sequence[Sequence[float]]) -> list[int]:
    """Numbers of the sensors nearest to points (x, y) or (x, y, z) [m], each once.

    Raises
    ------
    InputError
        No point, too many of them, or one that is far from all sensors.
    """
    known = prepared(case).receivers.coordinates
    at, chosen = np.stack([known[axis].values for axis in "xyz"], axis=1), []
    if not 0 < len(points) <= MOST_POINTS:
        got = f"{len(points)} points"
        raise InputError(case.source, "points", got, f"give 1 to {MOST_POINTS} of them")
    for point in points:
        if len(point) not in (2, 3) or not np.isfinite(point).all():
            got = ", ".join(f"{v:g}" for v in point)
            raise InputError(case.source, "points", got, "give x,y or x,y,z in metres")
        away = np.linalg.norm(at[:, : len(point)] - point, axis=1)
        sensor = int(away.argmin())
        if away[sensor] > NEAR:
            near = ", ".join(f"{v:g}" for v in at[sensor].round(3))
            got = f"no sensor within {NEAR:g} m of {', '.join(f'{v:g}' for v in point)}"
            raise InputError(case.source, "points", got, f"the nearest one is at {near}")
        chosen.append(sensor)
    return [*dict.fromkeys(chosen)]
