"""Pictures of results: plans of the room in false colours, and the metrics of a year.

Figures are made without pyplot: nothing global changes, no window opens, and they can be made in
any thread. Colours are told apart by colour-blind readers [1]_.

References
----------
.. [1] M. Okabe, K. Ito, "Color universal design: how to make figures and presentations that are
   friendly to colorblind people", 2008.
.. [2] C. Bauer, S. Wittkopf, "Annual daylight simulations with EvalDRC", Journal of Facade Design
   and Engineering 3, 2015, figure 11.
"""

from __future__ import annotations

import copy
import os
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator

from drcmitsuba.runtime.errors import InputError

BLUE, ORANGE, GREY, INK = "#0072B2", "#D55E00", "#5A5A5A", "#222222"
ACCEPTED, PREFERRED = 55, 75  # sDA [%] by LM-83: nominally accepted, preferred
LEGIBLE = 0.5  # sensors so far apart on paper [inch] have their values written on them
HALO = [withStroke(linewidth=2.4, foreground=INK)]
LINES: dict[str, dict[str, Any]] = {
    "room": {"color": INK, "linewidth": 1.8, "solid_joinstyle": "miter"},
    "furniture": {"color": "white", "linewidth": 1.0, "path_effects": HALO},
    "glazing": {"color": "#56B4E9", "linewidth": 4, "solid_capstyle": "butt"},
}
NAME = {"parse_math": False}  # a case's name is no formula, whatever dollars it holds
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def plan(
    values: xr.DataArray,
    *,
    title: str = "",
    label: str | None = None,
    room: Sequence[np.ndarray] = (),
    desks: Sequence[np.ndarray] = (),
    facade: Sequence[np.ndarray] = (),
    norm: Normalize | None = None,
) -> Figure:
    """Plan of the room with one value for each sensor in false colours, north up.

    Parameters
    ----------
    values : DataArray (sensor,)
        Illuminance [lx], or another quantity such as a share of hours [%], with the coordinates
        `x` and `y` [m]. NaN is left blank.
    title : str
        What is shown, above the plan.
    label : str, optional
        Text at the colour bar; the long name and units of `values` by default.
    room, desks : sequence of arrays (n, 2)
        Outlines x, y [m] of the room and of the furniture, closed or not.
    facade : sequence of arrays (n, 2)
        Lines x, y [m] along the glazing.
    norm : matplotlib.colors.Normalize, optional
        Scale of the colours, `LogNorm(10, 10_000)` for example; from 0 to the largest value by
        default. What lies beyond its limits takes the colour of the limit.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        Other dims than `sensor`, or no `x` and `y`.

    Notes
    -----
    Sensors on a rectangular grid, turned or with gaps, become tiles that reach half way to the
    next sensor; all others become discs.
    """
    x, y = _positions(values)
    numbers = np.ma.masked_invalid(np.asarray(values.values, dtype=float))
    norm = copy.copy(norm) if norm else Normalize(min(0.0, numbers.min()), numbers.max() or 1.0)
    norm.autoscale_None(numbers)
    tiles = _tiles(x, y)
    reach = tiles[0].reshape(-1, 2) if tiles else _around(x, y)
    lines = {
        "furniture": [_closed(desk) for desk in desks],
        "room": [_closed(outline) for outline in room],
        "glazing": [np.asarray(line, dtype=float) for line in facade],
    }
    all_lines = [line for kind in lines.values() for line in kind]
    figure, ax, bar = _sheet(np.concatenate([reach, *all_lines]), title, legend=bool(all_lines))

    inch = ax.get_position().width * figure.get_figwidth() / np.ptp(ax.get_xlim())
    shown = np.ma.clip(numbers, norm.vmin, norm.vmax)
    colours: dict[str, Any] = {"cmap": "viridis", "norm": norm}
    if tiles:
        edges, at = tiles
        grid = np.ma.masked_all(np.subtract(edges.shape[:2], 1))
        grid[at] = shown
        picture: Any = ax.pcolormesh(*edges.T, grid.T, **colours, rasterized=True)
    else:
        points = 0.6 * _spacing(x, y) * inch * 72
        picture = ax.scatter(x, y, points**2, shown, edgecolor="white", linewidth=0.5, **colours)
    gap = np.full((1, 2), np.nan)
    for name, kind in lines.items():
        if kind:  # as one line with gaps: a hundred thousand desks would take minutes
            broken = np.concatenate([piece for line in kind for piece in (line, gap)])
            ax.plot(*broken.T, **LINES[name])
    if any(lines.values()):
        keys = [Line2D([], [], label=name, **LINES[name]) for name, kind in lines.items() if kind]
        corner = (ax.get_position().x0, 0)
        figure.legend(
            handles=keys, loc=3, bbox_to_anchor=corner, ncols=3, frameon=False, fontsize=9
        )
    if _closest(x, y) * inch >= LEGIBLE:
        _write(ax, x, y, numbers, norm)

    below, above = bool((numbers < shown).any()), bool((numbers > shown).any())
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]
    figure.colorbar(picture, cax=bar, extend=extend)
    if isinstance(norm, LogNorm):  # 200, 500, 1000 rather than powers of ten
        bar.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        bar.yaxis.set_major_formatter("{x:g}")
        bar.minorticks_off()
    bar.set_ylabel(_label(values) if label is None else label)
    return figure


def monthly(metrics: Mapping[str, Any], *, title: str = "") -> Figure:
    """Annual metrics as bars and monthly metrics as lines, like figure 11 of [2].

    Parameters
    ----------
    metrics : mapping
        As in `metrics.json`: `sDA`, `ASE`, `shade_closed` as `{"value", "low", "high"}` [%], and
        `msDA`, `MSE`, `shade_closed_monthly` as 12 of these, None for a month without hours.
    title : str
        Name of the case, above the panels.

    Returns
    -------
    Figure
        Error bars and light bands are 95 % intervals.
    """
    figure = Figure(figsize=(9.6, 4.3))
    year, months = figure.subplots(1, 2, width_ratios=[1, 2.6])
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.1, top=0.8, wspace=0.42)
    figure.text(0.075, 0.955, title, fontsize=12, weight="bold", va="center", color=INK, **NAME)
    for ax, name in ((year, "year"), (months, "months")):
        ax.set_title(name, loc="left", fontsize=10, color=GREY, pad=24)
        ax.set_ylim(0, 100)
        ax.set_yticks(range(0, 101, 10))
        ax.grid(axis="y", color="#E4E4E4", linewidth=0.7)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)

    for at, (name, colour) in enumerate((("sDA", BLUE), ("ASE", ORANGE))):
        _bar(year, at, metrics[name], colour)
    year.set(xlim=(-0.6, 1.6), ylabel="share of sensors [%]")
    year.set_xticks([0, 1], ["sDA", "ASE"])
    year.tick_params(axis="x", length=0)
    for level, name in ((ACCEPTED, "accepted"), (PREFERRED, "preferred")):
        year.axhline(level, color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)))
        text = f"{name}\n(sDA {level} %)"
        year.text(1.65, level, text, fontsize=8, va="center", color=INK, linespacing=1.1)

    closed = f"shade closed for {metrics['shade_closed']['value']:.1f} % of the year's hours"
    months.set_title(closed, loc="right", fontsize=10, color=GREY, pad=24)
    _line(months, metrics["msDA"], "msDA, of sensors", color=BLUE, marker="o")
    _line(months, metrics["MSE"], "MSE, of sensors", color=ORANGE, marker="s")
    _line(
        months,
        metrics["shade_closed_monthly"],
        "shade closed, of hours",
        color=GREY,
        marker=".",
        linestyle="--",
    )
    months.set(xlim=(0.7, 12.3), ylabel="share [%]")
    months.set_xticks(range(1, 13), MONTHS)
    legend = {"ncols": 3, "frameon": False, "fontsize": 9, "borderaxespad": 0.3}
    months.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), borderpad=0, **legend)
    return figure


def season(found: Any) -> Figure:
    """Draw msDA of a façade beside clear glazing and an unobstructed opening.

    Parameters
    ----------
    found : season.Season

    Returns
    -------
    Figure
        Light bands are 95 % intervals.
    """
    figure = Figure(figsize=(9.6, 4.3))
    ax, share = figure.subplots(1, 2, width_ratios=[1.5, 1])
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.1, top=0.8, wspace=0.2)
    style = {"fontsize": 12, "weight": "bold", "va": "center", "color": INK}
    figure.text(0.075, 0.955, found.name, **style, **NAME)
    _line(ax, found.opening, "unobstructed opening, no shade", color=GREY, marker=".")
    _line(ax, found.clear, "clear glazing", color=ORANGE, marker="s")
    _line(ax, found.design, "design", color=BLUE, marker="o")
    ax.set(ylabel="msDA [%]")
    relative = [np.nan if v is None else v for v in found.relative]
    share.bar(np.arange(1, 13), relative, color=BLUE, width=0.7)
    share.set_title("msDA over that of the opening [%]", loc="left", fontsize=10, color=GREY)
    for axes in (ax, share):
        axes.set(xlim=(0.4, 12.6), ylim=(0, max(105.0, np.nanmax([*relative, 0.0]) + 5)))
        axes.set_xticks(range(1, 13), MONTHS)
        axes.grid(axis="y", color="#E4E4E4", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    ax.set_ylim(0, 105)
    share.tick_params(axis="x", labelsize=8)
    legend = {"ncols": 3, "frameon": False, "fontsize": 9, "borderaxespad": 0.3}
    ax.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), borderpad=0, **legend)
    return figure


def write(figure: Figure, file: Path | IO[bytes], dpi: int) -> None:
    """Write a figure as PNG; characters that the font lacks, of a case's name, become boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        figure.savefig(file, format="png", dpi=dpi)


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG, whole or not at all.

    Parameters
    ----------
    figure : Figure
        From `plan` or `monthly`.
    path : path
        File to write; one that is there is replaced once the new one is complete.

    Returns
    -------
    Path
        The file.
    """
    target = Path(path)
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        write(figure, part, dpi=150)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    return target


def _positions(values: xr.DataArray) -> tuple[np.ndarray, np.ndarray]:
    if values.dims != ("sensor",) or values.size == 0:
        dims = ", ".join(f"{dim}: {size}" for dim, size in values.sizes.items())
        raise InputError("plan", "dims", dims or "none", "give one value for each sensor")
    for key in ("x", "y"):
        if key not in values.coords or values[key].dims != ("sensor",):
            raise InputError("plan", key, "no such coordinate of sensor", "give x and y in metres")
    return values["x"].values.astype(float), values["y"].values.astype(float)


def _spacing(x: np.ndarray, y: np.ndarray) -> float:
    """Typical distance of neighbours [m], for sensors that follow no grid."""
    width, depth = np.ptp(x), np.ptp(y)
    return float(np.sqrt(width * depth / len(x)) or max(width, depth) / len(x) or 1.0)


def _closest(x: np.ndarray, y: np.ndarray) -> float:
    """Distance of the closest two sensors [m], 0 where there are too many to write on."""
    if len(x) > 200:
        return 0.0
    distance = np.hypot(x[:, None] - x, y[:, None] - y)
    return float(distance[~np.eye(len(x), dtype=bool)].min(initial=np.inf))


def _around(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Give points around all sensors, half a spacing away."""
    centres, half = np.column_stack([x, y]), _spacing(x, y) / 2
    return np.concatenate([centres - half, centres + half])


def _tiles(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None:
    """Corners [row, column, xy] of a grid's tiles and each sensor's (rows, columns), if one fits.

    A grid's axis is the direction from one sensor to its nearest neighbour.
    """
    if len(x) == 1:
        return None
    distance = np.hypot(x - x[0], y - y[0])
    distance[0] = np.inf
    near = int(distance.argmin())
    if distance[near] == 0:
        return None
    c, s = (x[near] - x[0]) / distance[near], (y[near] - y[0]) / distance[near]
    if abs(c) < abs(s):  # keep rows east-west, so that an upright grid is not turned at all
        c, s = s, -c
    turn = np.array([[c, s], [-s, c]])
    u, v = turn @ [x, y]
    (at_u, column), (at_v, row) = _levels(u, distance[near]), _levels(v, distance[near])
    places = len(at_u) * len(at_v)
    if places > 2 * len(x) or len(np.unique(row * len(at_u) + column)) < len(x):
        return None
    edge_u, edge_v = _edges(at_u, distance[near]), _edges(at_v, distance[near])
    corners = np.stack(np.meshgrid(edge_u, edge_v), axis=-1) @ turn
    return corners, (row, column)


def _levels(u: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Give the distinct coordinates, equal within a tenth of the spacing, and each sensor's own."""
    order = np.argsort(u)
    level = np.empty(len(u), dtype=int)
    level[order] = np.cumsum(np.diff(u[order], prepend=u[order[0]]) > 0.1 * spacing)
    return np.bincount(level, u) / np.bincount(level), level


def _edges(centres: np.ndarray, spacing: float) -> np.ndarray:
    """Edges half way between centres; a single row is as wide as the sensors lie apart."""
    if len(centres) == 1:
        return centres[0] + np.array([-0.5, 0.5]) * spacing
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - between[0]], between, [2 * centres[-1] - between[-1]]])


def _sheet(points: np.ndarray, title: str, legend: bool) -> tuple[Figure, Axes, Axes]:
    """Figure with an axes that shows all points to scale, one for the colour bar, a north arrow.

    The layout is in inches, since only so do the scale of the plan and the size of the text both
    hold for a room of any shape.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    middle, size = (low + high) / 2, (high - low) * 1.06
    size = np.maximum(size, size.max() / 2.5)  # a corridor still leaves room for the colour bar
    width, height = 5.4 * size / size.max()
    left, right, bottom = 0.75, 1.15, 0.6 + 0.35 * legend
    across = max(left + width + right, 5.2)
    heading = textwrap.wrap(title, int((across - left) / 0.1))  # bold letters are 0.09 inch wide
    sheet = across, bottom + height + 0.3 + 0.22 * len(heading)

    figure = Figure(figsize=sheet)
    ax = figure.add_axes((left / sheet[0], bottom / sheet[1], width / sheet[0], height / sheet[1]))
    ax.set(xlim=middle[0] + size[0] * np.array([-0.5, 0.5]), xlabel="x, east [m]")
    ax.set(ylim=middle[1] + size[1] * np.array([-0.5, 0.5]), ylabel="y, north [m]")
    ax.set_aspect("equal")
    text, start = "\n".join(heading), (left / sheet[0], 1 - 0.12 / sheet[1])
    figure.text(*start, text, va="top", fontsize=11, weight="bold", **NAME)

    beside = left + width + 0.2
    bar = figure.add_axes(
        (beside / sheet[0], bottom / sheet[1], 0.18 / sheet[0], (height - 0.75) / sheet[1])
    )
    arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "mutation_scale": 16}
    at = ((beside + 0.09) / sheet[0], (bottom + height) / sheet[1])
    tail = (at[0], at[1] - 0.5 / sheet[1])
    ax.annotate("", at, tail, "figure fraction", "figure fraction", arrowprops=arrow)
    figure.text(at[0] + 0.12 / sheet[0], at[1], "N", va="top", weight="bold", fontsize=11)
    return figure, ax, bar


def _closed(polygon: np.ndarray) -> np.ndarray:
    points = np.asarray(polygon, dtype=float)
    return np.concatenate([points, points[:1]])


def _write(ax: Axes, x: np.ndarray, y: np.ndarray, numbers: np.ma.MaskedArray, norm: Any) -> None:
    """Write each sensor's value on it, dark on the bright end of the colours."""
    digits = 0 if abs(numbers).max() >= 100 else 1
    for i in np.flatnonzero(~np.ma.getmaskarray(numbers)):
        colour = INK if norm(numbers[i]) > 0.6 else "white"
        text = f"{numbers[i]:.{digits}f}"
        ax.text(x[i], y[i], text, color=colour, ha="center", va="center", fontsize=8)


def _label(values: xr.DataArray) -> str:
    name = str(values.attrs.get("long_name", values.name or ""))
    units = values.attrs.get("units")
    return f"{name} [{units}]".strip() if units else name


def _bar(ax: Axes, at: int, interval: Mapping[str, float], colour: str) -> None:
    """Draw a bar with its interval and its value, written where no line crosses it."""
    value, low, high = (interval[key] for key in ("value", "low", "high"))
    ax.bar(at, value, width=0.72, color=colour)
    reach = [[value - low], [high - value]]
    ax.errorbar(at, value, reach, color=INK, capsize=5, linewidth=1.2, clip_on=False)
    inside = low >= 12  # the error bar stays clear of a number at the foot of the bar
    y, colour, va = (4.0, "white", "center") if inside else (high + 1.5, INK, "bottom")
    text = f"{value:.1f} %"
    ax.text(at, y, text, ha="center", va=va, weight="bold", fontsize=10, color=colour)


def _line(
    ax: Axes, intervals: Sequence[Mapping[str, float] | None], label: str, **style: Any
) -> None:
    """Draw a monthly line and its band, broken where a month has no hours."""
    rows = [[i["value"], i["low"], i["high"]] if i is not None else [np.nan] * 3 for i in intervals]
    value, low, high = np.array(rows, dtype=float).T
    month = np.arange(1, 13)
    ax.fill_between(month, low, high, color=style["color"], alpha=0.18, linewidth=0)
    ax.plot(month, value, label=label, linewidth=1.8, markersize=4.5, clip_on=False, **style)
