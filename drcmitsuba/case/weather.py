"""The tables of place and time of a case: `[site]`, `[weather]`, `[period]`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drcmitsuba.runtime.toml import Name, Table


class SiteTable(Table):
    """Place of a case without weather file (CIE and sunshine skies)."""

    name: Name = "site"
    """Name of the place in notes."""
    latitude: Annotated[float, Field(ge=-90, le=90)]
    """Latitude, north positive [deg]."""
    longitude: Annotated[float, Field(ge=-180, le=180)]
    """Longitude, east positive [deg]."""
    timezone: Annotated[float, Field(ge=-12, le=14)]
    """Local standard time minus UTC [h]."""
    elevation: Annotated[float, Field(ge=-500, le=9000)] = 0.0
    """Height above the sea [m]."""


class WeatherFile(Table):
    """Weather of a year."""

    file: Path | None = None
    """EPW, TMY3, TMY2 or WEA, relative to the case file; default: the TMY3 year of Greensboro."""


class PeriodTable(Table):
    """Hours that are evaluated; `calendar` sets the days, every other key overrides it."""

    calendar: Literal["EvalDRC", "LM-83"] = "EvalDRC"
    """"EvalDRC": Monday to Friday; "LM-83": every day; both from 8 to 18 h."""
    months: Annotated[tuple[Annotated[int, Field(ge=1, le=12)], ...], Field(min_length=1)] = tuple(
        range(1, 13)
    )
    """Months, 1 (January) to 12."""
    hours: tuple[Annotated[int, Field(ge=0, le=24)], Annotated[int, Field(ge=0, le=24)]] = (8, 18)
    """First hour on the clock, and the hour at which the last one ends [h]."""
    days_per_week: Annotated[int, Field(ge=1, le=7)] | None = None
    """Number of days of a week, counted from Monday."""
    daylight_saving: tuple[str, str] | None = None
    """First and last day of daylight-saving time, "MM-DD"; default: no daylight saving."""
    timestamps: Path | None = None
    """CSV file of time stamps, in place of all other keys; relative to the case file. Each counts
    as the least gap between stamps of a day, at most as an interval of the weather."""

    def of_year(self) -> PeriodTable:
        """Every hour of the year by the same clock."""
        days = self.daylight_saving
        return PeriodTable(calendar="LM-83", hours=(0, 24), daylight_saving=days)
