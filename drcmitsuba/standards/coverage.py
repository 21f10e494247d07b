"""Whether an evaluation covers the hours that a standard counts, and has close enough points."""

from __future__ import annotations

import calendar

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.metrics import daylight_hours
from drcmitsuba.metrics.sensor_areas import spacings
from drcmitsuba.metrics.thresholds import hour_of_day
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.standards.standard import Standard

FIRST, LAST = 8, 18
"""Clock hours of LM-83, [first, last)."""
WORKING, YEAR = 3650.0, 8760.0
"""Hours of a year from 8 to 18 h, and of a whole year [h]."""
BY_DAY = 'evaluate with calendar = "LM-83" in [period], all months, by weather of these hours'
BY_YEAR = (
    'evaluate a whole year, calendar = "LM-83" and hours = [0, 24] in [period], by weather of all '
    "hours"
)
"""Remedies where hours lack."""
MARGIN = 1.001
"""Factor by which a spacing may exceed its limit: coordinates are rounded."""
UP = 0.999
"""Least vertical part of the normal of a point that faces up."""
MOMENTS = (9, 15)
"""Hours of LEED's option 2, in standard time, at which the intervals begin."""
EQUINOXES = ((3, 21), (9, 21))
"""Month and day of the equinoxes."""
NEAR = 15
"""Days about an equinox among which the clearest one is looked for."""


def hours_of(
    standard: Standard, times: xr.Dataset, step_hours: float, source: object, sky: xr.Dataset | None
) -> np.ndarray:
    """Time stamps that a standard counts, as indices, int, shape (counted,).

    Parameters
    ----------
    standard : Standard
    times : xr.Dataset
        Any arrays with the time stamps of the evaluation, `time` and `clock`.
    step_hours : float
        Length of the interval that one time stamp stands for [h].
    source : object
        File, folder or case, for error messages.
    sky : xr.Dataset, optional
        Luminances, which tell the daylight hours [cd/m²].

    Raises
    ------
    InputError
        The evaluation does not cover these hours, or there is no sky to tell them.
    """
    stamps = times.sizes["time"]
    if standard.hours == "equinox":
        return clearest_hours(_known(sky, source), step_hours, source).ravel()
    if standard.hours == "8 to 18":
        hour = hour_of_day(times, step_hours)
        kept = np.flatnonzero((hour >= FIRST) & (hour < LAST))
        if abs(len(kept) * step_hours - WORKING) > 1e-6 * WORKING:
            got = f"{len(kept) * step_hours:g} of {WORKING:g} h from 8 to 18 h"
            raise InputError(source, "period", got, BY_DAY)
        return kept
    if abs(stamps * step_hours - YEAR) > 1e-6 * YEAR:
        got = f"{stamps * step_hours:g} of {YEAR:g} h"
        raise InputError(source, "period", got, BY_YEAR)
    if standard.hours == "year":
        return np.arange(stamps)
    E = diffuse_horizontal(_known(sky, source))
    return np.flatnonzero(daylight_hours(E, step_hours=step_hours).values)


def _known(sky: xr.Dataset | None, source: object) -> xr.Dataset:
    if sky is None:
        got = "no sky.zarr, which tells the daylight hours"
        raise InputError(source, "sky", got, "keep it, or evaluate the case again")
    return sky


def clearest_hours(sky: xr.Dataset, step_hours: float, source: object) -> np.ndarray:
    """Time stamps of the clearest skies near the equinoxes, indices, int, shape (moment, equinox).

    It is the one with the most luminous sun among those of the days at most `NEAR` from the
    equinox, for each moment by itself: the most direct normal light.

    Parameters
    ----------
    sky : xr.Dataset
        Luminances with `time`, in standard time, and `sun` [cd/m²].
    step_hours : float
        Length of the interval of a time stamp [h].
    source : object
        File, folder or case, for error messages.

    Raises
    ------
    InputError
        One of these days is missing.
    """
    time = sky["time"].values
    day = time.astype("datetime64[D]")
    hour = (time - day) / np.timedelta64(1, "h")
    out = np.empty((len(MOMENTS), len(EQUINOXES)), np.int64)
    for i, moment in enumerate(MOMENTS):
        for k, (month, date) in enumerate(EQUINOXES):
            equinox = time[0].astype("datetime64[Y]").astype("datetime64[M]")
            equinox = (equinox + np.timedelta64(month - 1, "M")).astype("datetime64[D]")
            equinox += np.timedelta64(date - 1, "D")
            near = np.abs(day - equinox) <= np.timedelta64(NEAR, "D")
            here = np.flatnonzero(near & (hour >= moment) & (hour < moment + step_hours))
            if len(here) != 2 * NEAR + 1:
                got = (
                    f"{len(here)} of {2 * NEAR + 1} days near {date} {_month(month)} at {moment} h"
                )
                raise InputError(source, "period", got, BY_DAY)
            out[i, k] = here[np.argmax(sky["sun"].values[here])]
    return out


def clearest_days(times: xr.Dataset) -> str:
    """Sentence on the days that `clearest_hours` chose, from arrays with these time stamps."""
    days = times["time"].dt.day.values, times["time"].dt.month.values
    words = [f"{date} {_month(month)}" for date, month in zip(*days, strict=True)]
    count = len(EQUINOXES)
    parts = [
        f"{moment} h of {' and '.join(words[i * count : (i + 1) * count])}"
        for i, moment in enumerate(MOMENTS)
    ]
    return (
        f"{', '.join(parts)}: the clearest days within {NEAR} days of 21 March and 21 September, "
        "by the direct light at the hour"
    )


def _month(number: int) -> str:
    return calendar.month_name[number]


def diffuse_horizontal(sky: xr.Dataset) -> xr.DataArray:
    """Diffuse horizontal illuminance of a sky, Σ L ∫cos θ dΩ of its patches (time,) [lx]."""
    known = [p for p in map(Patches, range(1, 7)) if len(p) == sky.sizes["bin"]]
    if not known:
        got = f"{sky.sizes['bin']} bins of the sky"
        raise InputError("sky", "bin", got, "give a Reinhart sky with its ground")
    weights = known[0].projected_solid_angles.copy()
    weights[0] = 0  # the ground
    values = sky["sky"].transpose("time", "bin").values @ weights.astype(sky["sky"].dtype)
    return xr.DataArray(values, {"time": sky["time"]}, ("time",), attrs={"units": "lx"})


def check_spacing(standard: Standard, illuminance: xr.Dataset, source: object) -> None:
    """Refuse grids that are coarser than a standard allows.

    Raises
    ------
    InputError
        The points of a grid lie further apart, or in a line.
    """
    most = standard.largest_spacing
    if most is None:
        return
    coarse = {n: s for n, s in spacings(illuminance).items() if s > most * MARGIN}
    if coarse:
        name, spacing = max(coarse.items(), key=lambda item: item[1])
        grid = f" of grid {name!r}" if name else ""
        got = f"{spacing:.3g} m between points{grid}" if spacing < np.inf else f"a line{grid}"
        if len(coarse) > 1:
            got += f" ({len(coarse)} grids are too coarse)"
        raise InputError(source, "sensors", got, f"give at most {most:g} m; no verdict")


def check_facing(illuminance: xr.Dataset, source: object) -> None:
    """Refuse points that do not face up: standards count horizontal illuminance.

    Raises
    ------
    InputError
        A point faces elsewhere.
    """
    if "nz" in illuminance.coords:
        other = int((illuminance["nz"].values < UP).sum())
        if other:
            got = f"{other} of {illuminance.sizes['sensor']} points do not face up"
            raise InputError(source, "sensors", got, "evaluate a case with horizontal points only")
