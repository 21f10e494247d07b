"""Weather files → irradiance per interval: EPW, TMY3, TMY2 and Radiance's WEA.

Every reader ends in the same clock: local standard time, start of the interval, nominal year 2015.
A file is text that somebody else wrote: bounded, decoded, its rows counted, its numbers checked.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from operator import itemgetter
from pathlib import Path

import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.weather import record, text
from drcmitsuba.sky.weather.record import Weather
from drcmitsuba.sky.weather.text import NumberedRows

ORDER = ("ghi", "dni", "dhi")
TMY3_COLUMNS = (
    "Date (MM/DD/YYYY)", "Time (HH:MM)", "GHI (W/m^2)", "DNI (W/m^2)", "DHI (W/m^2)",
    "Dew-point (C)",
)  # fmt: skip
TMY2_COLUMNS = ((3, 5), (5, 7), (7, 9), (17, 21), (23, 27), (29, 33), (73, 77))
"""Begin and end of month, day, hour, ghi, dni, dhi and dew point [0.1 °C] in a row."""
TMY2_HEAD = re.compile(
    r"(\d+)\s+(\S.*?)\s+([A-Z]{2})\s+(-?\d+)\s+([NS])\s*(\d+)\s+(\d+)\s+([EW])\s*(\d+)\s+(\d+)"
    r"\s+(-?\d+)",
    re.ASCII,
)
WEA_UNITS = "weather_data_file_units"
WEA_HEAD = ["place", "latitude", "longitude", "time_zone", "site_elevation", WEA_UNITS]


def _read_epw(path: Path, lines: list[str]) -> Weather:
    head = text.quoted(path, lines[0])
    tags = [line[:12].upper() for line in lines[:40]]
    if head[0].upper() != "LOCATION" or len(head) < 10 or "DATA PERIODS" not in tags:
        remedy = "an EPW starts with LOCATION and 9 more fields and has a line DATA PERIODS"
        raise InputError(path, "header", text.show(lines[0]), remedy)
    first = tags.index("DATA PERIODS") + 1
    if [field.strip() for field in lines[first - 1].split(",")[1:3]] != ["1", "1"]:
        remedy = "give one data period of hourly records; finer ones are read from a WEA"
        raise InputError(path, f"line {first}", text.show(lines[first - 1]), remedy)
    site = record.site_of(path, head[1], *head[6:10])
    pick = itemgetter(1, 2, 3, 13, 14, 15, 7)
    table = text.rows_of(path, lines, first, text.fields, pick, least=16)
    _, _, hour, *irradiance, dew_point = table.columns
    minutes = 60 * (24 * record.days_of_year(table) + text.integers(hour) - 1)
    dew = record.dew_point_of(dew_point, table)
    return record.hourly(site, minutes, dict(zip(ORDER, irradiance, strict=True)), dew, table)


def _read_tmy3(path: Path, lines: list[str]) -> Weather:
    head = text.quoted(path, lines[0])
    names = [name.strip() for name in text.fields(lines[1])] if len(lines) > 1 else []
    lacking = sorted(set(TMY3_COLUMNS) - set(names))
    if len(head) < 7 or lacking:
        got = f"no column {lacking[0]!r}" if lacking else text.show(lines[0])
        raise InputError(path, "header", got, "a .csv must be a TMY3 file with its two head lines")
    date, clock, *others = (names.index(name) for name in TMY3_COLUMNS)

    def pick(fields: Sequence[str]) -> tuple[str, ...]:
        month, day, _ = (*fields[date].split("/", 2), "", "")[:3]
        hour, _, minute = fields[clock].strip().partition(":")
        whole = "24" if hour in ("0", "00") else hour
        return month, day, whole, hour, minute, *(fields[column] for column in others)

    site = record.site_of(path, head[1], head[4], head[5], head[3], head[6])
    table = text.rows_of(path, lines, 2, text.fields, pick, least=len(names))
    _, _, _, hour, minute, *irradiance, dew_point = table.columns
    ends = 60 * (24 * record.days_of_year(table) + text.integers(hour)) + text.integers(minute)
    dew = record.dew_point_of(dew_point, table)
    return record.hourly(site, ends - 60, dict(zip(ORDER, irradiance, strict=True)), dew, table)


def _read_tmy2(path: Path, lines: list[str]) -> Weather:
    head = TMY2_HEAD.fullmatch(lines[0][:200].strip())
    if head is None:
        raise InputError(path, "line 1", text.show(lines[0]), "give a TMY2 file with its head line")
    _, name, _, zone, north, lat, lat_minute, east, lon, lon_minute, metres = head.groups()
    latitude = (1 if north == "N" else -1) * (int(lat) + int(lat_minute) / 60)
    longitude = (1 if east == "E" else -1) * (int(lon) + int(lon_minute) / 60)
    site = record.site_of(path, name, latitude, longitude, zone, metres)
    table = text.rows_of(path, lines, 1, str, _pick_tmy2, 142)
    _, _, hour, *irradiance, dew_point = table.columns
    minutes = 60 * (24 * record.days_of_year(table) + text.integers(hour) - 1)
    dew = record.dew_point_of(dew_point, table, per_degree=10)
    return record.hourly(site, minutes, dict(zip(ORDER, irradiance, strict=True)), dew, table)


def _pick_tmy2(row: Sequence[str]) -> tuple[str, ...]:
    """Fields of fixed columns."""
    return tuple(str(row[start:end]) for start, end in TMY2_COLUMNS)


def _read_wea(path: Path, lines: list[str]) -> Weather:
    first = next((i for i, line in enumerate(lines) if line.strip()[:1].isdigit()), len(lines))
    head: dict[str, str] = {}
    for line in filter(None, (line.strip() for line in lines[:first])):
        key, *value = line.split(None, 1)
        head[key] = "".join(value)
    if set(head) != set(WEA_HEAD):
        remedy = f"start with the lines {', '.join(WEA_HEAD)}"
        raise InputError(path, "header", text.show(", ".join(head)), remedy)
    if head[WEA_UNITS] != "1":
        got = text.show(head[WEA_UNITS])
        raise InputError(path, WEA_UNITS, got, "use 1 (dni and dhi in W/m²)")
    west = text.number(path, "longitude (degrees west)", head["longitude"], -180, 180)
    zone = text.number(path, "time_zone (degrees west)", head["time_zone"], -210, 180)
    elevation = head["site_elevation"]
    site = record.site_of(path, head["place"], head["latitude"], 0 - west, 0 - zone / 15, elevation)
    table = text.rows_of(path, lines, first, str.split, lambda w: (*w[:2], "1", *w[2:5]), least=5)
    _, _, _, hour, dni, dhi = table.columns
    time, step, sun_time = _wea_time(hour, table)
    return record.weather_of(site, step, time, {"dni": dni, "dhi": dhi}, None, sun_time, table)


def _wea_time(hour: Sequence[str], table: NumberedRows) -> tuple[np.ndarray, float, str]:
    """Starts of the intervals, step [h] and what a stamp is: the middle or the sun's instant.

    Stamps more than an hour apart that do not fill their days are single hours, or moments of one
    hour's weight.
    """
    hours = text.decimals(hour)
    hours = np.where((hours >= 0) & (hours < 24), hours, np.nan)
    minutes = np.round(hours * 60)
    # Two or three decimals: 0.17 h and 0.167 h are both ten minutes.
    off = ~((np.abs(hours * 60 - minutes) < 0.31) & (minutes < 24 * 60))
    remedy = "use 0 to 24, exclusive, and whole minutes"
    table.refuse("hour", hour, off, "no time of day", remedy)
    days = record.days_of_year(table)
    at = days * 24 * 60 + minutes.astype(int)
    gaps, same_day = np.diff(at), np.diff(days) == 0
    step = int(gaps[same_day].min()) if same_day.any() else 60
    if step > 60 and len(at) * step < 24 * 60 * len(np.unique(days)):
        step = 60
    stamps = record.START + at.astype("timedelta64[m]")
    hours_alone = step == 60 and (at % 60 == at[:1] % 60).all()
    wrong = (gaps <= 0) | (same_day & (gaps != step) & (not hours_alone))
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        got = f"{record.stamp(stamps[row])} after {record.stamp(stamps[row - 1])}"
        remedy = f"stamps must rise, within a day by one step (here {step} min)"
        raise InputError(table.path, f"line {table.numbers[row]}", got, remedy)
    hourly = step == 60 and (at % 60 == 30).all()
    starts = (stamps - np.timedelta64(30, "m") if hourly else stamps).astype("datetime64[ns]")
    return starts, step / 60, "middle" if hourly else "instant"


Reader = Callable[[Path, list[str]], Weather]
"""Function that parses the lines of a file."""

READERS: dict[str, Reader] = {
    ".epw": _read_epw,
    ".csv": _read_tmy3,
    ".tm2": _read_tmy2,
    ".wea": _read_wea,
}


def read(path: str | Path) -> Weather:
    """Read a weather file in the format of its suffix.

    Parameters
    ----------
    path : str or Path
        `.epw` (EnergyPlus, hourly), `.csv` (TMY3), `.tm2` (TMY2) or `.wea` (Radiance, any step).

    Returns
    -------
    Weather

    Raises
    ------
    InputError
        For a file that is missing, too large, damaged, incomplete or implausible: one line with
        the file, the line, what came and what to do. Nothing is repaired or filled.

    Notes
    -----
    EPW, TMY2 and TMY3 must hold every hour of a year, in order. A WEA may hold any part of it, as
    long as its stamps increase by one step within a day. An hourly WEA labels an hour by its
    middle (x.5); any other WEA stamp is the sun's instant and starts its interval.
    29 February is dropped, with a note: the nominal year has 365 days.

    Examples
    --------
    >>> import drcmitsuba
    >>> weather = drcmitsuba.weather.read("my_weather.epw")
    >>> sorted(weather.data.data_vars)
    ['dew_point', 'dhi', 'dni', 'ghi']
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(path, "suffix", repr(path.suffix), f"use one of {', '.join(READERS)}")
    weather = _parsed(reader, path, text.read_text(path))
    return replace(weather, data=weather.data.copy(deep=True))


@lru_cache(maxsize=2)
def _parsed(reader: Reader, path: Path, content: str) -> Weather:
    """Weather of a file's text, parsed once for all pictures and states of a case."""
    return reader(path, content.split("\n"))


def default() -> Weather:
    """Greensboro, North Carolina: the TMY3 file that pvlib carries (36.1° N, 79.95° W).

    Examples
    --------
    >>> import drcmitsuba
    >>> weather = drcmitsuba.weather.default()
    >>> weather.site.latitude, len(weather.data["time"])
    (36.1, 8760)
    """
    return read(lazy.folder_of("pvlib") / "data" / "723170TYA.CSV")
