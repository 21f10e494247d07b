"""Record of a weather file: its site and its irradiance, checked value by value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import describe
from drcmitsuba.sky.weather.text import DAYS, NumberedRows, decimals, number

NOMINAL_YEAR = 2015
"""Typical years are patched together from many; 2015 (1 January: Thursday) stands for all."""
START = np.datetime64(f"{NOMINAL_YEAR}-01-01T00:00")
MONTH_STARTS = np.cumsum(DAYS) - DAYS - (np.arange(13) > 2)
"""Day of the nominal year on which each month begins, from 0; January at 1."""
ABSENT = {"", "na", "n/a", "nan", "none", "null"}
"""Texts that stand for no number, in small letters."""
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

    @property
    def notes(self) -> tuple[str, ...]:
        """Note where longitude and time zone do not belong together."""
        # A longitude of the wrong sign is the classic mistake; no real clock is 4 h off its sun.
        if abs((self.timezone - self.longitude / 15 + 12) % 24 - 12) <= 4:
            return ()
        return (
            f"longitude {self.longitude:g}° east and time zone {self.timezone:+g} h do not fit: "
            "check their signs",
        )


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


def days_of_year(table: NumberedRows) -> np.ndarray:
    """Day of the nominal year of every row, from 0."""
    return MONTH_STARTS[table.month] + table.day - 1


def stamp(time: np.datetime64) -> str:
    """Month, day, hour and minute of a time."""
    return str(np.datetime_as_string(time, unit="m"))[5:].replace("T", " ")


def nominal_year(minutes: np.ndarray, table: NumberedRows) -> np.ndarray:
    """Starts of the hours, given in minutes of the nominal year, which they must fill."""
    # The last hour of a TMY3 may be labelled 1 January 0:00.
    start = START + (minutes % (365 * 24 * 60)).astype("timedelta64[m]")
    whole = np.arange(START, START + np.timedelta64(365, "D"), np.timedelta64(1, "h"))
    remedy = "give all 8760 (leap year: 8784) hours of a year, in order"
    both = min(len(start), len(whole))
    wrong = start[:both] != whole[:both]
    if wrong.any():
        row = int(np.argmax(wrong))
        got = f"hour from {stamp(start[row])} where {stamp(whole[row])} is due"
        raise InputError(table.path, f"line {table.numbers[row]}", got, remedy)
    if len(start) != len(whole):
        got = f"{len(start)} hours, last {stamp(start[-1])}"
        raise InputError(table.path, "rows", got, remedy)
    return start.astype("datetime64[ns]")


def hourly(
    site: Site,
    minutes: np.ndarray,
    irradiance: Mapping[str, Sequence[str]],
    dew_point: np.ndarray,
    table: NumberedRows,
) -> Weather:
    """Make the weather of a file with an hour a row, which starts at `minutes` of the year."""
    time = nominal_year(minutes, table)
    return weather_of(site, 1.0, time, irradiance, dew_point, "middle", table)


def weather_of(
    site: Site,
    step: float,
    time: np.ndarray,
    irradiance: Mapping[str, Sequence[str]],
    dew_point: np.ndarray | None,
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
        columns["dew_point"] = dew_point
        gaps = np.count_nonzero(np.isnan(columns["dew_point"]))
        notes += [f"no dew point in {gaps} of {len(time)} rows"] if gaps else []
    notes += site.notes
    if not (columns["dni"].any() or columns["dhi"].any()):
        notes.append("no irradiance in any row")
    data = xr.Dataset(
        {name: ("time", values) for name, values in columns.items()},
        coords={"time": time},
        attrs={"sun_time": sun_time},
    )
    describe(data)
    return Weather(str(table.path), site, step, data, tuple(notes))


def irradiance_of(name: str, column: Sequence[str], table: NumberedRows) -> np.ndarray:
    """Irradiance [W/m²] of a column; an unfit value raises InputError with its line."""
    value = decimals(column)
    missing = (value >= 9999) | np.isin(value, (-999, -9900, -9999))
    if name == "ghi":  # nothing needs it; what is there tells whether the others agree
        value = np.where(missing, np.nan, value)
        return np.where((value >= 0) & (value <= HIGHEST[name]), value, np.nan)
    for bad, what, remedy in (
        (~np.isfinite(value), "not a number", f"write {name} in W/m²"),
        (missing, "the code for missing", "fill the gaps or use another file"),
        (value < 0, "negative", f"{name} is 0 W/m² or more"),
        (value > HIGHEST[name], "implausible", f"{name} is at most {HIGHEST[name]:g} W/m²"),
    ):
        table.refuse(name, column, bad, what, remedy)
    return value


def dew_point_of(column: Sequence[str], table: NumberedRows, per_degree: int = 1) -> np.ndarray:
    """Dew point [°C] of a column in units of which a degree has so many, NaN where missing.

    A missing one is 99.9 in EPW, -9900 in TMY3, 999.9 in TMY2.
    """
    value = decimals(column) / per_degree
    absent = [text.strip().lower() in ABSENT for text in column]
    table.refuse(
        "dew point", column, np.isnan(value) & ~np.array(absent), "not a number", "write it in °C"
    )
    return np.where(np.abs(value) < 90, value, np.nan)


def site_of(path: Path, name: str, *numbers: str | float) -> Site:
    """Site of a head line's fields: name, latitude, longitude, time zone and elevation."""
    values = (
        number(path, field, got, low, high)
        for got, (field, (low, high)) in zip(numbers, SITE_LIMITS.items(), strict=True)
    )
    return Site(" ".join(name.split()), *values)
