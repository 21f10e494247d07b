"""Weather files → irradiance per interval: EPW, TMY3 and TMY2 through pvlib, Radiance's WEA.

Every reader ends in the same clock: local standard time, start of the interval, nominal year 2015.
A file is text that somebody else wrote: it is read here (bounded, decoded, its rows counted) and
only then handed to pvlib, which would otherwise open URLs and guess at damaged rows.
"""

from __future__ import annotations

import calendar
import csv
import math
import re
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pvlib
import xarray as xr

from drcmitsuba.errors import InputError

NOMINAL_YEAR = 2015
"""Typical years are patched together from many; 2015 (1 January: Thursday) stands for all."""

BYTES = 32 * 2**20
CUT = "the file is cut or damaged: get it again"
LINES = 600_000  # a year of minutes has 525 600
HIGHEST = {"dni": 1500.0, "dhi": 1500.0, "ghi": 2000.0}  # W/m², cloud enhancement included
LONG_NAMES = {
    "dni": ("direct normal irradiance", "W m-2"),
    "dhi": ("diffuse horizontal irradiance", "W m-2"),
    "ghi": ("global horizontal irradiance", "W m-2"),
    "dew_point": ("dew point temperature", "degC"),
}


@dataclass(frozen=True)
class Site:
    """Where the weather was observed.

    Parameters
    ----------
    name : str
    latitude : float
        Degrees north.
    longitude : float
        Degrees east.
    timezone : float
        Hours east of UTC, standard time; fractions of an hour are possible.
    elevation : float
        Metres above sea level.
    """

    name: str
    latitude: float
    longitude: float
    timezone: float
    elevation: float


@dataclass(frozen=True)
class Weather:
    """Irradiance at a site.

    Parameters
    ----------
    source : str
        File that it was read from.
    site : Site
    step : float
        Length of an interval [h].
    data : xarray.Dataset
        dim `time` (datetime64, local standard time, start of the interval, year 2015); `dni`,
        `dhi`, `ghi` [W/m²] and `dew_point` [°C], float64, NaN where the file has no such column.
        `attrs["sun_time"]` is "middle" or, where a stamp is the sun's instant, "instant".
    notes : tuple of str
        What was left out of the file or looks odd, for the user to read.
    """

    source: str
    site: Site
    step: float
    data: xr.Dataset
    notes: tuple[str, ...]


def read(path: str | Path) -> Weather:
    """Read a weather file, its format told by its suffix.

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
    return reader(path, read_text(path).split("\n"))


def default() -> Weather:
    """Greensboro, North Carolina: the TMY3 file that pvlib carries (36.1° N, 79.95° W)."""
    return read(Path(pvlib.__file__).parent / "data" / "723170TYA.CSV")


def read_text(path: str | Path) -> str:
    r"""Read a text file of at most 32 MiB and 600 000 lines.

    Parameters
    ----------
    path : str or Path
        UTF-8 or, failing that, Latin-1.

    Returns
    -------
    str
        Lines end in "\n" whatever they ended in.

    Raises
    ------
    InputError
        No such file, unreadable, empty, binary or too large.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "file", "no such file", "give the path of a file")
    try:
        with path.open("rb") as file:
            raw = file.read(BYTES + 1)
    except OSError as error:
        raise InputError(path, "file", error.strerror or "unreadable", "check the file") from error
    remedy = "give the text file as its publisher made it"
    if not raw.strip():
        raise InputError(path, "file", "empty", remedy)
    if len(raw) > BYTES:
        raise InputError(path, "file", f"more than {BYTES // 2**20} MiB", remedy)
    if b"\0" in raw:
        raise InputError(path, "file", "binary data (zero bytes)", remedy)
    raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if raw.count(b"\n") > LINES:
        raise InputError(path, "file", f"more than {LINES} lines", remedy)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


# ---- formats ----------------------------------------------------------------------------------


def _read_epw(path: Path, lines: list[str]) -> Weather:
    head = _quoted(path, lines[0])
    tags = [line[:12].upper() for line in lines[:40]]
    if head[0].upper() != "LOCATION" or len(head) < 10 or "DATA PERIODS" not in tags:
        remedy = "an EPW starts with LOCATION and 9 more fields and has a line DATA PERIODS"
        raise InputError(path, "header", _show(lines[0]), remedy)
    first = tags.index("DATA PERIODS") + 1
    if [field.strip() for field in lines[first - 1].split(",")[1:3]] != ["1", "1"]:
        remedy = "give one data period of hourly records"
        raise InputError(path, f"line {first}", _show(lines[first - 1]), remedy)
    site = _site(path, head[1], *head[6:10])
    table = _table(path, lines, first, _fields, lambda fields: fields[1:4], least=16)
    # A comma in the quoted city, a quote left open in a comment or a 36th column lead pvlib astray.
    clean = [",".join(["LOCATION", *"-----", *head[6:10]]), *"------", "DATA PERIODS"]
    clean += [",".join(_fields(line)[:35]) for line in table.lines]
    frame = _by_pvlib(path, pvlib.iotools.read_epw, clean, coerce_year=NOMINAL_YEAR)
    return _hourly(path, site, frame, pd.Timedelta("0h"), table)


def _read_tmy3(path: Path, lines: list[str]) -> Weather:
    head = _quoted(path, lines[0])
    names = _fields(lines[1]) if len(lines) > 1 else []
    lacking = sorted(TMY3_COLUMNS - set(names))
    if len(head) < 7 or lacking:
        got = f"no column {lacking[0]!r}" if lacking else _show(lines[0])
        raise InputError(path, "header", got, "a .csv must be a TMY3 file with its two head lines")
    date, clock = names.index("Date (MM/DD/YYYY)"), names.index("Time (HH:MM)")

    def day_and_hour(fields: list[str]) -> list[str]:
        hour = fields[clock].split(":")[0]
        return [*fields[date].split("/")[:2], "24" if hour in ("0", "00") else hour]

    site = _site(path, head[1], head[4], head[5], head[3], head[6])
    table = _table(path, lines, 2, _fields, day_and_hour, least=len(names))
    clean = [",".join(["0", "-", "-", *head[3:7]]), ",".join(names)]
    clean += [",".join(_fields(line)[: len(names)]) for line in table.lines]
    frame = _by_pvlib(path, pvlib.iotools.read_tmy3, clean, map_variables=True)
    return _hourly(path, site, frame, pd.Timedelta("1h"), table)


def _read_tmy2(path: Path, lines: list[str]) -> Weather:
    head = TMY2_HEAD.fullmatch(lines[0][:200].strip())
    if head is None:
        raise InputError(path, "line 1", _show(lines[0]), "give a TMY2 file with its head line")
    _, name, _, zone, north, lat, lat_minute, east, lon, lon_minute, metres = head.groups()
    latitude = (1 if north == "N" else -1) * (int(lat) + int(lat_minute) / 60)
    longitude = (1 if east == "E" else -1) * (int(lon) + int(lon_minute) / 60)
    site = _site(path, name, latitude, longitude, zone, metres)
    # Fixed columns: every character is a field.
    table = _table(path, lines, 1, list, lambda c: ["".join(c[i : i + 2]) for i in (3, 5, 7)], 142)
    # pvlib splits the head line at its spaces, also those of the city.
    clean = [lines[0].replace(name, re.sub(r"\s+", "_", name), 1), *table.lines]
    frame = _by_pvlib(path, lambda file: pvlib.iotools.read_tmy2(str(file)), clean)
    frame = frame.rename(columns={name.upper(): name for name in HIGHEST})
    return _hourly(
        path, site, frame.assign(temp_dew=frame.DewPoint / 10), pd.Timedelta("0h"), table
    )


def _read_wea(path: Path, lines: list[str]) -> Weather:
    first = next((i for i, line in enumerate(lines) if line.strip()[:1].isdigit()), len(lines))
    head: dict[str, str] = {}
    for line in filter(None, (line.strip() for line in lines[:first])):
        key, *value = line.split(None, 1)
        head[key] = "".join(value)
    if set(head) != set(WEA_HEAD):
        remedy = f"start with the lines {', '.join(WEA_HEAD)}"
        raise InputError(path, "header", _show(", ".join(head)), remedy)
    if head["weather_data_file_units"] != "1":
        got = _show(head["weather_data_file_units"])
        raise InputError(path, "weather_data_file_units", got, "use 1 (dni and dhi in W/m²)")
    west = _number(path, "longitude (degrees west)", head["longitude"], -180, 180)
    zone = _number(path, "time_zone (degrees west)", head["time_zone"], -210, 180)
    elevation = head["site_elevation"]
    site = _site(path, head["place"], head["latitude"], 0 - west, 0 - zone / 15, elevation)
    table = _table(path, lines, first, str.split, lambda words: [*words[:2], "1"], least=5)
    month, day, hour, dni, dhi = zip(*(line.split()[:5] for line in table.lines), strict=True)
    dates = {"year": NOMINAL_YEAR, "month": pd.Series(month), "day": pd.Series(day)}
    days = pd.DatetimeIndex(pd.to_datetime({k: pd.to_numeric(v) for k, v in dates.items()}))
    time, step, sun_time = _wea_time(path, days, pd.Series(hour), table)
    columns = {"dni": pd.Series(dni), "dhi": pd.Series(dhi)}
    return _weather(path, site, step, time, columns, None, sun_time, table)


def _wea_time(
    path: Path, days: pd.DatetimeIndex, hour: pd.Series, table: _Table
) -> tuple[pd.DatetimeIndex, float, str]:
    """Starts of the intervals, step [h] and what a stamp is: the middle or the sun's instant."""
    hours = pd.to_numeric(hour, errors="coerce").to_numpy(float)
    hours = np.where((hours >= 0) & (hours < 24), hours, np.nan)
    minutes = np.round(hours * 60)
    # Two or three decimals: 0.17 h and 0.167 h are both ten minutes.
    off = ~((np.abs(hours * 60 - minutes) < 0.31) & (minutes < 24 * 60))
    _refuse(
        path,
        "hour",
        hour,
        off,
        table,
        "no time of day",
        "use 0 to 24, exclusive, and whole minutes",
    )
    stamps = (days + pd.to_timedelta(minutes, unit="min")).as_unit("ns")
    gaps = np.diff(stamps.to_numpy()) / np.timedelta64(1, "m")
    same_day = np.asarray(days[1:] == days[:-1])
    step = float(gaps[same_day].min()) if same_day.any() else 60.0
    wrong = (gaps <= 0) | (same_day & (gaps != step))
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        got = f"{stamps[row]:%m-%d %H:%M} after {stamps[row - 1]:%m-%d %H:%M}"
        remedy = f"stamps must rise, within a day by one step (here {step:g} min)"
        raise InputError(path, f"line {table.numbers[row]}", got, remedy)
    if step == 60 and (minutes % 60 == 30).all():
        return stamps - pd.Timedelta("30min"), 1.0, "middle"
    return stamps, step / 60, "instant"


TMY3_COLUMNS = {"Date (MM/DD/YYYY)", "Time (HH:MM)", "Dew-point (C)"}
TMY3_COLUMNS |= {f"{name} (W/m^2)" for name in ("GHI", "DNI", "DHI")}
TMY2_HEAD = re.compile(
    r"(\d+)\s+(\S.*?)\s+([A-Z]{2})\s+(-?\d+)\s+([NS])\s*(\d+)\s+(\d+)\s+([EW])\s*(\d+)\s+(\d+)"
    r"\s+(-?\d+)",
    re.ASCII,
)
WEA_HEAD = ["place", "latitude", "longitude", "time_zone", "site_elevation"]
WEA_HEAD += ["weather_data_file_units"]
READERS: dict[str, Callable[[Path, list[str]], Weather]] = {
    ".epw": _read_epw,
    ".csv": _read_tmy3,
    ".tm2": _read_tmy2,
    ".wea": _read_wea,
}


# ---- rows -------------------------------------------------------------------------------------


class _Table(NamedTuple):
    """Rows of a file without 29 February, each with its line number."""

    lines: list[str]
    numbers: list[int]
    leap_rows: int


def _table(
    path: Path,
    lines: list[str],
    first: int,
    split: Callable[[str], list[str]],
    day_and_hour: Callable[[list[str]], Sequence[str]],
    least: int,
) -> _Table:
    """Check that rows are whole and dated; a row that was cut has fewer fields than the first."""
    kept, numbers, leap_rows, width = [], [], 0, 0
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        fields = split(line.rstrip())
        width = width or max(len(fields), least)
        if len(fields) != width:
            got = f"{len(fields)} fields, not {width}"
            raise InputError(path, f"line {number}", got, CUT)
        try:
            month, day, hour = (int(field) for field in day_and_hour(fields))
            valid = 1 <= month <= 12 and 1 <= day <= calendar.monthrange(2016, month)[1]
        except ValueError:
            valid = False
        if not (valid and 1 <= hour <= 24):
            remedy = "a row starts with month, day and hour"
            raise InputError(path, f"line {number}, date", _show(line), remedy)
        if (month, day) == (2, 29):
            leap_rows += 1
        else:
            kept.append(line.rstrip())
            numbers.append(number)
    if not kept:
        raise InputError(path, "rows", "none", CUT)
    return _Table(kept, numbers, leap_rows)


def _by_pvlib(
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
            raise InputError(path, "rows", _show(error), CUT) from error


def _nominal_year(
    path: Path, index: pd.DatetimeIndex, lag: pd.Timedelta, table: _Table
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
        raise InputError(path, f"line {table.numbers[row]}", got, remedy)
    if len(start) != len(whole):
        raise InputError(path, "rows", f"{len(start)} hours, last {start[-1]:%m-%d %H:%M}", remedy)
    return start


# ---- values -----------------------------------------------------------------------------------


def _hourly(
    path: Path, site: Site, frame: pd.DataFrame, lag: pd.Timedelta, table: _Table
) -> Weather:
    time = _nominal_year(path, frame.index, lag, table)
    return _weather(path, site, 1.0, time, frame[list(HIGHEST)], frame["temp_dew"], "middle", table)


def _weather(
    path: Path,
    site: Site,
    step: float,
    time: pd.DatetimeIndex,
    irradiance: Mapping[str, pd.Series],
    dew_point: pd.Series | None,
    sun_time: str,
    table: _Table,
) -> Weather:
    absent = np.full(len(time), np.nan)
    columns = dict.fromkeys(LONG_NAMES, absent)
    columns |= {name: _irradiance(path, name, irradiance[name], table) for name in irradiance}
    notes = []
    if table.leap_rows:
        notes.append(f"29 February dropped ({table.leap_rows} rows): the year has 365 days")
    if dew_point is not None:
        columns["dew_point"] = _dew_point(path, dew_point, table)
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
        {
            name: ("time", columns[name], {"long_name": long_name, "units": units})
            for name, (long_name, units) in LONG_NAMES.items()
        },
        coords={"time": time},
        attrs={"sun_time": sun_time},
    )
    data.time.attrs["long_name"] = "start of the interval, local standard time"
    return Weather(str(path), site, step, data, tuple(notes))


def _irradiance(path: Path, name: str, column: pd.Series, table: _Table) -> np.ndarray:
    """Irradiance [W/m²] of a column; a value that is none is an error that names its line."""
    value = pd.to_numeric(column, errors="coerce").to_numpy(float)
    missing = (value >= 9999) | np.isin(value, (-999, -9900, -9999))
    for bad, what, remedy in (
        (~np.isfinite(value), "not a number", f"write {name} in W/m²"),
        (missing, "the code for missing", "fill the gaps or use another file"),
        (value < 0, "negative", f"{name} is 0 W/m² or more"),
        (value > HIGHEST[name], "implausible", f"{name} is at most {HIGHEST[name]:g} W/m²"),
    ):
        _refuse(path, name, column, bad, table, what, remedy)
    return value


def _refuse(
    path: Path,
    name: str,
    column: pd.Series,
    bad: np.ndarray,
    table: _Table,
    what: str,
    remedy: str,
) -> None:
    """Raise for the first bad row, and say how many there are."""
    if bad.any():
        row = int(np.argmax(bad))
        got = f"{_show(column.iloc[row])}, {what} (rows like it: {np.count_nonzero(bad)})"
        raise InputError(path, f"line {table.numbers[row]}, {name}", got, remedy)


def _dew_point(path: Path, column: pd.Series, table: _Table) -> np.ndarray:
    """Dew point [°C], NaN where missing: 99.9 in EPW, -9900 in TMY3, 999.9 in TMY2."""
    value = pd.to_numeric(column, errors="coerce").to_numpy(float)
    text = np.isnan(value) & column.notna().to_numpy()
    _refuse(path, "dew point", column, text, table, "not a number", "write it in °C")
    return np.where(np.abs(value) < 90, value, np.nan)


def _site(
    path: Path,
    name: str,
    latitude: str | float,
    longitude: str | float,
    timezone: str | float,
    elevation: str | float,
) -> Site:
    return Site(
        " ".join(name.split()),
        _number(path, "latitude", latitude, -90, 90),
        _number(path, "longitude", longitude, -180, 180),
        _number(path, "time zone", timezone, -12, 14),
        _number(path, "elevation", elevation, -500, 9000),
    )


def _number(path: Path, field: str, got: str | float, low: float, high: float) -> float:
    try:
        value = float(got)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise InputError(path, field, _show(got), f"use a number from {low} to {high}")
    return value


def _quoted(path: Path, line: str) -> list[str]:
    """Fields of a head line, where a name in quotes may hold a comma."""
    try:
        return [field.strip() for field in next(csv.reader([line], skipinitialspace=True))] or [""]
    except csv.Error as error:
        raise InputError(path, "line 1", _show(line), CUT) from error


def _fields(line: str) -> list[str]:
    return [field.strip() for field in line.replace('"', "").split(",")]


def _show(value: object) -> str:
    text = str(value)
    return repr(text if len(text) <= 60 else text[:57] + "...")
