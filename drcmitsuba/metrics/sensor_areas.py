"""Spacing of grids, and the floor area that each sensor stands for."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError

spatial = lazy.module("scipy.spatial")

NEIGHBOURS = 12
"""Nearest points among which two directions of a grid are looked for."""
ACROSS = 0.5
"""Sine of the angle from which on two neighbours lie in different directions."""
ALIKE = 1.01
"""Ratio up to which spacings count as equal."""


def spacings(illuminance: xr.Dataset | xr.DataArray) -> dict[str, float]:
    """Spacing of the points of every grid [m], in the wider of its two directions.

    It is the median over the points of the distance to the nearest point that lies in another
    direction than the very nearest; infinite for points in a line.

    Raises
    ------
    InputError
        A place is not finite.
    """
    points = _places(illuminance)
    grids = sensors_by_grid(illuminance) or {"": np.arange(len(points))}
    return {name: _spacing(points[sensors]) for name, sensors in grids.items()}


def _places(illuminance: xr.Dataset | xr.DataArray) -> np.ndarray:
    points = np.stack([illuminance[axis].values for axis in "xyz"], axis=1)
    if not np.isfinite(points).all():
        got = "places that are not finite"
        raise InputError("illuminance", "x, y, z", got, "compute the illuminance anew")
    return points


def _spacing(points: np.ndarray) -> float:
    count = min(NEIGHBOURS + 1, len(points))
    if count < 3:
        return np.inf
    distance, index = spatial.cKDTree(points).query(points, count)
    to = points[index[:, 1:]] - points[:, None]
    with np.errstate(invalid="ignore"):
        to /= np.linalg.norm(to, axis=2, keepdims=True)
    sine = np.linalg.norm(np.cross(to, to[:, :1]), axis=2)
    across = np.where(sine > ACROSS, distance[:, 1:], np.inf).min(axis=1)
    return float(np.median(across))


def area_shares(
    illuminance: xr.Dataset | xr.DataArray, sets: Iterable[np.ndarray]
) -> list[np.ndarray]:
    """Share of the floor of a set of sensors that each of them stands for [–].

    A sensor stands for the square of its grid's spacing. Sensors of a single grid, of grids whose
    spacings are alike, and of a set with points in a line stand for the same area each.

    Parameters
    ----------
    illuminance : xr.Dataset or DataArray
        Array with the dim `sensor`, the places `x`, `y`, `z` [m], and the coordinate `grid`.
    sets : iterable of np.ndarray
        Indices of the sensors of every set, such as those of a space, shape (own sensor,).

    Returns
    -------
    list of np.ndarray
        Shares of every set, of the sum 1, shape (own sensor,) each.
    """
    grids = sensors_by_grid(illuminance)
    of_grid = np.zeros(illuminance.sizes["sensor"], np.int64)
    for i, sensors in enumerate(grids.values()):
        of_grid[sensors] = i
    return [_shares(illuminance, of_grid, sensors) for sensors in sets]


def _shares(
    illuminance: xr.Dataset | xr.DataArray, of_grid: np.ndarray, sensors: np.ndarray
) -> np.ndarray:
    even = np.full(len(sensors), 1 / max(len(sensors), 1))
    numbers, own = np.unique(of_grid[sensors], return_inverse=True)
    if len(numbers) < 2:
        return even
    points = _places(illuminance)[sensors]
    apart = np.array([_spacing(points[own == i]) for i in range(len(numbers))])
    if not np.isfinite(apart).all() or apart.max() <= ALIKE * apart.min():
        return even
    area = apart[own] ** 2
    return np.asarray(area / area.sum())
