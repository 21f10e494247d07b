"""Weather files → irradiance per interval: EPW, TMY3 and TMY2 through pvlib, Radiance's WEA.

Every reader ends in the same clock: local standard time, start of the interval, nominal year 2015.
A file is text that somebody else wrote: it is read here (bounded, decoded, its rows counted) and
only then handed to pvlib, which would otherwise open URLs and guess at damaged rows.
"""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pvlib

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.weather import record, text
from drcmitsuba.sky.weather.record import Weather
from drcmitsuba.sky.weather.text import NumberedRows

DATE, CLOCK = "Date (MM/DD/YYYY)", "Time (HH:MM)"
TMY3_COLUMNS = {DATE, CLOCK, "Dew-point (C)", "GHI (W/m^2)", "DNI (W/m^2)", "DHI (W/m^2)"}
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
        remedy = "give one data period of hourly records"
        raise InputError(path, f"line {first}", text.show(lines[first - 1]), remedy)
    site = record.site_of(path, head[1], *head[6:10])
    table = text.rows_of(path, lines, first, text.fields, lambda fields: fields[1:4], least=16)
    # A comma in the quoted city, a quote left open in a comment or a 36th column lead pvlib astray.
    clean = [",".join(["LOCATION", *"-----", *head[6:10]]), *"------", "DATA PERIODS"]
    clean += [",".join(text.fields(line)[:35]) for line in table.lines]
    frame = by_pvlib(path, pvlib.iotools.read_epw, clean, coerce_year=record.NOMINAL_YEAR)
    return record.hourly(site, frame, pd.Timedelta("0h"), table)


def _read_tmy3(path: Path, lines: list[str]) -> Weather:
    head = text.quoted(path, lines[0])
    names = text.fields(lines[1]) if len(lines) > 1 else []
    lacking = sorted(TMY3_COLUMNS - set(names))
    if len(head) < 7 or lacking:
        got = f"no column {lacking[0]!r}" if lacking else text.show(lines[0])
        raise InputError(path, "header", got, "a .csv must be a TMY3 file with its two head lines")
    date, clock = names.index(DATE), names.index(CLOCK)

    def day_and_hour(fields: list[str]) -> list[str]:
        hour = fields[clock].split(":")[0]
        return [*fields[date].split("/")[:2], "24" if hour in ("0", "00") else hour]

    site = record.site_of(path, head[1], head[4], head[5], head[3], head[6])
    table = text.rows_of(path, lines, 2, text.fields, day_and_hour, least=len(names))
    clean = [",".join(["0", "-", "-", *head[3:7]]), ",".join(names)]
    clean += [",".join(text.fields(line)[: len(names)]) for line in table.lines]
    frame = by_pvlib(path, pvlib.iotools.read_tmy3, clean, map_variables=True)
    return record.hourly(site, frame, pd.Timedelta("1h"), table)


def _read_tmy2(path: Path, lines: list[str]) -> Weather:
    head = TMY2_HEAD.fullmatch(lines[0][:200].strip())
    if head is None:
        raise InputError(path, "line 1", text.show(lines[0]), "give a TMY2 file with its head line")
    _, name, _, zone, north, lat, lat_minute, east, lon, lon_minute, metres = head.groups()
    latitude = (1 if north == "N" else -1) * (int(lat) + int(lat_minute) / 60)
    longitude = (1 if east == "E" else -1) * (int(lon) + int(lon_minute) / 60)
    site = record.site_of(path, name, latitude, longitude, zone, metres)
    # Fixed columns: every character is a field.
    table = text.rows_of(
        path, lines, 1, list, lambda c: ["".join(c[i : i + 2]) for i in (3, 5, 7)], 142
    )
    # pvlib splits the head line at its spaces, also those of the city.
    clean = [lines[0].replace(name, re.sub(r"\s+", "_", name), 1), *table.lines]
    frame = by_pvlib(path, lambda file: pvlib.iotools.read_tmy2(str(file)), clean)
    frame = frame.rename(columns={name.upper(): name for name in record.HIGHEST})
    frame = frame.assign(temp_dew=frame.DewPoint / 10)
    return record.hourly(site, frame, pd.Timedelta("0h"), table)


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
    table = text.rows_of(path, lines, first, str.split, lambda words: [*words[:2], "1"], least=5)
    month, day, hour, dni, dhi = zip(*(line.split()[:5] for line in table.lines), strict=True)
    dates = {"year": record.NOMINAL_YEAR, "month": pd.Series(month), "day": pd.Series(day)}
    days = pd.DatetimeIndex(pd.to_datetime({k: pd.to_numeric(v) for k, v in dates.items()}))
    time, step, sun_time = _wea_time(days, pd.Series(hour), table)
    columns = {"dni": pd.Series(dni), "dhi": pd.Series(dhi)}
    return record.weather_of(site, step, time, columns, None, sun_time, table)


def _wea_time(
    days: pd.DatetimeIndex, hour: pd.Series, table: NumberedRows
) -> tuple[pd.DatetimeIndex, float, str]:
    """Starts of the intervals, step [h] and what a stamp is: the middle or the sun's instant."""
    hours = pd.to_numeric(hour, errors="coerce").to_numpy(float)
    hours = np.where((hours >= 0) & (hours < 24), hours, np.nan)
    minutes = np.round(hours * 60)
    # Two or three decimals: 0.17 h and 0.167 h are both ten minutes.
    off = ~((np.abs(hours * 60 - minutes) < 0.31) & (minutes < 24 * 60))
    remedy = "use 0 to 24, exclusive, and whole minutes"
    table.refuse("hour", hour, off, "no time of day", remedy)
    stamps = (days + pd.to_timedelta(minutes, unit="min")).as_unit("ns")
    gaps = np.diff(stamps.to_numpy()) / np.timedelta64(1, "m")
    same_day = np.asarray(days[1:] == days[:-1])
    step = float(gaps[same_day].min()) if same_day.any() else 60.0
    wrong = (gaps <= 0) | (same_day & (gaps != step))
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        got = f"{stamps[row]:%m-%d %H:%M} after {stamps[row - 1]:%m-%d %H:%M}"
        remedy = f"stamps must rise, within a day by one step (here {step:g} min)"
        raise InputError(table.path, f"line {table.numbers[row]}", got, remedy)
    if step == 60 and (minutes % 60 == 30).all():
        return stamps - pd.Timedelta("30min"), 1.0, "middle"
    return stamps, step / 60, "instant"


def by_pvlib(
    path: Path, reader: Callable[..., tuple[pd.DataFrame, Any]], lines: list[str], **options: Any
) -> pd.DataFrame:
    """Let pvlib read cleaned rows: from a file, as read_tmy2 and pvlib < 0.13 take nothing else."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        # Columns that are not used here may mix numbers and text.
        warnings.simplefilter("ignore", pd.errors.DtypeWarning)
        clean = Path(folder) / "weather"
        clean.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")
        try:
            return reader(clean, **options)[0]
        except (ValueError, TypeError, KeyError, IndexError, OverflowError) as error:
            raise InputError(path, "rows", text.show(error), text.CUT) from error


READERS: dict[str, Callable[[Path, list[str]], Weather]] = {
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
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(path, "suffix", repr(path.suffix), f"use one of {', '.join(READERS)}")
    return reader(path, text.read_text(path).split("\n"))


def default() -> Weather:
    """Greensboro, North Carolina: the TMY3 file that pvlib carries (36.1° N, 79.95° W)."""
    return read(Path(pvlib.__file__).parent / "data" / "723170TYA.CSV")
