"""Light exposure of points [lx·h], uniformity, and hours in direct sun by day.

References
----------
.. [1] CIE 157:2004, "Control of damage to museum objects by optical radiation".
.. [2] EN 17037, "Daylight in buildings": exposure to sunlight.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.metrics import thresholds
from drcmitsuba.metrics.point_autonomy import by_sensor
from drcmitsuba.runtime.errors import InputError


def light_exposure(illuminance: xr.DataArray, step_hours: float = 1.0) -> xr.DataArray:
    """Light exposure H_j = Σ_t E_tj · step, annual where E covers a year [1].

    It is linear in E: its own smooth twin.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance with the shade applied [lx].
    step_hours : float
        Length of the interval that one time stamp stands for [h].

    Returns
    -------
    DataArray (sensor,)
        Exposure [lx·h].

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, a step out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.light_exposure(E).values
    array([ 950., 2200.])
    """
    E = thresholds.checked(illuminance, "illuminance")
    total = E.sum(axis=0, dtype=float) * thresholds.not_negative("step_hours", step_hours)
    return by_sensor(illuminance, total, "exposure", "light exposure", "lx h")


def uniformity(illuminance: xr.DataArray) -> xr.DataArray:
    """Uniformity U₀ = min_j E_tj / mean_j E_tj of every time stamp.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance of one room [lx]; or its daylight factors [%], with a dim `time` of length 1.

    Returns
    -------
    DataArray (time,)
        U₀, 0 to 1 [–]; NaN where the room is dark.

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.uniformity(E).values.round(2)
    array([0.4 , 0.75, 0.74, 0.44])
    """
    E = thresholds.checked(illuminance, "illuminance")
    mean = E.mean(axis=1, dtype=float)
    lit = mean > 0
    values = np.where(lit, E.min(axis=1) / np.where(lit, mean, 1), np.nan)
    out = illuminance.isel(sensor=0, drop=True).copy(data=values)
    out.name, out.attrs = "uniformity", {"units": "1", "long_name": "uniformity"}
    return out


def sunlight_hours(
    direct: xr.DataArray, threshold: float = 1.0, step_hours: float = 1.0
) -> xr.DataArray:
    """Hours in direct sun on every day, of the sun that comes straight [2].

    A cloudless day in the sense of the standard has to be among the days: a sky of sunshine, or
    the coefficients `straight` of the suns in place of `direct`, with a threshold of their own.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        Illuminance by direct sun [lx], with dates in the coordinate `time`.
    threshold : float
        Illuminance from which on a point counts as in the sun [lx].
    step_hours : float
        Length of the interval that one time stamp stands for [h].

    Returns
    -------
    DataArray (day, sensor)
        Hours in the sun [h]; `day` holds the dates.

    Raises
    ------
    InputError
        As `light_exposure`; stamps that are not dates, a threshold of 0.

    Examples
    --------
    >>> import drcmitsuba
    >>> import pandas as pd
    >>> import xarray as xr
    >>> time = pd.to_datetime(["2015-01-05 12:00", "2015-01-05 13:00", "2015-02-05 12:00"])
    >>> direct = xr.DataArray([[0.0], [2000.0], [500.0]], {"time": time}, ("time", "sensor"))
    >>> drcmitsuba.metrics.sunlight_hours(direct).values
    array([[1.],
           [1.]])
    """
    E = thresholds.checked(direct, "direct")
    thresholds.months(direct, "direct")
    if thresholds.not_negative("threshold", threshold) == 0:
        raise InputError("metrics", "threshold", "0", "give an illuminance above 0")
    step = thresholds.not_negative("step_hours", step_hours)
    days, number = np.unique(direct["time"].values.astype("datetime64[D]"), return_inverse=True)
    hours = np.zeros((len(days), E.shape[1]))
    np.add.at(hours, number, (threshold <= E) * step)
    at = {k: c for k, c in direct.coords.items() if c.dims == ("sensor",)}
    out = xr.DataArray(hours, {"day": days.astype("datetime64[ns]"), **at}, ("day", "sensor"))
    out.name, out.attrs = "sunlight", {"units": "h", "long_name": "hours in direct sun"}
    return out
