"""Further pictures of an evaluation: mountains, a section, temporal maps, the path of the sun."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from drcmitsuba.case.case import Case
from drcmitsuba.report.captions import place_and_period
from drcmitsuba.report.colour_scale import scale
from drcmitsuba.report.figures import has_shade
from drcmitsuba.report.mountain import forms_rows, mountain
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.section import meets, section, sensors_along, through_middle
from drcmitsuba.report.sheets import MOST_SHEETS, sheets
from drcmitsuba.report.sun_path import sun_path
from drcmitsuba.report.temporal_map import temporal_map
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.nearest_sensors import nearest_sensors, positions_of
from drcmitsuba.schema import luminance
from drcmitsuba.sky.weather import Site

Place = Sequence[float]
"""Place x, y, or x, y, z [m]."""


def year_figures(
    case: Case, illuminance: xr.Dataset, numbers: dict[str, Any], *,
    points: Sequence[Place] = (), line: tuple[Place, Place] | None = None,
) -> dict[str, Figure]:  # fmt: skip
    """Draw further pictures of an evaluation.

    Parameters
    ----------
    case : Case
    illuminance : xr.Dataset
        E as on disk [lx].
    numbers : mapping
        Content of `metrics.json`.
    points : sequence of (x, y) or (x, y, z)
        Points [m] whose nearest sensor gets a temporal map of its own.
    line : tuple of two (x, y), optional
        Ends of a section [m] through every plan with sensors there. By default it goes through the
        middle of the sensors of the first plan, away from the glazing.

    Returns
    -------
    dict of str to Figure
        By file name: `illuminance_mountain.png`, where the sensors form rows and columns,
        `illuminance_section.png`, or `illuminance_section_K.png` of plan K where a line crosses
        several, `illuminance_year.png` of the mean over all sensors, `illuminance_year_N.png` of
        sensor N, and `sun_path.png`, where E has the place.

    Raises
    ------
    InputError
        No sensor stands near a point or on the line, or there are too many points.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report.year_figures import year_figures
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> sorted(year_figures(result.case, result.illuminance, result.metrics))
    ['illuminance_mountain.png', 'illuminance_section.png', 'illuminance_year.png', 'sun_path.png']
    """
    E = luminance(illuminance["total"]).assign_attrs(units="lx", long_name="illuminance")
    shade = ", shade applied" if has_shade(case, illuminance) else ""
    caption = place_and_period(case, illuminance, numbers)
    mean = E.mean("time", dtype=float).assign_attrs(E.attrs | {"long_name": "mean illuminance"})
    drawn = _in_plan(
        case, illuminance, mean, line, f"{case.name}: mean illuminance{shade}", caption
    )
    drawn["illuminance_year.png"] = temporal_map(
        E.mean("sensor", keep_attrs=True), caption=caption,
        title=f"{case.name}: mean illuminance of all sensors{shade}",
    ).figure  # fmt: skip
    every = positions_of(illuminance)
    for sensor in nearest_sensors(illuminance, points, "points"):
        at = ", ".join(f"{x:g}" for x in every[sensor])
        drawn[f"illuminance_year_{sensor}.png"] = temporal_map(
            E.isel(sensor=sensor), caption=caption,
            title=f"{case.name}: illuminance of sensor {sensor} at ({at}) m{shade}",
        ).figure  # fmt: skip
    site, attributes = site_of(case.name, illuminance), illuminance.attrs
    if site is not None:
        closed = illuminance.get("shade_closed", xr.zeros_like(illuminance["time"], dtype=bool))
        drawn["sun_path.png"] = sun_path(
            closed, site,
            step=float(attributes.get("step_hours", 1.0)),
            sun_time=str(attributes.get("sun_time", "middle")),
            title=f"{case.name}: suns of the period" + ", and of the closed shade" * bool(shade),
            caption=caption,
        ).figure  # fmt: skip
    return drawn


def site_of(name: str, illuminance: xr.Dataset) -> Site | None:
    """Place of E by its attributes; None where it has none.

    Raises
    ------
    InputError
        There is no such place on earth.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report.year_figures import site_of
    >>> site_of("office", drcmitsuba.evaluate("office.toml").illuminance).latitude
    36.1
    """
    most = {"latitude": 90.0, "longitude": 360.0, "timezone": 24.0}
    if not set(most) <= set(illuminance.attrs):
        return None
    at = {key: float(illuminance.attrs[key]) for key in most}
    for key, largest in most.items():
        if not abs(at[key]) <= largest:
            remedy = f"give a number up to {largest:g}"
            raise InputError("illuminance", key, f"{at[key]:g}", remedy)
    return Site(name, **at, elevation=0.0)


def _in_plan(
    case: Case, illuminance: xr.Dataset, mean: xr.DataArray, line: tuple[Place, Place] | None,
    title: str, caption: str,
) -> dict[str, Figure]:  # fmt: skip
    """Mountains of all sheets, in the same colours, and sections: along a line, or of the first."""
    every, drawn = sheets(illuminance), {}
    at = np.column_stack([illuminance[axis].values for axis in "xy"])
    norm = scale(np.ma.masked_invalid(mean.values))
    cuts = dict[int, Figure]()
    for k, sheet in enumerate(every if line else every[:MOST_SHEETS], start=1):
        here = mean[sheet.sensors]
        lines = outlines_in_plan(case, at[sheet.sensors], sheet)
        outlines = {kind: lines.get(kind, ()) for kind in ("room", "glazing")}
        where = f"; plan {k} of {len(every)}" if len(every) > 1 else ""
        if k <= MOST_SHEETS and sheet.faces_up and forms_rows(here):
            number = f"_{k}" if len(every) > 1 else ""
            drawn[f"illuminance_mountain{number}.png"] = mountain(
                here, norm=norm, title=title + where, caption=caption, **outlines
            ).figure
        ends = line or through_middle(here, _inwards(at[sheet.sensors], outlines["glazing"]))
        if meets(here, *ends) if line else k == 1 and not np.array_equal(*ends):
            error = illuminance.get("total_se")
            if error is not None:
                error = luminance(error).mean("time")[sheet.sensors]
            band = "; band: 95 % interval at most, as if errors of all hours had one sign"
            cuts[k] = section(
                here, error, start=ends[0], end=ends[1], title=title + where,
                caption=caption + band * (error is not None),
            ).figure  # fmt: skip
    if line and not cuts:
        sensors_along(mean, *line)  # which says where sensors stand
    for k, figure in cuts.items():
        number = f"_{k}" if len(cuts) > 1 else ""
        drawn[f"illuminance_section{number}.png"] = figure
    return drawn


def _inwards(at: np.ndarray, glazing: Sequence[np.ndarray]) -> np.ndarray:
    """Direction x, y away from the first line of glazing, or else along the longer side."""
    if not len(glazing):
        return np.eye(2)[np.argmax(np.ptp(at, axis=0))]
    pane = np.asarray(glazing[0], float)
    along = pane[-1] - pane[0] if len(pane) == 2 else pane[1] - pane[0]
    inwards = np.array([-along[1], along[0]])
    return inwards * (1 if (at.mean(axis=0) - pane.mean(axis=0)) @ inwards >= 0 else -1)
