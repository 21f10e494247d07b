"""Daylight provision of EN 17037: its daylight hours, and the illuminance that a room provides.

References
----------
.. [1] EN 17037:2018, "Daylight in buildings", calculation method 2.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from drcmitsuba.metrics import thresholds
from drcmitsuba.metrics.autonomy import autonomy_stamps
from drcmitsuba.metrics.point_autonomy import by_sensor
from drcmitsuba.runtime.errors import InputError

DAYLIGHT_HOURS = 4380.0
"""Half of the hours of a year [h]."""


def daylight_hours(
    diffuse: xr.DataArray, hours: float = DAYLIGHT_HOURS, step_hours: float = 1.0
) -> xr.DataArray:
    """Daylight hours, those of the year with the highest diffuse horizontal illuminance [1].

    Parameters
    ----------
    diffuse : DataArray (time,)
        Diffuse horizontal illuminance of a whole year [lx].
    hours : float
        Number of daylight hours [h].
    step_hours : float
        Length of the interval that one time stamp stands for [h].

    Returns
    -------
    DataArray (time,), bool
        True in `hours`; of hours with equal light, the earlier ones.

    Raises
    ------
    InputError
        Another dim, values that are not finite, fewer time stamps than `hours`.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> diffuse = xr.DataArray([0.0, 5e3, 9e3, 2e3], dims="time")
    >>> drcmitsuba.metrics.daylight_hours(diffuse, hours=2).values
    array([False,  True,  True, False])
    """
    if not isinstance(diffuse, xr.DataArray):
        raise InputError("diffuse", "type", type(diffuse).__name__, "give an xarray DataArray")
    values = diffuse.values
    if diffuse.dims != ("time",) or not np.isfinite(values).all():
        got = f"dims {', '.join(map(str, diffuse.dims)) or 'none'}, or values that are not finite"
        raise InputError("diffuse", "time", got, "give a finite illuminance for each time stamp")
    step = thresholds.exact(thresholds.not_negative("step_hours", step_hours))
    asked = thresholds.exact(thresholds.not_negative("hours", hours))
    if step == 0 or len(values) * step < asked:
        got = f"{len(values)} time stamps of {step_hours:g} h"
        raise InputError("diffuse", "time", got, f"give a whole year, at least {hours:g} h")
    chosen = np.zeros(len(values), bool)
    chosen[np.argsort(-values, kind="stable")[: math.ceil(asked / step)]] = True
    out = diffuse.copy(data=chosen)
    out.name, out.attrs = "daylight_hours", {"long_name": "daylight hours of EN 17037"}
    return out


def median_illuminance(illuminance: xr.DataArray, fraction: float = 0.5) -> xr.DataArray:
    """Illuminance that a point reaches in a fraction of the time stamps, by default in half.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance at the daylight hours [lx].
    fraction : float
        τ, fraction of the time stamps, above 0 to 1.

    Returns
    -------
    DataArray (sensor,)
        The ⌈τ·t⌉-th highest illuminance [lx]: it is E₀ or more where the point reaches E₀ in at
        least the fraction τ of the time stamps.

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, a fraction out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.median_illuminance(E).values
    array([300., 600.])
    """
    E = thresholds.checked(illuminance, "illuminance")
    rank = autonomy_stamps(fraction, len(E))
    if rank == 0:
        raise InputError("metrics", "fraction", f"{fraction}", "give a fraction above 0")
    values = np.partition(E, len(E) - rank, axis=0)[len(E) - rank]
    return by_sensor(illuminance, values, "median", "illuminance that is reached", "lx")


def provision(illuminance: xr.DataArray, area: float = 0.5, fraction: float = 0.5) -> float:
    """Illuminance that a share of the points reaches in a fraction of the time stamps [1].

    EN 17037 asks of `provision(E, 0.5)` 300, 500 or 750 lx and of `provision(E, 0.95)` 100, 300 or
    500 lx, for its levels minimum, medium and high.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance of one room at the daylight hours [lx], as `daylight_hours` selects them.
    area : float
        Share of the points that has to reach it, above 0 to 1.
    fraction : float
        Fraction of the time stamps in which it has to be reached, above 0 to 1.

    Returns
    -------
    float
        Illuminance [lx]: E₀ or more where ⌈area·N⌉ points reach E₀ in ⌈fraction·t⌉ time stamps.

    Raises
    ------
    InputError
        As `median_illuminance`; an area out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.provision(E)
    600.0
    """
    values = np.sort(median_illuminance(illuminance, fraction).values)
    points = math.ceil(thresholds.exact_fraction("area", area) * len(values))
    if points == 0:
        raise InputError("metrics", "area", f"{area}", "give a share above 0")
    return float(values[len(values) - points])
