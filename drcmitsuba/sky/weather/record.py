"""Record of a weather file: its site and its irradiance, checked value by value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import describe
from drcmitsuba.sky.weather.text import NumberedRows, number

NOMINAL_YEAR = 2015
"""Typical years are patched together from many; 2015 (1 January: Thursday) stands for all."""
HIGHEST = {"dni": 1500.0, "dhi": 1500.0, "ghi": 2000.0}  # W/m², cloud enhancement included
COLUMNS = (*HIGHEST, "dew_point")
SITE_LIMITS = {
    "latitude": (-90, 90), "longitude": (-180, 180), "time zone": (-12, 14),
    "elevation": (-500, 9000),
}  # fmt: skip


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


def nominal_year(
    index: pd.DatetimeIndex, lag: pd.Timedelta, table: NumberedRows
) -> pd.DatetimeIndex:
    """Starts of the hours in the nominal year, which they must fill; `lag` from start to label."""
    labels = pd.DatetimeIndex([t.replace(year=NOMINAL_YEAR) for t in index.tz_localize(None)])
    start = (labels - lag).as_unit("ns")
    # The last hour of a TMY3 is labelled 1 January 0:00.
    start = start.where(start.year == NOMINAL_YEAR, start + pd.Timedelta("365D"))
    whole = pd.date_range(f"{NOMINAL_YEAR}-01-01", periods=8760, freq="h", unit="ns")
    remedy = "give all 8760 (leap year: 8784) hours of a year, in order"
    both = min(len(start), len(whole))
    wrong = start[:both] != whole[:both]
    if wrong.any():
        row = int(np.argmax(wrong))
        got = f"hour from {start[row]:%m-%d %H:%M} where {whole[row]:%m-%d %H:%M} is due"
        raise InputError(table.path, f"line {table.numbers[row]}", got, remedy)
    if len(start) != len(whole):
        got = f"{len(start)} hours, last {start[-1]:%m-%d %H:%M}"
        raise InputError(table.path, "rows", got, remedy)
    return start


def hourly(site: Site, frame: pd.DataFrame, lag: pd.Timedelta, table: NumberedRows) -> Weather:
    """Make the weather of a file with an hour a row; `lag` is from an hour's start to its label."""
    time = nominal_year(frame.index, lag, table)
    return weather_of(site, 1.0, time, frame[list(HIGHEST)], frame["temp_dew"], "middle", table)


def weather_of(
    site: Site,
    step: float,
    time: pd.DatetimeIndex,
    irradiance: Mapping[str, pd.Series],
    dew_point: pd.Series | None,
    sun_time: str,
    table: NumberedRows,
) -> Weather:
    """Make the weather of checked columns, with notes on what is missing or odd."""
    absent = np.full(len(time), np.nan)
    columns = dict.fromkeys(COLUMNS, absent)
    columns |= {name: irradiance_of(name, irradiance[name], table) for name in irradiance}
    notes = []
    if table.leap_rows:
        notes.append(f"29 February dropped ({table.leap_rows} rows): the year has 365 days")
    if dew_point is not None:
        columns["dew_point"] = dew_point_of(dew_point, table)
        gaps = np.count_nonzero(np.isnan(columns["dew_point"]))
        notes += [f"no dew point in {gaps} of {len(time)} rows"] if gaps else []
    # A longitude of the wrong sign is the classic mistake; no real clock is 4 hours off its sun.
    if abs((site.timezone - site.longitude / 15 + 12) % 24 - 12) > 4:
        notes.append(
            f"longitude {site.longitude:g}° east and time zone {site.timezone:+g} h do not fit: "
            "check their signs"
        )
    if not (columns["dni"].any() or columns["dhi"].any()):
        notes.append("no irradiance in any row")
    data = xr.Dataset(
        {name: ("time", values) for name, values in columns.items()},
        coords={"time": time},
        attrs={"sun_time": sun_time},
    )
    describe(data)
    return Weather(str(table.path), site, step, data, tuple(notes))


def irradiance_of(name: str, column: pd.Series, table: NumberedRows) -> np.ndarray:
    """Irradiance [W/m²] of a column; an unfit value raises InputError with its line."""
    value = pd.to_numeric(column, errors="coerce").to_numpy(float)
    missing = (value >= 9999) | np.isin(value, (-999, -9900, -9999))
    for bad, what, remedy in (
        (~np.isfinite(value), "not a number", f"write {name} in W/m²"),
        (missing, "the code for missing", "fill the gaps or use another file"),
        (value < 0, "negative", f"{name} is 0 W/m² or more"),
        (value > HIGHEST[name], "implausible", f"{name} is at most {HIGHEST[name]:g} W/m²"),
    ):
        table.refuse(name, column, bad, what, remedy)
    return value


def dew_point_of(column: pd.Series, table: NumberedRows) -> np.ndarray:
    """Dew point [°C], NaN where missing: 99.9 in EPW, -9900 in TMY3, 999.9 in TMY2."""
    value = pd.to_numeric(column, errors="coerce").to_numpy(float)
    text = np.isnan(value) & column.notna().to_numpy()
    table.refuse("dew point", column, text, "not a number", "write it in °C")
    return np.where(np.abs(value) < 90, value, np.nan)


def site_of(path: Path, name: str, *numbers: str | float) -> Site:
    """Site of a head line's fields: name, latitude, longitude, time zone and elevation."""
    values = (
        number(path, field, got, low, high)
        for got, (field, (low, high)) in zip(numbers, SITE_LIMITS.items(), strict=True)
    )
    return Site(" ".join(name.split()), *values)
