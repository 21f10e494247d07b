"""Records of a weather file: its site and its irradiance."""

from __future__ import annotations

from dataclasses import dataclass

import xarray as xr

NOMINAL_YEAR = 2015
"""Typical years are patched together from many; 2015 (1 January: Thursday) stands for all."""


@dataclass(frozen=True)
class Site:
    """Place at which the weather was observed."""

    name: str
    latitude: float
    """Degrees north."""
    longitude: float
    """Degrees east."""
    timezone: float
    """Hours east of UTC, standard time; fractions of an hour are possible."""
    elevation: float
    """Metres above sea level."""


@dataclass(frozen=True)
class Weather:
    """Irradiance at a site."""

    source: str
    """Weather file."""
    site: Site
    step: float
    """Length of an interval [h]."""
    data: xr.Dataset
    """dim `time` (datetime64, local standard time, start of the interval, year 2015); `dni`, `dhi`,
    `ghi` [W/m²] and `dew_point` [°C], float64, NaN where the file has no such column.
    `attrs["sun_time"]` is "middle" or, where a stamp is the sun's instant, "instant"."""
    notes: tuple[str, ...]
    """Remarks for the user: rows that were left out, values that look odd."""
