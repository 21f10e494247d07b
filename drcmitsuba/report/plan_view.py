"""Plans of the room with one value for each sensor, in false colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report import tiles
from drcmitsuba.report.colour_scale import colour_bar, label_of, scale
from drcmitsuba.report.plan_sheet import PlanSheet
from drcmitsuba.report.sensor_marks import SensorMarks
from drcmitsuba.report.style import INK, LETTER, LINES, NAME, halo
from drcmitsuba.runtime.errors import InputError

LEGIBLE = 0.5
"""Least distance of sensors on paper [inch] at which their values are written."""
LINE = 1.2
"""Height of a line over the size of its letters [–]."""
SCALES = Normalize, LogNorm
"""Scales of colours that their limits decide."""
SMALLEST = 4.5
"""Size of the smallest letters that are written on a grid [pt]."""


def plan(
    values: xr.DataArray,
    *,
    title: str = "",
    caption: str = "",
    label: str | None = None,
    room: Sequence[np.ndarray] = (),
    furniture: Sequence[np.ndarray] = (),
    surroundings: Sequence[np.ndarray] = (),
    glazing: Sequence[np.ndarray] = (),
    norm: Normalize | None = None,
    limit: float | None = None,
    limit_label: str = "limit",
    contours: Sequence[float] = (),
    texts: Mapping[str, str] = MappingProxyType({}),
) -> Figure:
    """Plan of the room with one value for each sensor in false colours, north up.

    Parameters
    ----------
    values : DataArray (sensor,)
        Illuminance [lx], or another quantity such as a share of hours [%], with the coordinates
        `x` and `y` [m]; `grid`, where there are several; `nx`, `ny`, `nz`, where not all sensors
        face up. NaN is left blank.
    title : str
        Quantity shown, above the plan.
    caption : str
        Weather, period and accuracy, in small letters below the title.
    label : str, optional
        Text at the colour bar; the long name and units of `values` by default.
    room, furniture, surroundings : sequence of arrays (n, 2)
        Outlines x, y [m], closed or not. Rooms and sensors set the picture's extent; surroundings
        are drawn within it.
    glazing : sequence of arrays (n, 2)
        Lines x, y [m] along the glazing.
    norm : matplotlib.colors.Normalize, optional
        Scale of the colours, `LogNorm(10, 10_000)` for example; from 0 to the largest value by
        default. Values beyond its limits take the colour of the limit.
    limit : float, optional
        Least value at which a sensor counts, in the unit of `values`: a line separates tiles of
        sensors that count from the others, another line marks the limit on the colour bar.
    limit_label : str
        Name of the limit's line in the legend.
    contours : sequence of float
        Values along which lines are drawn between the sensors of each grid, in increasing order.
    texts : mapping of str to str
        Lines of text to write on grids, by the grid's name.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        `values` has other dims than `sensor`, or no coordinates `x` and `y`.

    Notes
    -----
    Sensors of a grid that is rectangular, turned or with gaps, become tiles that end half way to
    the next sensor; all others become discs, and arrows along their normals where these do not
    face up.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> mean = result.illuminance["total"].mean("time", keep_attrs=True)
    >>> figure = plots.plan(mean, contours=(300, 500, 1000))
    """
    x, y = positions(values)
    numbers = np.ma.masked_invalid(np.asarray(values.values, dtype=float))
    norm = scale(numbers, norm, limit)
    marks = [
        SensorMarks.of(name, sensors, values.isel(sensor=sensors))
        for name, sensors in (sensors_by_grid(values) or {"": np.arange(len(x))}).items()
    ]
    extent = np.concatenate([mark.extent for mark in marks])
    lines = {
        "furniture": [closed(outline) for outline in furniture],
        "surroundings": [closed(outline) for outline in surroundings],
        "room": [closed(outline) for outline in room],
        "glazing": [np.asarray(line, dtype=float) for line in glazing],
    }
    view = view_of(np.concatenate([extent, *(lines["room"] or lines["glazing"])]))
    low, high = view
    for name, kind in lines.items():
        lines[name] = [
            line for line in kind if (line.min(0) < high).all() and (line.max(0) > low).all()
        ]
    if limit is not None:
        lines["limit"] = [edge for mark in marks for edge in mark.boundary(numbers >= limit)]
    keys = {name: name for name, kind in lines.items() if kind}
    if limit is not None:  # the colour bar marks it, too
        keys["limit"] = limit_label

    figure, ax, bar = PlanSheet.begun(view, title, caption, tuple(keys.items()))
    inch = ax.get_position().width * figure.get_figwidth() / np.ptp(ax.get_xlim())
    shown = np.ma.clip(numbers, norm.vmin, norm.vmax)
    for mark in marks:
        picture = mark.draw(ax, shown, norm, inch)
    lined = marks if len(contours) else []
    of_lines = [text for mark in lined for text in mark.contours(ax, numbers, contours)]
    draw_lines(ax, lines)
    if texts:
        boxes = _write_texts(ax, marks, texts, inch)
        for line in of_lines:  # a name hides those of lines that it stands on
            away = abs(boxes[:, 0] - line.get_position()) - np.array([12, 6]) / 72 / inch
            line.set_visible(not (away < boxes[:, 1]).all(axis=1).any())
    elif tiles.closest(x, y) * inch >= LEGIBLE:
        _write_numbers(ax, marks, numbers, norm)
    extend = colour_bar(picture, numbers, bar).extend
    if limit is not None:
        bar.axhline(limit, **LINES["limit"])
    words = label_of(values) if label is None else label
    bar.set_ylabel(words)
    if type(norm) in SCALES:
        figure.also_stands((type(norm), norm.vmin, norm.vmax, extend, limit, words), bar)
    return figure


def positions(values: xr.DataArray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates x and y of the sensors [m], shape (sensor,) each."""
    if values.dims != ("sensor",) or values.size == 0:
        dims = ", ".join(f"{dim}: {size}" for dim, size in values.sizes.items())
        raise InputError("plan", "dims", dims or "none", "give one value for each sensor")
    for key in ("x", "y"):
        if key not in values.coords or values[key].dims != ("sensor",):
            raise InputError("plan", key, "no such coordinate of sensor", "give x and y in metres")
    return values["x"].values.astype(float), values["y"].values.astype(float)


def closed(polygon: np.ndarray) -> np.ndarray:
    """Outline that ends where it began, shape (point, 2)."""
    points = np.asarray(polygon, dtype=float)
    return np.concatenate([points, points[:1]])


def view_of(points: np.ndarray) -> np.ndarray:
    """Lower left and upper right corner x, y [m] of a view of all points, with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = (high - low) * 1.06
    size = np.maximum(size, size.max() / 2.5)  # a corridor still leaves room for the colour bar
    return (low + high) / 2 + np.array([[-0.5], [0.5]]) * size


def draw_lines(ax: Axes, lines: Mapping[str, Sequence[np.ndarray]], thin: float = 1.0) -> None:
    """Draw each kind as one line with gaps: a hundred thousand desks would take minutes.

    Lines of small plans are `thin`, a part of their width.
    """
    gap = np.full((1, 2), np.nan)
    for name, kind in lines.items():
        if kind:
            broken = np.concatenate([piece for line in kind for piece in (line, gap)])
            style = LINES[name] | {"linewidth": thin * LINES[name]["linewidth"]}
            if thin < 1 and "path_effects" in style:
                style["path_effects"] = halo(1.8 * style["linewidth"], "white")
            ax.plot(*broken.T, scalex=False, scaley=False, **style)


def _write_numbers(
    ax: Axes, marks: Sequence[SensorMarks], numbers: np.ma.MaskedArray, norm: Any
) -> None:
    """Write each sensor's value on it, dark on the bright end of the colours and on arrows."""
    digits = 0 if abs(numbers).max() >= 100 else 1
    for mark in marks:
        for i, place in zip(mark.sensors.tolist(), mark.at, strict=True):
            if np.ma.is_masked(numbers[i]):
                continue
            style: dict[str, Any] = {"color": INK if norm(numbers[i]) > 0.6 else "white"}
            if mark.normal is not None:
                style = {"color": INK, "path_effects": halo(2.4, "white")}
            text = f"{numbers[i]:.{digits}f}"
            ax.text(*place, text, ha="center", va="center", fontsize=8, **style)


def _write_texts(
    ax: Axes, marks: Sequence[SensorMarks], texts: Mapping[str, str], inch: float
) -> np.ndarray:
    """Write a text on each grid in letters that fit into it, its last line alone in a small one.

    `inch` is the length of a metre on paper [inch]. Middles and half sizes of the texts are
    returned [m], shape (text, 2, 2).
    """
    boxes = [np.zeros((0, 2, 2))]
    for mark in marks:
        low, high = mark.extent.min(axis=0), mark.extent.max(axis=0)
        lines = texts.get(mark.name, "").split("\n")
        for written in (lines, lines[-1:]):
            wide = LETTER * max(map(len, written))
            size = 72 * inch * min((high - low)[0] / max(wide, 1), (high - low)[1] / 3)
            if size >= SMALLEST:
                size = min(size, 10)
                ax.text(
                    *mark.middle, "\n".join(written), ha="center", va="center", color=INK,
                    fontsize=size, weight="bold", path_effects=halo(2.4, "white"), **NAME,
                )  # fmt: skip
                half = np.array([wide, LINE * len(written)]) * size / 144 / inch
                boxes.append(np.stack([mark.middle, half])[None])
                break
    return np.concatenate(boxes)
