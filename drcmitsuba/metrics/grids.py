"""Grids of sensors: which sensors are counted together, beside the count of all."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from drcmitsuba.case.sensors import MOST_GRIDS
from drcmitsuba.runtime.errors import InputError


def sensors_by_grid(illuminance: xr.Dataset | xr.DataArray) -> dict[str, np.ndarray]:
    """Indices of the sensors of each grid, by the coordinate `grid` (sensor,).

    Parameters
    ----------
    illuminance : xr.Dataset or DataArray
        Array with the dim `sensor`.

    Returns
    -------
    dict of str to np.ndarray of int
        Grids in the order of their first sensors; empty where there is no such coordinate.

    Raises
    ------
    InputError
        There are more than 2000 grids.
    """
    grids = sensors_by_name(illuminance, "grid")
    if len(grids) > MOST_GRIDS:
        got = f"{len(grids)} grids"
        raise InputError("illuminance", "grid", got, f"give at most {MOST_GRIDS}")
    return grids


def sensors_by_name(
    illuminance: xr.Dataset | xr.DataArray, coordinate: str
) -> dict[str, np.ndarray]:
    """Indices of the sensors of each name in a coordinate (sensor,), in the order of the first.

    It is empty where there is no such coordinate.
    """
    if coordinate not in illuminance.coords:
        return {}
    named = np.array([*map(str, illuminance[coordinate].values)], dtype=object)
    number, names = pd.factorize(named)
    order = np.argsort(number, kind="stable")
    parts = np.split(order, np.searchsorted(number[order], np.arange(1, len(names))))
    return dict(zip(names.tolist(), parts, strict=True))


def grid_of_sensors(illuminance: xr.Dataset | xr.DataArray) -> np.ndarray:
    """Number of every sensor's grid, in the order of `sensors_by_grid`, int, shape (sensor,).

    It is 0 for all sensors where there are no grids.
    """
    number = np.zeros(illuminance.sizes["sensor"], np.int64)
    for i, sensors in enumerate(sensors_by_grid(illuminance).values()):
        number[sensors] = i
    return number


def count_by_grid(mask: np.ndarray, grid: np.ndarray, grids: int = 0) -> np.ndarray:
    """Number of sensors of each grid at which a mask holds.

    Parameters
    ----------
    mask : np.ndarray of bool, shape (time, sensor)
    grid : np.ndarray of int, shape (sensor,)
        From `grid_of_sensors`.
    grids : int
        Least number of grids; the last ones may have no sensor.

    Returns
    -------
    np.ndarray of int, shape (time, grid)
    """
    grids = max(grids, int(grid.max()) + 1)
    time, sensor = np.divmod(np.flatnonzero(mask), mask.shape[1])  # the sun reaches few
    count = np.bincount(time * grids + grid[sensor], minlength=len(mask) * grids)
    return count.reshape(len(mask), grids)
