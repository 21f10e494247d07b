"""Plans of several façades of one room side by side, in the same colours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report.captions import place_and_period
from drcmitsuba.report.colour_scale import scale
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.plan_view import closed, draw_lines, view_of
from drcmitsuba.report.sensor_marks import SensorMarks
from drcmitsuba.report.sheets import MOST_SHEETS, Sheet, sheets
from drcmitsuba.report.style import COLOURS, GREY, NAME, ORANGE
from drcmitsuba.runtime.errors import on_a_line
from drcmitsuba.schema import luminance

MOST = 24
"""Largest number of façades on a picture."""
LONGEST, BETWEEN, APART, ABOVE = 1.8, 0.12, 0.4, 0.5
"""Longest side of a plan; space between the two of a façade, between façades, and above [inch]."""
HEAD, FOOT, LEAST = 0.7, 0.75, 6.0
"""Height of the head and of the foot with the scales, and least width of a picture [inch]."""
SHAPE = 1.4
"""Width over height of a picture, about."""
LETTERS = 13
"""Letters of a façade's name on an inch of paper."""


@dataclass(frozen=True, eq=False)
class FacadeShares:
    """Light of a façade by point."""

    name: str
    case: Case
    enough: xr.DataArray
    """Share of the hours with enough light [%], (sensor,)."""
    in_sun: xr.DataArray
    """Hours in direct sun [h], (sensor,)."""
    least: float
    """Share of the hours from which on a point counts for sDA [%]."""
    numbers: Mapping[str, Any]
    """As in `metrics.json`."""
    where: str
    """Place and period."""

    @classmethod
    def of(
        cls, name: str, case: Case, illuminance: xr.Dataset, numbers: Mapping[str, Any]
    ) -> FacadeShares:
        """Sum up E of an evaluation, `total` and `direct_sun` (time, sensor) [lx]."""
        t, stamps = case.metrics, illuminance.sizes["time"]
        hours = float(illuminance.attrs.get("step_hours", 1.0))
        enough = (luminance(illuminance["total"]) >= t.sda_threshold).sum("time")
        in_sun = (luminance(illuminance["direct_sun"]) >= t.ase_threshold).sum("time")
        least = 100 * metrics.autonomy_stamps(t.sda_fraction, stamps) / stamps
        where = place_and_period(case, illuminance, numbers)
        return cls(name, case, 100 * enough / stamps, in_sun * hours, least, numbers, where)


class _Kind(NamedTuple):
    """One of the two plans of every façade."""

    name: str
    values: Sequence[np.ndarray]
    """Of every façade, shape (sensor,)."""
    norm: Normalize
    limit: float


def side_by_side(facades: Sequence[FacadeShares]) -> dict[str, Figure]:
    """Draw the plans of façades that have the same sensors.

    Parameters
    ----------
    facades : sequence of FacadeShares

    Returns
    -------
    dict of str to Figure
        Pictures by file name, one for each sheet of the plans and `MOST` façades.

    Examples
    --------
    >>> from drcmitsuba.annual.variants import evaluate_variants, load_variants
    >>> from drcmitsuba.report.side_by_side import FacadeShares, side_by_side
    >>> cases = load_variants("office.toml", ["film_office"])
    >>> results = evaluate_variants(cases)
    >>> shares = [FacadeShares.of(r.case.name, r.case, r.illuminance, r.metrics) for r in results]
    >>> figure = side_by_side(shares)["variants.png"]
    """
    every = sheets(facades[0].enough.coords.to_dataset())[:MOST_SHEETS]
    pages = [facades[i : i + MOST] for i in range(0, len(facades), MOST)]
    drawn = [_picture(page, sheet) for sheet in every for page in pages]
    names = [f"variants_{k}.png" for k in range(1, len(drawn) + 1)]
    return dict(zip(names if len(drawn) > 1 else ["variants.png"], drawn, strict=True))


def _picture(facades: Sequence[FacadeShares], sheet: Sheet) -> Figure:
    """Draw façades on one sheet: hours with enough light, and beside them hours in the sun."""
    first, here = facades[0], sheet.sensors
    values = first.enough[here]
    grids = sensors_by_grid(values) or {"": np.arange(len(here))}
    marks = [SensorMarks.of(name, at, values.isel(sensor=at)) for name, at in grids.items()]
    at = np.column_stack([first.enough[axis].values for axis in "xy"])
    outlines = [outlines_in_plan(facade.case, at[here], sheet) for facade in facades]
    walls = [
        line for lines in outlines for line in (*lines.get("room", ()), *lines.get("glazing", ()))
    ]
    view = view_of(np.concatenate([*(mark.extent for mark in marks), *walls]))
    width, height = LONGEST * (view[1] - view[0]) / (view[1] - view[0]).max()
    wide, high = 2 * width + BETWEEN + APART, height + ABOVE
    columns = min(len(facades), max(1, round(math.sqrt(SHAPE * len(facades) * high / wide))))
    rows = -(-len(facades) // columns)
    across, down = max(columns * wide + APART, LEAST), HEAD + rows * high + FOOT
    figure = Figure(figsize=(across, down))

    def place(x: float, y: float, w: float, h: float) -> tuple[float, float, float, float]:
        """Part of the figure, from inches from its upper left corner."""
        return x / across, 1 - (y + h) / down, w / across, h / down

    def write(x: float, y: float, text: str, **style: Any) -> None:
        figure.text(x / across, 1 - y / down, text, va="top", **NAME, **style)

    kinds = _kinds(facades, here)
    write(APART, 0.12, f"{len(facades)} façades", fontsize=11, weight="bold")
    write(APART, 0.36, first.where, fontsize=8, color=GREY)
    for i, (facade, lines) in enumerate(zip(facades, outlines, strict=True)):
        left, top = APART + wide * (i % columns), HEAD + high * (i // columns)
        name = on_a_line(facade.name)[: int(LETTERS * (2 * width + BETWEEN))]
        numbers = (f"{n} {facade.numbers[n]['value']:.0f} %" for n in ("sDA", "ASE"))
        write(left, top, name, fontsize=8.5, weight="bold")
        for k, (kind, number) in enumerate(zip(kinds, numbers, strict=True)):
            x = left + k * (width + BETWEEN)
            write(x, top + 0.16, number, fontsize=8, color=GREY)
            ax = figure.add_axes(place(x, top + ABOVE - 0.16, width, height))
            ax.set(xlim=view[:, 0], ylim=view[:, 1])
            ax.set_axis_off()
            numbers_here = np.ma.masked_invalid(kind.values[i])
            for mark in marks:
                mark.draw(ax, np.ma.clip(numbers_here, kind.norm.vmin, kind.norm.vmax), kind.norm,
                          width / np.ptp(view[:, 0]))  # fmt: skip
            limit = [edge for mark in marks for edge in mark.boundary(numbers_here >= kind.limit)]
            shown = {
                "room": [closed(line) for line in lines.get("room", ())],
                "glazing": lines.get("glazing", ()),
            }
            draw_lines(ax, {**shown, "limit": limit}, thin=0.5)
    for k, kind in enumerate(kinds):
        long = (across - 3 * APART) / 2
        bar = figure.add_axes(place(APART + k * (long + APART), down - FOOT + 0.1, long, 0.12))
        colours = ScalarMappable(kind.norm, COLOURS)
        figure.colorbar(colours, cax=bar, orientation="horizontal", label=kind.name)
        bar.axvline(kind.limit, color=ORANGE, linewidth=2)
    return figure


def _kinds(facades: Sequence[FacadeShares], here: np.ndarray) -> list[_Kind]:
    """Plans of every façade with the scales that they have in common."""
    t = facades[0].case.metrics
    enough, in_sun = (
        [getattr(facade, name).values[here].astype(float) for facade in facades]
        for name in ("enough", "in_sun")
    )
    hours = scale(np.ma.masked_invalid(np.concatenate(in_sun)), None, t.ase_hours)
    return [
        _Kind(
            f"hours with {t.sda_threshold:g} lx [%]", enough, Normalize(0, 100), facades[0].least
        ),
        _Kind(f"hours with {t.ase_threshold:g} lx of direct sun [h]", in_sun, hours, t.ase_hours),
    ]
