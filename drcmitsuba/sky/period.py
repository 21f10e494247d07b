"""Time stamps that are evaluated: months, weekdays and clock hours, or a user's own time stamps."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.weather import NOMINAL_YEAR, read_text

HOUR = np.timedelta64(3600, "s")


@dataclass(frozen=True)
class Period:
    """Part of a year, in clock time.

    Raises
    ------
    InputError
        A value is out of its range.

    Notes
    -----
    Month, weekday and hour are all those of the clock, which may show 1 January of the following
    year at the end of a southern December. Clocks change at 0:00 here, not at 1:00 or 2:00.

    Examples
    --------
    >>> from drcmitsuba.sky.period import Period
    >>> Period().hours
    (8, 18)
    """

    months: tuple[int, ...] = tuple(range(1, 13))
    """1 (January) to 12."""
    hours: tuple[float, float] = (8, 18)
    """Clock hours [first, last): (8, 18) is eight in the morning to six in the evening."""
    days_per_week: int = 5
    """1 to 7, counted from Monday: 5 is Monday to Friday."""
    daylight_saving: tuple[str, str] | None = None
    """First and last day, "MM-DD". From 0:00 standard time of the first day to 0:00 standard time
    of the last day (itself exclusive) the clock is one hour ahead of standard time. A first day
    after the last one is a southern summer, across the turn of the year."""

    def __post_init__(self) -> None:
        for field in ("months", "hours"):
            object.__setattr__(self, field, _values(field, getattr(self, field)))
        months, hours = self.months, self.hours
        if not months or len(set(months)) < len(months) or not set(months) <= set(range(1, 13)):
            raise InputError("period", "months", repr(months), "give each month once, 1 to 12")
        if len(hours) != 2 or not 0 <= hours[0] < hours[1] <= 24:
            raise InputError("period", "hours", repr(hours), "give two, 0 <= first < last <= 24")
        days = self.days_per_week
        if isinstance(days, bool) or days not in range(1, 8):
            raise InputError("period", "days_per_week", repr(days), "give 1 to 7, from Monday")
        if self.daylight_saving is not None:
            object.__setattr__(self, "daylight_saving", _days(self.daylight_saving))

    def select(self, time: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Keep the intervals that lie in the period.

        An interval belongs to the month, day and hour on the clock at its middle, so the answer
        does not depend on how finely the hours are divided.

        Parameters
        ----------
        time : ndarray of datetime64, shape (time,)
            Starts of the intervals, local standard time, nominal year 2015.
        step : float
            Length of an interval [h].

        Returns
        -------
        time : ndarray of datetime64, shape (kept,)
        clock : ndarray of datetime64, shape (kept,)
            The same instants on the clock: an hour later while daylight is saved.

        Raises
        ------
        InputError
            Nothing is left, or `step` is no length.
        """
        if not (math.isfinite(step) and 0 < step <= 24):
            raise InputError("period", "step", f"{step!r} h", "give hours above 0, at most 24")
        time = np.asarray(time)
        clock = time + self._saved(time) * HOUR
        middle = clock + np.timedelta64(round(step * 1800), "s")
        day = middle.astype("datetime64[D]")
        hour = (middle - day) / HOUR
        month = middle.astype("datetime64[M]").astype(int) % 12 + 1
        weekday = (day.astype(int) + 3) % 7  # Monday 0; 1 January 1970 was a Thursday
        keep = (
            np.isin(month, self.months)
            & (weekday < self.days_per_week)
            & (hour >= self.hours[0])
            & (hour < self.hours[1])
        )
        if not keep.any():
            raise InputError(
                "period",
                "months, hours, days_per_week",
                f"none of {time.size} time stamps lies in {self}",
                "widen the period or give time stamps in it",
            )
        return time[keep], clock[keep]

    def _saved(self, time: np.ndarray) -> np.ndarray:
        """Where the clock is an hour ahead."""
        if self.daylight_saving is None:
            return np.zeros(time.shape, bool)
        first, last = (np.datetime64(f"{NOMINAL_YEAR}-{day}") for day in self.daylight_saving)
        if first < last:
            return (time >= first) & (time < last)
        return (time >= first) | (time < last)


def read_timestamps(path: str | Path) -> np.ndarray:
    """Read a user's own time stamps from a CSV file with one column, `time`.

    Parameters
    ----------
    path : str or Path
        First line `time`, then one ISO 8601 stamp per line, local standard time, without a zone:
        2015-03-21T10:00 or 2015-03-21T10:00:00, a space in place of the T allowed.

    Returns
    -------
    ndarray of datetime64[ns], shape (time,)
        Time stamps in the nominal year 2015, increasing.

    Raises
    ------
    InputError
        No header, no stamps, a stamp that is none, 29 February, one that is not later in the
        year than the one before, or two in one minute.
    """
    rows = [line.strip().strip('"') for line in read_text(path).split("\n")]
    if rows[0] != "time":
        raise InputError(path, "line 1", repr(rows[0][:60]), "the header must be: time")
    stamps: list[datetime] = []
    for number, row in enumerate(rows[1:], 2):
        if not row:
            continue
        stamp = _stamp(path, number, row)
        if stamps and stamp <= stamps[-1]:
            got = f"{row!r} is not after {stamps[-1]:%m-%d %H:%M:%S}"
            remedy = "sort the stamps by their time of the year, each once"
            raise InputError(path, f"line {number}, time", got, remedy)
        if stamps and stamp.replace(second=0) == stamps[-1].replace(second=0):
            got, remedy = "two time stamps in one minute", "give one a minute at most"
            raise InputError(path, f"line {number}, time", got, remedy)
        stamps.append(stamp)
    if not stamps:
        raise InputError(path, "time", "no time stamps", "give at least one, 2015-03-21T10:00")
    return np.array(stamps, dtype="datetime64[ns]")


def _stamp(path: str | Path, number: int, row: str) -> datetime:
    remedy = "write local standard time as 2015-03-21T10:00, no zone, no 29 February"
    field = f"line {number}, time"
    # Python 3.11 reads more of ISO 8601 than 3.10: ask for what both read.
    if not re.fullmatch(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?", row, re.ASCII):
        raise InputError(path, field, repr(row[:60]), remedy)
    try:
        return datetime.fromisoformat(row).replace(year=NOMINAL_YEAR)
    except ValueError as error:
        raise InputError(path, field, f"{row!r} ({error})", remedy) from error


def _values(field: str, values: object) -> tuple[float, ...]:
    """Tuple of numbers, also from a list as TOML gives it."""
    if not isinstance(values, (tuple, list, range)) or any(
        isinstance(value, bool) or not isinstance(value, (int, float)) for value in values
    ):
        raise InputError("period", field, repr(values), "give a list of numbers")
    return tuple(values)


def _days(days: object) -> tuple[str, str]:
    """First and last day of daylight saving, each a day of the nominal year."""
    try:
        first, last = (str(day) for day in days)  # type: ignore[attr-defined]
        for day in (first, last):
            datetime.strptime(f"{NOMINAL_YEAR}-{day}", "%Y-%m-%d")
        if first == last or {len(first), len(last)} != {5}:
            raise ValueError(first)
    except (TypeError, ValueError):
        remedy = 'give the first and the last day as ["03-29", "10-25"]'
        raise InputError("period", "daylight_saving", repr(days), remedy) from None
    return first, last


EVALDRC = Period(days_per_week=5)
"""Bauer & Wittkopf: 8 to 18 h, five-day weeks, 2610 hours."""

LM83 = Period(days_per_week=7)
"""IES LM-83: 8 to 18 h, every day, 3650 hours."""


def period(table: PeriodTable) -> Period:
    """Period of a case; keys beside `calendar` override it."""
    days = {"EvalDRC": EVALDRC, "LM-83": LM83}[table.calendar].days_per_week
    return Period(
        months=table.months,
        hours=table.hours,
        days_per_week=table.days_per_week or days,
        daylight_saving=table.daylight_saving,
    )


def whole_year(step: float) -> np.ndarray:
    """Starts of all intervals of the nominal year, of a length [h]."""
    length = np.timedelta64(round(step * 3600), "s")
    year = np.arange("2015-01-01", "2016-01-01", length, dtype="datetime64[s]")
    return year.astype("datetime64[ns]")
