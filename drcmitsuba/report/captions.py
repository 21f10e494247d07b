"""Captions of pictures: weather, period and accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.scene.geometry import clockwise, origin
from drcmitsuba.sky.period import period

METRICS = ("sDA", "ASE")
NO_BREAK = "\N{NO-BREAK SPACE}"
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")


def caption(case: Case, illuminance: xr.Dataset, numbers: Mapping[str, Any], of: str = "") -> str:
    """Weather, period and 95 % intervals of an evaluation, with numbers as in `metrics.json`.

    `of` says whose intervals they are where a picture shows a part: " of all 3 plans".

    Such as "723170TYA.CSV, 36.1° N, 80.0° W; Jan–Dec, Mon–Fri, 8–18 h: 2610 h; 95 % intervals: sDA
    83.3–84.7 %, ASE 39.8–39.8 %".
    """
    ends = (f"{name} {numbers[name]['low']:.1f}–{numbers[name]['high']:.1f} %" for name in METRICS)
    bounds = ", ".join(ends).replace(" ", NO_BREAK).replace("," + NO_BREAK, ", ")
    return f"{place_and_period(case, illuminance, numbers)}; 95 % intervals{of}: {bounds}"


def place_and_period(case: Case, illuminance: xr.Dataset, numbers: Mapping[str, Any]) -> str:
    """Weather file, place, months, days and hours of an evaluation; arguments as for `caption`."""
    weather = numbers.get("settings", {}).get("weather_source", "")
    parts = [Path(str(weather)).name] if weather else []
    if {"latitude", "longitude"} <= set(illuminance.attrs):
        parts.append(place_text(illuminance.attrs["latitude"], illuminance.attrs["longitude"]))
    where = ", ".join(parts)
    return f"{where}; {period_text(case, illuminance)}" if where else period_text(case, illuminance)


def turned_text(case: Case) -> str:
    """How the coordinates of a plan, whose north is up, follow from those of the case's file."""
    angle = clockwise(case)
    if not angle:
        return ""
    x, y, _ = origin(case)
    way = "clockwise" if angle > 0 else "counterclockwise"
    return f"; north is up: turned by {abs(angle):g}° {way} about ({x:.0f}, {y:.0f})"


def place_text(latitude: float, longitude: float) -> str:
    """Place in degrees, as "36.1° N, 80.0° W"."""
    north, east = "S" if latitude < 0 else "N", "W" if longitude < 0 else "E"
    text = f"{abs(latitude):.1f}° {north}, {abs(longitude):.1f}° {east}"
    return text.replace("° ", f"°{NO_BREAK}")


def period_text(case: Case, illuminance: xr.Dataset) -> str:
    """Months, days and hours of a case's period, and the number of its hours."""
    if case.period.timestamps is not None:
        return f"{illuminance.sizes['time']} time stamps of {case.period.timestamps.name}"
    p = period(case.period)
    days = "daily" if p.days_per_week == 7 else f"{DAYS[0]}–{DAYS[p.days_per_week - 1]}"
    if p.days_per_week == 1:
        days = DAYS[0]
    total = illuminance.sizes["time"] * float(illuminance.attrs.get("step_hours", 1.0))
    hours = f"{p.hours[0]:g}–{p.hours[1]:g} h"
    return f"{month_names(p.months)}, {days}, {hours}: {total:g} h"


def month_names(months: tuple[int, ...]) -> str:
    """Names of months, neighbours joined: (1, 2, 3, 6) is "Jan–Mar, Jun"."""
    runs: list[list[int]] = []
    for month in sorted(months):
        if runs and month == runs[-1][-1] + 1:
            runs[-1].append(month)
        else:
            runs.append([month])
    ends = ((MONTHS[run[0] - 1], MONTHS[run[-1] - 1]) for run in runs)
    return ", ".join(first if first == last else f"{first}–{last}" for first, last in ends)


def period_name(table: PeriodTable) -> str:
    """Short name of a period: "year", its months, or "time stamps"."""
    if table.timestamps is not None:
        return "time stamps"
    return "year" if len(table.months) == 12 else month_names(table.months)


def is_rated(case: Case) -> bool:
    """True if sDA has the threshold, hours and every day of the year that LM-83 requires."""
    asked, p = case.metrics, period(case.period)
    whole = case.period.timestamps is None and len(p.months) == 12 and p.days_per_week == 7
    return whole and p.hours == (8, 18) and (asked.sda_threshold, asked.sda_fraction) == (300, 0.5)
