"""Position of the sun in each interval of the weather file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import describe

if TYPE_CHECKING:
    from drcmitsuba.sky.weather import Site

EPOCH = np.datetime64("1970-01-01", "ns")
DELTA_T = 67.0
"""Terrestrial time minus universal time [s]."""
SEARCH_STEPS = 12
"""Pieces into which an interval near sunrise or sunset is cut: 5 min of an hour."""
FASTEST_RISE = 15.1
"""Upper bound of the speed at which the sun climbs or sinks [deg/h]: the earth turns by 15.04."""


def sun_position(time: np.ndarray, step: float, site: Site, sun_time: str = "middle") -> xr.Dataset:
    """Sun position of each interval, by NREL's solar position algorithm [1]_ in double precision.

    The sun is taken at the middle of the interval, and at sunrise and sunset at the middle of the
    part in which the centre of its disc is above the horizon. Where that part is in two pieces (a
    midnight sun that dips for some minutes), the longer one counts. An interval without any sun
    keeps its middle.

    Parameters
    ----------
    time : ndarray of datetime64, shape (time,)
        Start of each interval in local standard time, in any order.
    step : float
        Length of the intervals [h].
    site : Site
        Latitude [deg north], longitude [deg east], timezone [h east of UTC], elevation [m].
    sun_time : {"middle", "instant"}
        "instant": the stamp itself is the sun's time, as in sub-hourly WEA files.

    Returns
    -------
    xarray.Dataset
        On `time`: `solar_zenith` and `solar_azimuth` [deg, from north by east], `direction`
        (time, axis) unit vector x east, y north, z up, and `instant`, the time of that position.

    Raises
    ------
    InputError
        For a step that is not positive, a time that is not a date or that has a time zone, or an
        unknown `sun_time`.

    Notes
    -----
    The zenith is geometric: centre of the disc, no refraction. Radiance's is, too, so results
    compare; refraction, which lifts the sun by 0.5° at the horizon and 0.1° at 10°, depends on air
    that a typical year does not know. One sun serves efficacy, sky and shadows.
    A sun that is up for less than 1/12 of the interval may be missed. Where the sun's centre is
    below the horizon, `direction` points below it, too.

    References
    ----------
    .. [1] I. Reda, A. Andreas, "Solar position algorithm for solar radiation applications", Solar
       Energy 76(5), 2004; as implemented in pvlib.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> site = drcmitsuba.weather.default().site
    >>> sun = drcmitsuba.sky.sun_position(np.array(["2015-06-21T12"], "datetime64[ns]"), 1.0, site)
    >>> round(float(sun["solar_zenith"][0]), 1)
    12.8
    """
    stamps = np.atleast_1d(time)
    if stamps.dtype.kind == "O" and isinstance(pd.DatetimeIndex(stamps).dtype, pd.DatetimeTZDtype):
        got, remedy = "time stamps with a zone", "give local standard time without one"
        raise InputError("sun position", "time", got, remedy)
    time = stamps.astype("datetime64[ns]")
    if not 0 < step < np.inf:
        raise InputError("sun position", "step", f"{step} h", "give a length above 0 h")
    if np.isnat(time).any():
        raise InputError("sun position", "time", "a missing time stamp", "give a date everywhere")
    if sun_time == "instant":
        instant, (zenith, azimuth) = time, _spa(time, site)
    elif sun_time == "middle":
        instant, zenith, azimuth = _sunlit_middle(time, step, site)
    else:
        raise InputError("sun position", "sun_time", repr(sun_time), 'give "middle" or "instant"')

    position = xr.Dataset(
        {
            "solar_zenith": ("time", zenith),
            "solar_azimuth": ("time", azimuth),
            "direction": (("time", "axis"), direction(zenith, azimuth)),
            "instant": ("time", instant),
        },
        coords={"time": time, "axis": ["x", "y", "z"]},
    )
    return describe(position)


def direction(zenith: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vector x east, y north, z up, shape (..., 3), of angles [deg] from zenith and north."""
    zenith, azimuth = np.radians(zenith), np.radians(azimuth)
    return np.stack(
        [np.sin(zenith) * np.sin(azimuth), np.sin(zenith) * np.cos(azimuth), np.cos(zenith)],
        axis=-1,
    )


def direction_of_hour(
    latitude: float, declination: np.ndarray, hour_angle: np.ndarray
) -> np.ndarray:
    """Unit vector x east, y north, z up, shape (..., 3); the hour angle [deg] grows to the west."""
    phi, delta, h = (np.radians(angle) for angle in (latitude, declination, hour_angle))
    x = -np.cos(delta) * np.sin(h)
    y = np.cos(phi) * np.sin(delta) - np.sin(phi) * np.cos(delta) * np.cos(h)
    z = np.sin(phi) * np.sin(delta) + np.cos(phi) * np.cos(delta) * np.cos(h)
    return np.stack([x, y, z], axis=-1)


def declination_and_hour(latitude: float, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Declination and hour angle [deg] of directions (..., 3); inverts `direction_of_hour`."""
    phi = np.radians(latitude)
    x, y, z = np.moveaxis(directions, -1, 0)
    declination = np.arcsin(np.clip(np.sin(phi) * z + np.cos(phi) * y, -1, 1))
    return np.degrees(declination), np.degrees(np.arctan2(-x, np.cos(phi) * z - np.sin(phi) * y))


def _spa(instant: np.ndarray, site: Site) -> tuple[np.ndarray, np.ndarray]:
    """Zenith and azimuth [deg] at local standard times of any shape."""
    east_of_utc = np.timedelta64(round(site.timezone * 3600), "s")
    seconds = (instant.ravel() - east_of_utc - EPOCH) / np.timedelta64(1, "s")
    air = {"pressure": 1013.25, "temp": 12.0, "atmos_refract": 0.5667}  # zenith takes no refraction
    position = lazy.by_itself("pvlib", "spa").solar_position_numpy(
        seconds, site.latitude, site.longitude, site.elevation, delta_t=DELTA_T, numthreads=1, **air
    )
    _, zenith, _, _, azimuth, _ = (angle.reshape(instant.shape) for angle in position)
    return zenith, azimuth


def _sunlit_middle(
    time: np.ndarray, step: float, site: Site
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle of the longest part of each interval that has the sun above the horizon.

    The sun's zenith and azimuth [deg] at that time come with it.
    """
    length = round(step * 3600e9)
    middle = time + np.timedelta64(length // 2, "ns")
    zenith, azimuth = _spa(middle, site)
    # Only an interval whose middle is this close to the horizon can hold a sunrise or a sunset.
    near = np.flatnonzero(abs(90 - zenith) <= FASTEST_RISE * step / 2)
    if len(near) == 0:
        return middle, zenith, azimuth
    offsets = (length * np.arange(SEARCH_STEPS + 1) // SEARCH_STEPS).astype("timedelta64[ns]")
    altitude = 90 - _spa(time[near, None] + offsets, site)[0]
    begin, end = _sunlit_part(altitude)
    lit = end > begin
    centre = (begin + end)[lit] / 2 / SEARCH_STEPS * length
    moved = near[lit]
    middle[moved] = time[moved] + centre.astype("timedelta64[ns]")
    zenith[moved], azimuth[moved] = _spa(middle[moved], site)
    return middle, zenith, azimuth


def _sunlit_part(altitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Begin and end, in columns, of the longest run of positive altitudes in each row.

    Crossings are interpolated between columns; a row without sun gives an empty part, 0 to 0.
    """
    rows, columns = np.arange(len(altitude)), altitude.shape[1]
    run, longest, last = np.zeros((3, len(altitude)), dtype=int)
    for k in range(columns):
        run = np.where(altitude[:, k] > 0, run + 1, 0)
        longer = run > longest
        longest, last = np.where(longer, run, longest), np.where(longer, k, last)
    first = last - longest + 1

    def crossing(lit: np.ndarray, dark: np.ndarray) -> np.ndarray:
        dark = np.clip(dark, 0, columns - 1)
        up, down = altitude[rows, lit], altitude[rows, dark]
        return lit + (dark - lit) * up / np.where(lit == dark, 1, up - down)

    any_sun = longest > 0
    first, last = np.where(any_sun, first, 0), np.where(any_sun, last, 0)
    begin, end = crossing(first, first - 1), crossing(last, last + 1)
    return np.where(any_sun, begin, 0), np.where(any_sun, end, 0)
