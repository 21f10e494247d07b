"""The rule by which the shade opens and closes, and its smooth twin; [2] in `metrics`."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.metrics import smooth_step
from drcmitsuba.metrics.grids import count_by_grid, grid_of_sensors
from drcmitsuba.metrics.thresholds import blocks, checked, exact_fraction, not_negative


def closing_sensors(area: float, sensors: int) -> int:
    """Sensors in the sun, out of `sensors`, that close the shade: ⌈area·N⌉."""
    return math.ceil(exact_fraction("area", area) * sensors)


def shade_closed(
    direct: xr.DataArray, threshold: float = 1000.0, area: float = 0.02
) -> xr.DataArray:
    """Time stamps at which the shade is closed: when enough of the sensors lie in direct sun.

    closed(t) where #{j : E_j(t) ≥ threshold} ≥ area·N [2], section 2.3.2, in any grid of sensors.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        Illuminance by direct sun without shade [lx]. A coordinate `grid` (sensor,) tells grids
        apart, of N sensors each; without it all sensors are one.
    threshold : float
        Illuminance that counts as exposed [lx].
    area : float
        Fraction of a grid's sensors that closes the shade, 0 to 1. A tie closes it, so 0 always
        does.

    Returns
    -------
    DataArray (time,), bool
        True where the shade is closed, with the coordinates of `time` in `direct`.

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, a threshold out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> direct = xr.DataArray([[0.0, 900.0], [0.0, 2500.0]], dims=("time", "sensor"))
    >>> drcmitsuba.metrics.shade_closed(direct, area=0.02).values
    array([False,  True])
    """
    E = checked(direct, "direct")
    grid = grid_of_sensors(direct)
    required = np.array([closing_sensors(area, n) for n in np.bincount(grid).tolist()])
    limit = not_negative("threshold", threshold)
    count = np.concatenate([count_by_grid(block >= limit, grid) for block in blocks(E)])
    closed = direct.isel(sensor=0, drop=True).copy(data=(count >= required).any(axis=1))
    closed.name, closed.attrs = "shade_closed", {"long_name": "shade closed"}
    return closed


def smooth_shade_closed(
    direct: mi.TensorXf, threshold: float = 1000.0, area: float = 0.02, *, sharpness: float
) -> mi.TensorXf:
    """Twin of `shade_closed`: s(Σ_j s(E_tj; threshold); n − ½).

    Parameters
    ----------
    direct : mi.TensorXf (time, sensor)
        Illuminance by direct sun without shade [lx].
    threshold, area, sharpness : float
        As for `shade_closed`; n is the count of sensors by `closing_sensors`; k of both steps.

    Returns
    -------
    mi.TensorXf (time,)
        Fraction by which the shade is closed, 0 to 1.

    Raises
    ------
    InputError
        No time stamp or sensor, a threshold or a sharpness out of range.
    """
    passed = smooth_step.passed(direct, threshold, sharpness)
    required = closing_sensors(area, direct.shape[1])
    if required == 0:
        return dr.full(mi.TensorXf, 1.0, (direct.shape[0],))
    return smooth_step.step(smooth_step.total(passed, axis=1), required - 0.5, sharpness)


def applied(open: mi.TensorXf, shaded: mi.TensorXf, closed: mi.TensorXf) -> mi.TensorXf:
    """Blend the illuminances of both states: E = (1 − closed)·open + closed·shaded.

    Parameters
    ----------
    open, shaded : mi.TensorXf (time, sensor)
        Illuminance with the shade open and closed [lx].
    closed : mi.TensorXf (time,)
        From `smooth_shade_closed`.

    Returns
    -------
    mi.TensorXf (time, sensor)
        Illuminance with the shade applied [lx].
    """
    return open + (shaded - open) * dr.reshape(mi.TensorXf, closed, (closed.shape[0], 1))
