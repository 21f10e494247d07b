"""Remarks on the place and the period of a case."""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.errors import on_a_line
from drcmitsuba.sky.period import period, whole_year
from drcmitsuba.sky.weather import Site, Weather

SAME_LATITUDE, SAME_LONGITUDE = 0.5, 1.0
"""Largest difference between a stated place and the weather's without a remark [deg]."""
DARK_SHARE = 0.05
"""Share of time stamps without daylight above which a remark is made."""


def place_notes(case: Case, site: Site) -> tuple[str, ...]:
    """Remarks on places that the case and its model state, where they are not the weather's."""
    table, location = case.site, case.building.location
    stated: list[tuple[str, float, float]] = []
    if table is not None and case.weather.file is not None:
        stated.append((f"[site] {table.name}", table.latitude, table.longitude))
    if location is not None:
        name = f"the model's place {location.name}".rstrip()
        stated.append((name, location.latitude, location.longitude))
    notes = []
    for name, latitude, longitude in stated:
        apart = abs((longitude - site.longitude + 180) % 360 - 180)
        if abs(latitude - site.latitude) > SAME_LATITUDE or apart > SAME_LONGITUDE:
            notes.append(
                f"{on_a_line(name)} (latitude {latitude:g}, longitude {longitude:g}) is not the "
                f"weather's place, {on_a_line(site.name)} (latitude {site.latitude:g}, longitude "
                f"{site.longitude:g}), which counts; name its own by --weather or in [weather]"
            )
    return tuple(notes)


def _missing_hours(case: Case, w: Weather, stamps: int) -> list[str]:
    """Remark on hours of the period that the weather does not have."""
    asked = len(period(case.period).select(whole_year(w.step), w.step)[0])
    if stamps >= asked:
        return []
    kind = "hours" if w.step == 1 else f"intervals of {60 * w.step:g} min"
    each = "" if w.data.attrs.get("sun_time") == "middle" else ", a moment each"
    return [
        f"the weather has {stamps} of the period's {asked} {kind}{each}; the others count nowhere"
    ]


def period_notes(case: Case, sky: xr.Dataset, w: Weather, step_hours: float) -> tuple[str, ...]:
    """Remarks on a period that is no whole year, and on hours without daylight.

    A time stamp counts as `step_hours` [h].
    """
    stamps = sky.sizes["time"]
    months, limit = len(case.period.months), case.metrics.ase_hours
    notes = [] if case.period.timestamps is not None else _missing_hours(case, w, stamps)
    if case.period.timestamps is not None or months < 12:
        part = f"{stamps * step_hours:g} h in {months} of 12 months"
        if case.period.timestamps is not None:
            part = f"{stamps} time stamps of {60 * step_hours:g} min each"
        notes.append(f"the period is {part}, no year: the {limit:g} h of ASE are not scaled to it")
    dark = int(((sky["sun"].values <= 0) & ~np.any(sky["sky"].values > 0, axis=1)).sum())
    if dark > DARK_SHARE * stamps:
        notes.append(f"{dark} of {stamps} time stamps have no daylight; sDA and msDA count them")
    return tuple(notes)
