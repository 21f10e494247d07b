"""Hours and points that a standard asks for, where a case has others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import GridsByRule, Sensors, SpaceSensors
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight, daylight, daylight_and_year
from drcmitsuba.standards.coverage import check_facing, check_spacing, hours_of
from drcmitsuba.standards.standard import Standard, read

LAID = 0.6
"""Distance of the points of a grid that is laid [m]: the 2 ft of LM-83, rounded down."""
HOURS = {
    "8 to 18": "from 8 to 18 h on every day",
    "daylight": "of most daylight",
    "year": "of the whole year",
    "equinox": "at 9 and 15 h of a clear day near each equinox",
}
"""Hours that standards count, in words."""


@dataclass(frozen=True)
class Terms:
    """Case that some standards can be judged on, with what differs from the user's."""

    case: Case
    standards: tuple[str, ...]
    """Names of the standards."""
    hours: float | None = None
    """Hours of the user's period, where it was replaced [h]."""
    grid: str = ""
    """Grid that was laid in place of the user's; empty where that one stays."""

    def taken(self, standard: str) -> tuple[str, ...]:
        """Line on the hours of a standard, where the user's period was replaced."""
        asked = read(standard)
        return () if self.hours is None or not asked.quantities else (in_place(asked, self.hours),)


def in_place(standard: Standard, own: float) -> str:
    """Line on the hours that a standard counts, in place of `own` hours of the case's period."""
    return f"hours {HOURS[standard.hours]} are counted, in place of the case's {own:g} h"


def terms(case: Case, names: Sequence[str]) -> tuple[list[Terms], dict[str, InputError]]:
    """Cases on which standards can be judged: the user's, or one with another period or grid.

    Where the period does not serve the hours of all these standards, the hours are those of a
    whole year. A grid that is coarser than a standard allows, a line, or points that do not face up
    give way to a level grid for that standard. What standards accept stays as it is.

    Parameters
    ----------
    case : Case
        Case of the user; the backend has been selected.
    names : sequence of str
        Names of standards.

    Returns
    -------
    list of Terms
        Each standard is in one of them, or refused.
    dict of str to InputError
        Standards that are refused, and why: the weather has no whole year, or no grid can be laid
        in a model whose floors the case does not name.
    """
    light = daylight_and_year(case)
    hours, refused = None, _uncovered(case, light, names)
    if refused:
        hours = light.sky.sizes["time"] * light.step_hours
        days = case.period.daylight_saving
        case = case.with_tables(period=PeriodTable(calendar="LM-83", daylight_saving=days))
        refused = _uncovered(case, daylight_and_year(case), names)
    covered = [name for name in names if name not in refused]
    unfit = {name: error for name in covered if (error := _unfit(case, read(name))) is not None}
    fit = tuple(name for name in covered if name not in unfit)
    out = [Terms(case, fit, hours)] if fit else []
    if not unfit:
        return out, refused
    got = next(iter(unfit.values())).got
    try:
        sensors, words = _laid(case, got)
        laid = Terms(case.with_tables(sensors=sensors), tuple(unfit), hours, words)
        for name in unfit:
            if (error := _unfit(laid.case, read(name))) is not None:
                raise error
    except InputError as error:
        return out, refused | dict.fromkeys(unfit, error)
    return [*out, laid], refused


def dated(case: Case, standard: Standard) -> Case:
    """Case whose own time stamps are, or hold, the hours that a standard counts."""
    light = daylight(case)
    try:
        hours_of(standard, light.sky, light.step_hours, case.source, light.sky)
    except InputError:
        period = case.period.of_year()
        if standard.hours == "8 to 18":
            period = period.model_copy(update={"hours": (8, 18)})
        return case.with_tables(period=period)
    return case


def _uncovered(case: Case, light: Daylight, names: Sequence[str]) -> dict[str, InputError]:
    """Standards whose hours a daylight with its year does not have, and why."""
    refused, sky = {}, light.every.sky
    for name in names:
        try:
            hours_of(read(name), sky, light.step_hours, case.source, sky)
        except InputError as error:
            refused[name] = error
    return refused


def _unfit(case: Case, standard: Standard) -> InputError | None:
    """Reason why a standard does not accept the points of a case."""
    at = prepared(case).receivers.coordinates
    try:
        check_facing(at, case.source)
        check_spacing(standard, at, case.source)
    except InputError as error:
        return error
    return None


def _laid(case: Case, got: str) -> tuple[Sensors | GridsByRule, str]:
    """Level grid in place of a case's points, which are as `got` says, and a line on it."""
    own = case.sensors
    words = f"points lie at most {LAID:g} m apart, in place of the case's: {got}"
    if isinstance(own, GridsByRule):
        return own.model_copy(update={"spacing": LAID}), words
    if case.building.spaces and not isinstance(own, Sensors):
        return SpaceSensors(spaces=("*",), spacing=LAID), words
    if isinstance(own, Sensors) and min(own.count) > 1 and min(own.count) * own.spacing >= 2 * LAID:
        extent = np.array(own.count) * own.spacing
        corner, z = np.array(own.corner[:2]), own.corner[2]
    elif case.room is not None:
        extent, corner = np.array(case.room.size[:2]), np.zeros(2)
        z = float(np.median(prepared(case).sensors.points[:, 2]))
    else:
        remedy = 'name floors in [sensors], floors = ["NAME"], or give at most 0.6 m between points'
        raise InputError(case.source, "sensors", got, remedy)
    spacing = float(min(LAID, extent.min() / 2))
    count = np.maximum(1, np.floor(extent / spacing + 1e-9)).astype(int)
    start = corner + (extent - count * spacing) / 2
    grid = Sensors(
        corner=(float(start[0]), float(start[1]), z),
        count=(int(count[0]), int(count[1])),
        spacing=spacing,
    )
    words = f"{count[0]} × {count[1]} points lie {spacing:.3g} m apart, {z:g} m high"
    return grid, f"{words}, in place of the case's: {got}"
