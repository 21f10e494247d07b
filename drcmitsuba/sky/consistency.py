"""Whether a weather file agrees with itself: its global irradiance with its diffuse and direct.

    ghi = dhi + dni · cos Z

holds for the sun that stood there. A wrong zone or latitude, irradiance that is written under the
hour beside its own, and a column that was scaled or lost break it. Files are used as they are; each
note carries the number that makes them doubtful.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from drcmitsuba.sky.sun import sun_position
from drcmitsuba.sky.weather import Site, Weather

LARGEST = 12.0
"""RMS [W/m²] of the disagreement above which there is a note; measured years have 1 to 5."""
BETTER = 0.6
"""Factor of it by which another sun has to fit better to be named."""
SHIFTS = (-90, -60, -30, 30, 60, 90)
"""Shifts of the sun that are tried [min]."""
EVERY = 10
"""Days of a year of which one is looked at."""
HIGH = 0.05
"""Cosine of the zenith above which hours are compared: the middle of a first hour is coarse."""
AT_NIGHT = 0.01
"""Share of direct light below the horizon above which there is a note."""


class _Year(NamedTuple):
    """Hours of a year at a site."""

    site: Site
    time: np.ndarray
    dni: np.ndarray
    dhi: np.ndarray
    ghi: np.ndarray

    def cosines(self, rows: np.ndarray, shift: int = 0) -> np.ndarray:
        """Cosine of the sun's zenith in the middle of some hours, moved by minutes."""
        times = self.time[rows] + np.timedelta64(shift, "m")
        return np.asarray(sun_position(times, 1.0, self.site)["direction"].values[:, 2])


def notes_on(w: Weather) -> tuple[str, ...]:
    """State where an hourly year contradicts itself, each with the number that shows it."""
    if w.step != 1 or w.data.attrs.get("sun_time") != "middle" or "ghi" not in w.data:
        return ()
    columns = (w.data[name].values.astype(float).tobytes() for name in ("dni", "dhi", "ghi"))
    time = w.data["time"].values.astype("datetime64[ns]")
    return _notes(w.site, time.tobytes(), *columns)


@lru_cache(maxsize=4)  # every state, picture and forecast of a case reads its weather
def _notes(site: Site, time: bytes, *columns: bytes) -> tuple[str, ...]:
    """Notes on the starts of hours, and on their dni, dhi and ghi, as memory."""
    year = _Year(site, np.frombuffer(time, "datetime64[ns]"), *map(np.frombuffer, columns))
    lost = [
        f"no {kind} irradiance in any row, though global irradiance is there"
        for kind, values in (("direct", year.dni), ("diffuse", year.dhi))
        if np.nan_to_num(year.ghi).any() and not values.any()
    ]
    return (*lost, *_disagreement(year), *_at_night(year))


def _disagreement(year: _Year) -> list[str]:
    """Compare global irradiance with that of the sun where it stood, or may have stood."""
    days = year.time.astype("datetime64[D]").astype(int)
    rows = np.flatnonzero((days % EVERY == 0) & np.isfinite(year.ghi))
    if not len(rows):
        return []
    dni, dhi, ghi = (column[rows] for column in (year.dni, year.dhi, year.ghi))

    def rms(cosine: np.ndarray) -> float:
        there = (cosine > HIGH) & (ghi > 0)
        off = ghi - dhi - dni * np.maximum(cosine, 0)
        return float(np.sqrt((off[there] ** 2).mean())) if there.any() else 0.0

    own = rms(year.cosines(rows))
    if own <= LARGEST:
        return []
    note = f"global irradiance differs from diffuse + direct · cos Z by {own:.0f} W/m² (RMS)"
    mirrored = year._replace(site=replace(year.site, latitude=-year.site.latitude))
    tried = [(rms(mirrored.cosines(rows)), f"at latitude {mirrored.site.latitude:g}")]
    for shift in SHIFTS:
        name = f"with the sun {abs(shift)} min {'later' if shift > 0 else 'earlier'}"
        tried.append((rms(year.cosines(rows, shift)), name))
    best, name = min(tried)
    if best >= BETTER * own:
        return [f"{note}: one of the three columns is wrong"]
    return [
        f"{note}, {name} by {best:.0f}: check the place, its time zone and which hour a row means"
    ]


def _at_night(year: _Year) -> list[str]:
    """State the direct light of hours whose sun stands below the horizon."""
    every = np.flatnonzero(year.dni > 0)
    for rows in (every[::EVERY], every):  # few of them tell whether it is worth to look at all
        dni = year.dni[rows]
        lost, whole = dni[year.cosines(rows) <= 0].sum() / 1000, dni.sum() / 1000
        if lost <= AT_NIGHT * whole:
            return []
    there = f"{lost:.0f} of {whole:.0f} kWh/m²"
    return [f"{there} of direct light fall into hours without sun, and count nowhere"]
