"""Weather that controls see."""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.schema import describe
from drcmitsuba.sky import sun_position
from drcmitsuba.sky.daylight import Daylight, weather_of


def outside(case: Case, daylight: Daylight | None = None) -> xr.Dataset:
    """Irradiance and sun at the time stamps of a case, or in a whole year.

    Parameters
    ----------
    case : Case
    daylight : Daylight, optional
        From `sky.daylight.daylight` of the same case, for its time stamps; by default all intervals
        of the weather file.

    Returns
    -------
    xr.Dataset
        `dni`, `dhi`, `ghi` = DHI + DNI cos Z (time,) [W/m²], 0 where a case has no weather;
        `sun_direction` (time, axis), unit vectors: x east, y north, z up.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> weather = controls.outside(drcmitsuba.load_case("corner_office.toml"))
    >>> weather.sizes["time"]
    8760
    """
    weather = weather_of(case)
    data = weather.data
    if daylight is None:
        time = data["time"].values
        when = str(data.attrs.get("sun_time", "middle"))
        sun = sun_position(time, weather.step, weather.site, when)
    else:
        time, sun = daylight.sky["time"].values, daylight.sun
    rows = np.searchsorted(data["time"].values, time, side="right") - 1
    nothing = np.zeros(len(time))
    dni, dhi = (
        np.nan_to_num(data[name].values[rows]) if name in data else nothing
        for name in ("dni", "dhi")
    )
    direction = sun["direction"].transpose("time", "axis").values
    ghi = dhi + dni * np.maximum(direction[:, 2], 0)
    irradiance = {name: ("time", v) for name, v in (("dni", dni), ("dhi", dhi), ("ghi", ghi))}
    at = {**irradiance, "sun_direction": (("time", "axis"), direction)}
    return describe(xr.Dataset(at, {"time": time}))
