"""Section plots: values along a line through the sensors, with their intervals."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from drcmitsuba.report.colour_scale import label_of
from drcmitsuba.report.plan_view import positions
from drcmitsuba.report.style import BLUE, head, new_axes, tidy
from drcmitsuba.report.tiles import neighbour_distance
from drcmitsuba.runtime.errors import InputError

NORMAL_95 = 1.959964
"""Half the width of a 95 % interval over the standard error."""


def section(
    values: xr.DataArray, error: xr.DataArray | None = None, *,
    start: ArrayLike, end: ArrayLike, ax: Axes | None = None, title: str = "",
    caption: str = "", label: str | None = None, name: str = "", colour: str = BLUE,
    marker: str = "o",
) -> Axes:  # fmt: skip
    """Draw values along a line through the plan, with their 95 % intervals.

    Parameters
    ----------
    values : DataArray (sensor,)
        Illuminance [lx] or another quantity with the coordinates `x` and `y` [m].
    error : DataArray (sensor,), optional
        Standard error of `values` in the same unit: the band is ±1.96 of it.
    start, end : array_like of 2 floats
        Ends x, y of the line [m]. The sensors nearest to it count, up to half the distance of
        neighbours away.
    ax : Axes, optional
        Axes to draw on, beside lines that are there; those of a new figure by default.
    title, caption : str
        Case, metric and period; place, weather and accuracy in small letters below.
    label : str, optional
        Text at the vertical axis; the long name and units of `values` by default.
    name : str
        Name of the line, for a legend.
    colour, marker : str
        Colour and marks of the line.

    Returns
    -------
    Axes
        Its last line has the distances from `start` [m] and the values of the sensors.

    Raises
    ------
    InputError
        No sensor stands on the line, or its ends are the same.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> mean = result.illuminance["total"].mean("time", keep_attrs=True)
    >>> from drcmitsuba.report.section import through_middle
    >>> start, end = through_middle(mean, direction=(0, 1))
    >>> axes = plots.section(mean, start=start, end=end, name="mean of the year")
    """
    sensors, distance = sensors_along(values, start, end)
    is_new = ax is None
    ax = new_axes((6.8, 4.4)) if ax is None else ax
    line = values.values[sensors].astype(float)
    if error is not None:
        half = NORMAL_95 * error.values[sensors].astype(float)
        ax.fill_between(distance, line - half, line + half, color=colour, alpha=0.25, linewidth=0)
    ax.plot(distance, line, marker=marker, color=colour, linewidth=1.8, markersize=4.5, label=name)
    if is_new:
        here, there = (f"({x:g}, {y:g}) m" for x, y in np.array([start, end]))
        ax.set_xlabel(f"distance from {here} towards {there} [m]")
        ax.set_ylabel(label_of(values) if label is None else label)
        ax.set_ylim(min(0.0, np.nanmin(line)), None)
        tidy(ax, "#DDDDDD")
        head(ax, title, caption)
    return ax


def sensors_along(
    values: xr.DataArray, start: ArrayLike, end: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Find the sensors on a line from `start` to `end`, x, y each [m].

    Returns
    -------
    tuple of np.ndarray
        Indices of the sensors, and their distances from `start` along the line [m], increasing.
        Of several at one distance the nearest to the line counts.
    """
    order, along = _on_line(values, start, end)
    if not len(order):
        at = np.column_stack(positions(values))
        begin, last = np.asarray(start, float), np.asarray(end, float)
        x, y = at[np.argmin(np.hypot(*(at - (begin + last) / 2).T))]
        got = f"no sensor from {begin[0]:g}, {begin[1]:g} to {last[0]:g}, {last[1]:g}"
        remedy = f"draw it through sensors; one stands at {x:g}, {y:g}"
        raise InputError("section", "line", got, remedy)
    return order, along


def meets(values: xr.DataArray, start: ArrayLike, end: ArrayLike) -> bool:
    """Whether a line from `start` to `end`, x, y each [m], meets a sensor."""
    return len(_on_line(values, start, end)[0]) > 0


def _on_line(
    values: xr.DataArray, start: ArrayLike, end: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Sensors on a line, as `sensors_along`; none where none stands there."""
    at = np.column_stack(positions(values))
    begin, last = np.asarray(start, float), np.asarray(end, float)
    line = last - begin
    length = float(np.hypot(*line))
    if not (np.isfinite([*begin, *line]).all() and length > 0):
        got = f"from {begin.tolist()} to {last.tolist()}"
        raise InputError("section", "line", got, "give two places x, y in metres")
    along = (at - begin) @ line / length
    beside = np.abs((at - begin) @ np.array([-line[1], line[0]]) / length)
    near = neighbour_distance(at)
    close = (beside <= near / 2) & (along >= -1e-9) & (along <= length + 1e-9)
    order = np.flatnonzero(close)[np.lexsort((beside[close], along[close].round(6)))]
    first = np.diff(along[order].round(6), prepend=-np.inf) > 0
    return order[first], along[order[first]]


def through_middle(values: xr.DataArray, direction: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Ends x, y [m] of a line through the middlemost sensor, from the first sensor to the last.

    The direction is x, y, of any length.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> mean = result.illuminance["total"].mean("time", keep_attrs=True)
    >>> from drcmitsuba.report.section import through_middle
    >>> start, end = through_middle(mean, direction=(0, 1))
    >>> len(start), len(end)
    (2, 2)
    """
    at = np.column_stack(positions(values))
    ahead = np.asarray(direction, float)
    ahead /= np.linalg.norm(ahead)
    middle = at[np.argmin(((at - (at.min(axis=0) + at.max(axis=0)) / 2) ** 2).sum(axis=1))]
    along = (at - middle) @ ahead
    return middle + along.min() * ahead, middle + along.max() * ahead
