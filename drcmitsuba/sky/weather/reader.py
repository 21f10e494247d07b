"""Weather files → irradiance per interval: EPW, TMY3 and TMY2 through pvlib, Radiance's WEA.

Every reader ends in the same clock: local standard time, start of the interval, nominal year 2015.
A file is text that somebody else wrote: it is read here (bounded, decoded, its rows counted) and
only then handed to pvlib, which would otherwise open URLs and guess at damaged rows.
"""

from __future__ import annotations

from pathlib import Path

import pvlib

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.weather.formats import READERS
from drcmitsuba.sky.weather.record import Weather
from drcmitsuba.sky.weather.text import read_text


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
    return reader(path, read_text(path).split("\n"))


def default() -> Weather:
    """Greensboro, North Carolina: the TMY3 file that pvlib carries (36.1° N, 79.95° W)."""
    return read(Path(pvlib.__file__).parent / "data" / "723170TYA.CSV")
