"""Weather files that are made here: a year of clear days somewhere, in the ways of real files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

LIT = 800.0, 100.0
"""Direct normal and diffuse irradiance while the sun is up [W/m²]."""


def sine_of_sun(hours: pd.DatetimeIndex, latitude: float, noon: float) -> np.ndarray:
    """Sine of the sun's altitude in the middle of each hour; `noon`: solar noon by the clock."""
    declination = np.radians(-23.44) * np.cos(2 * np.pi * (hours.day_of_year + 9.5) / 365.25)
    turn = np.radians(15) * (hours.hour + 0.5 - noon)
    up = np.radians(latitude)
    return (
        np.sin(up) * np.sin(declination) + np.cos(up) * np.cos(declination) * np.cos(turn)
    ).to_numpy()


def clear_year(
    path: Path, latitude: float, longitude: float, timezone: float, *,
    place: str = "Town", comment: str = "made", leap: bool = False,
) -> Path:  # fmt: skip
    """Write an EPW file, in Latin-1; one of a leap year has 8784 rows. Illuminances are missing."""
    year = 2016 if leap else 2015
    hours = pd.date_range(f"{year}-01-01", f"{year}-12-31 23:00", freq="h")
    sine = sine_of_sun(hours, latitude, 12 + timezone - longitude / 15)
    location = f"LOCATION,{place},-,XXX,made,000000,{latitude},{longitude},{timezone},10.0"
    lines = [location, "DESIGN CONDITIONS,0", "TYPICAL/EXTREME PERIODS,0", "GROUND TEMPERATURES,0"]
    lines += ["HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0", f"COMMENTS 1,{comment}", "COMMENTS 2,"]
    lines += ["DATA PERIODS,1,1,Data,Sunday,1/1,12/31"]
    rest = ",".join(["999999", "999999", "999999", "9999", *["0"] * 15])
    for hour, s in zip(hours, sine, strict=True):
        dni, dhi = LIT if s > 0 else (0.0, 0.0)
        light = f"0,0,300,{dni * s + dhi:.0f},{dni:.0f},{dhi:.0f}"
        stamp = f"{year},{hour.month},{hour.day},{hour.hour + 1},60,?9?9"
        lines.append(f"{stamp},20.0,7.5,50,98100,{light},{rest}")
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("latin-1"))
    return path


def ten_minutes(path: Path, latitude: float, longitude: float, timezone: float) -> Path:
    """Write a WEA file with a row for every ten minutes of a year."""
    stamps = pd.date_range("2015-01-01", "2015-12-31 23:50", freq="10min")
    rows = [f"place Made here\nlatitude {latitude}\nlongitude {-longitude}"]
    rows += [f"time_zone {-15 * timezone}\nsite_elevation 2.0\nweather_data_file_units 1"]
    sine = sine_of_sun(stamps, latitude, 12 + timezone - longitude / 15)
    for at, s in zip(stamps, sine, strict=True):
        dni, dhi = LIT if s > 0 else (0.0, 0.0)
        rows.append(f"{at.month} {at.day} {at.hour + at.minute / 60:.3f} {dni:.0f} {dhi:.0f}")
    path.write_text("\n".join(rows) + "\n", encoding="ascii")
    return path
