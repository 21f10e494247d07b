"""Weather that controls see, at the time stamps of an evaluation."""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.schema import describe
from drcmitsuba.sky.daylight import Daylight, weather_of


def outside(case: Case, daylight: Daylight) -> xr.Dataset:
    """Irradiance and sun at the time stamps of a case.

    Parameters
    ----------
    case : Case
    daylight : Daylight
        From `sky.daylight.daylight` of the same case.

    Returns
    -------
    xr.Dataset
        `dni`, `dhi`, `ghi` = DHI + DNI cos Z (time,) [W/m²], 0 where a case has no weather;
        `sun_direction` (time, axis), unit vectors: x east, y north, z up.
    """
    data = weather_of(case).data
    time = daylight.sky["time"].values
    rows = np.searchsorted(data["time"].values, time, side="right") - 1
    nothing = np.zeros(len(time))
    dni, dhi = (
        np.nan_to_num(data[name].values[rows]) if name in data else nothing
        for name in ("dni", "dhi")
    )
    sun = daylight.sun["direction"].transpose("time", "axis").values
    ghi = dhi + dni * np.maximum(sun[:, 2], 0)
    irradiance = {name: ("time", v) for name, v in (("dni", dni), ("dhi", dhi), ("ghi", ghi))}
    return describe(
        xr.Dataset({**irradiance, "sun_direction": (("time", "axis"), sun)}, {"time": time})
    )
