"""Plans of several façades of one room side by side, in the same colours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report.captions import place_and_period
from drcmitsuba.report.colour_scale import scale
from drcmitsuba.report.figures import stamps_above
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.plan_view import closed, draw_lines, view_of
from drcmitsuba.report.sensor_marks import SensorMarks
from drcmitsuba.report.sheets import MOST_SHEETS, Sheet, sheets
from drcmitsuba.report.style import COLOURS, GREY, NAME, ORANGE
from drcmitsuba.runtime.errors import on_a_line

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
WALLS = "room", "glazing"
"""Outlines that plans show."""


@dataclass(frozen=True, eq=False)
class FacadeOfPicture:
    """A façade as pictures side by side show it: light by point, and numbers."""

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
    ) -> FacadeOfPicture:
        """Sum up E of an evaluation, `total` and `direct_sun` (time, sensor) [lx]."""
        t, stamps = case.metrics, illuminance.sizes["time"]
        hours = float(illuminance.attrs.get("step_hours", 1.0))
        enough, in_sun = stamps_above(case, illuminance)
        least = 100 * metrics.autonomy_stamps(t.sda_fraction, stamps) / stamps
        where = place_and_period(case, illuminance, numbers)
        return cls(name, case, 100 * enough / stamps, in_sun * hours, least, numbers, where)


class _PlanKind(NamedTuple):
    """One of the two plans of every façade."""

    name: str
    values: Sequence[np.ndarray]
    """Values of every façade, shape (sensor,) each."""
    norm: Normalize
    limit: float


class _Paper(NamedTuple):
    """Figure on which places are in inches from the upper left corner."""

    figure: Figure
    width: float
    height: float

    def axes(self, x: float, y: float, width: float, height: float) -> Axes:
        """Add axes of a size whose upper left corner is at a place."""
        bottom = 1 - (y + height) / self.height
        at = x / self.width, bottom, width / self.width, height / self.height
        return self.figure.add_axes(at)

    def write(self, x: float, y: float, text: str, **style: Any) -> None:
        """Write a text whose upper left corner is at a place."""
        self.figure.text(x / self.width, 1 - y / self.height, text, va="top", **NAME, **style)


class _Room(NamedTuple):
    """Marks of the sensors, and the view, that the plans of all façades share."""

    marks: Sequence[SensorMarks]
    view: np.ndarray
    """Lower left and upper right corner x, y [m]."""

    @classmethod
    def of(cls, values: xr.DataArray, outlines: Sequence[Mapping[str, Any]]) -> _Room:
        """Marks of the sensors of values (sensor,), and a view of them and all walls."""
        grids = sensors_by_grid(values) or {"": np.arange(values.size)}
        marks = [SensorMarks.of(name, at, values.isel(sensor=at)) for name, at in grids.items()]
        walls = [line for lines in outlines for kind in WALLS for line in lines.get(kind, ())]
        return cls(marks, view_of(np.concatenate([*(mark.extent for mark in marks), *walls])))

    @property
    def size(self) -> np.ndarray:
        """Width and height of a plan [inch]."""
        across = self.view[1] - self.view[0]
        return np.asarray(LONGEST * across / across.max())

    def draw(
        self,
        ax: Axes,
        values: np.ndarray,
        kind: _PlanKind,
        lines: Mapping[str, Sequence[np.ndarray]],
    ) -> None:
        """Draw the plan of values (sensor,) with the outlines of a façade."""
        ax.set(xlim=self.view[:, 0], ylim=self.view[:, 1])
        ax.set_axis_off()
        numbers, norm = np.ma.masked_invalid(values), kind.norm
        inch = float(self.size[0] / np.ptp(self.view[:, 0]))
        for mark in self.marks:
            mark.draw(ax, np.ma.clip(numbers, norm.vmin, norm.vmax), norm, inch)
        limit = [edge for mark in self.marks for edge in mark.boundary(numbers >= kind.limit)]
        walls = {name: lines.get(name, ()) for name in WALLS}
        walls["room"] = [closed(line) for line in walls["room"]]
        draw_lines(ax, {**walls, "limit": limit}, thin=0.5)


def side_by_side(facades: Sequence[FacadeOfPicture]) -> dict[str, Figure]:
    """Draw the plans of façades that have the same sensors.

    Parameters
    ----------
    facades : sequence of FacadeOfPicture

    Returns
    -------
    dict of str to Figure
        Pictures by file name, one for each sheet of the plans and `MOST` façades.

    Examples
    --------
    >>> from drcmitsuba.annual.variants import evaluate_variants, load_variants
    >>> from drcmitsuba.report.side_by_side import FacadeOfPicture, side_by_side
    >>> cases = load_variants("office.toml", ["film_office"])
    >>> facades = [
    ...     FacadeOfPicture.of(result.case.name, result.case, result.illuminance, result.metrics)
    ...     for result in evaluate_variants(cases)
    ... ]
    >>> figure = side_by_side(facades)["variants.png"]
    """
    every = sheets(facades[0].enough.coords.to_dataset())[:MOST_SHEETS]
    pages = [facades[i : i + MOST] for i in range(0, len(facades), MOST)]
    drawn = [_picture(page, sheet) for sheet in every for page in pages]
    names = [f"variants_{k}.png" for k in range(1, len(drawn) + 1)]
    return dict(zip(names if len(drawn) > 1 else ["variants.png"], drawn, strict=True))


def _picture(facades: Sequence[FacadeOfPicture], sheet: Sheet) -> Figure:
    """Draw façades on one sheet: hours with enough light, and beside them hours in the sun."""
    first, here = facades[0], sheet.sensors
    at = np.column_stack([first.enough[axis].values for axis in "xy"])[here]
    outlines = [outlines_in_plan(facade.case, at, sheet) for facade in facades]
    room, kinds = _Room.of(first.enough[here], outlines), _kinds(facades, here)
    width, height = room.size
    wide, high = 2 * width + BETWEEN + APART, height + ABOVE
    columns = min(len(facades), max(1, round(math.sqrt(SHAPE * len(facades) * high / wide))))
    rows = -(-len(facades) // columns)
    size = max(columns * wide + APART, LEAST), HEAD + rows * high + FOOT
    paper = _Paper(Figure(figsize=size), *size)
    paper.write(APART, 0.12, f"{len(facades)} façades", fontsize=11, weight="bold")
    paper.write(APART, 0.36, first.where, fontsize=8, color=GREY)
    for i, (facade, lines) in enumerate(zip(facades, outlines, strict=True)):
        x, y = APART + wide * (i % columns), HEAD + high * (i // columns)
        name = on_a_line(facade.name)[: int(LETTERS * (2 * width + BETWEEN))]
        paper.write(x, y, name, fontsize=8.5, weight="bold")
        for kind, metric in zip(kinds, ("sDA", "ASE"), strict=True):
            share = f"{metric} {facade.numbers[metric]['value']:.0f} %"
            paper.write(x, y + 0.16, share, fontsize=8, color=GREY)
            room.draw(paper.axes(x, y + ABOVE - 0.16, width, height), kind.values[i], kind, lines)
            x += width + BETWEEN
    long = (paper.width - 3 * APART) / 2
    for k, kind in enumerate(kinds):
        bar = paper.axes(APART + k * (long + APART), paper.height - FOOT + 0.1, long, 0.12)
        scalars = ScalarMappable(kind.norm, COLOURS)
        paper.figure.colorbar(scalars, cax=bar, orientation="horizontal", label=kind.name)
        bar.axvline(kind.limit, color=ORANGE, linewidth=2)
    return paper.figure


def _kinds(facades: Sequence[FacadeOfPicture], here: np.ndarray) -> list[_PlanKind]:
    """Plans of every façade with the scales that they have in common."""
    t = facades[0].case.metrics
    enough, in_sun = (
        [getattr(facade, name).values[here].astype(float) for facade in facades]
        for name in ("enough", "in_sun")
    )
    hours = scale(np.ma.masked_invalid(np.concatenate(in_sun)), None, t.ase_hours)
    return [
        _PlanKind(
            f"hours with {t.sda_threshold:g} lx [%]", enough, Normalize(0, 100), facades[0].least
        ),
        _PlanKind(
            f"hours with {t.ase_threshold:g} lx of direct sun [h]", in_sun, hours, t.ase_hours
        ),
    ]
