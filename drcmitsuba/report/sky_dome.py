"""Pictures of where the light of a point comes from: the year as bars, the sky by window."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure

from drcmitsuba.report.captions import place_text
from drcmitsuba.report.colour_scale import label_of
from drcmitsuba.report.lights import of_period
from drcmitsuba.report.style import BLUE, COLOURS, INK, NAME, ORANGE, head, letters, new_axes, tidy

UNSEEN = "#B9B9B9"
"""Colour of suns that send nothing."""
MOST_WINDOWS = 4
"""Largest number of windows that are drawn, those with the most light."""
CLASSES = (("0 bounces", slice(0, 1)), ("1 bounce", slice(1, 2)), ("2 or more", slice(2, None)))
"""Numbers of bounces that are drawn together."""
SOURCES = {"sun": ORANGE, "sky": BLUE, "ground": "#999933"}
HATCHES = ("", "////", "xxxx")
RIM = 1.1
"""Radius of the ring that stands for the ground; the horizon is at 1."""


def who_lights(of_point: xr.Dataset) -> Figure:
    """Draw who lights a point.

    Parameters
    ----------
    of_point : xr.Dataset
        `annual.lights.Lights.dataset` of one sensor.

    Returns
    -------
    Figure
        Bars: light of the year by window, source and bounces. Below, for every window: C per solid
        angle of the bins [–] over the sky, north above, the ring being the ground and dots the suns
        of the year, in the first state.
    """
    light = of_period(of_point)
    whole = float(light.sum())
    by_window = light.sum(["source", "bounces"]).values
    order = [int(i) for i in np.argsort(-by_window, kind="stable") if by_window[i] > 0]
    order = order[:MOST_WINDOWS] or [0]
    heights = [1.9 + 0.4 * len(order), 2.6 * len(order)]  # of the bars with their legend, the sky
    figure = Figure(figsize=(8.4, sum(heights)), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=heights)
    _bars(above.subplots(), light.isel(window=order), whole)
    x, y = float(of_point["x"]), float(of_point["y"])
    state = str(of_point["state"].values[0])
    title = f"{of_point.attrs['case']}: who lights the point at ({x:.2f}, {y:.2f}) m"
    title = f"{title}\n{_where(of_point)}"
    size = letters(title, figure.get_figwidth(), 10)
    figure.suptitle(title, fontsize=size, color=INK, **NAME)
    C = of_point["by_window"].isel(state=0, window=order) / of_point["solid_angle"]
    norm = PowerNorm(0.35, vmin=0, vmax=max(float(C.sum("bounces").max()), 1e-9))
    subdivision = int(of_point.attrs["subdivision"])
    axes = below.subplots(len(order), len(CLASSES), squeeze=False)
    for row, values in zip(axes, C, strict=True):
        for ax, (label, bounces) in zip(row, CLASSES, strict=True):
            of_class = values.isel(bounces=bounces).sum("bounces")
            sky_dome(of_class, of_point["direction"], subdivision=subdivision, ax=ax, norm=norm)
            ax.set_title(f"{values['window'].item()}, {label}", fontsize=9, **NAME)
    bar = below.colorbar(axes[0, 0].collections[0], ax=axes, shrink=0.9, pad=0.02)
    bar.set_label(f"C per solid angle of the bin [–],\nstate {state}", fontsize=9, **NAME)
    bar.ax.tick_params(labelsize=8.5)
    return figure


def _where(of_point: xr.Dataset) -> str:
    """Weather, place and hours of the year of light."""
    attributes, parts = of_point.attrs, []
    known = json.loads(attributes.get("settings", "{}"))
    if known.get("weather_source"):
        parts.append(Path(known["weather_source"]).name)
    if {"latitude", "longitude"} <= set(attributes):
        parts.append(place_text(attributes["latitude"], attributes["longitude"]))
    hours = of_point["hours"] if attributes["by_evaluation"] else of_point["hours"][:1]
    return "; ".join([*parts, f"{float(hours.sum()):g} h"])


def _bars(ax: Axes, light: xr.DataArray, whole: float) -> None:
    """Stacked bars of light exposure (window, source, bounces), in per cent of the whole."""
    names = light["window"].values
    left = np.zeros(len(names))
    for source, colour in SOURCES.items():
        for (label, bounces), hatch in zip(CLASSES, HATCHES, strict=True):
            values = light.sel(source=source).isel(bounces=bounces).sum("bounces").values
            share = 100 * values / whole if whole else values
            ax.barh(
                range(len(names)), share, left=left, color=colour, hatch=hatch,
                edgecolor="white", linewidth=0.3, label=f"{source}, {label}",
            )  # fmt: skip
            left += share
    ax.set_yticks(range(len(names)), names, fontsize=9, **NAME)
    ax.invert_yaxis()
    ax.set_xlabel(f"share of the light of the period, {whole / 1e6:.3g} Mlx·h [%]", fontsize=9)
    ax.tick_params(axis="x", labelsize=8)
    tidy(ax, axis="x")
    every = ax.get_legend_handles_labels()
    bars = ax.get_figure(root=False)
    bars.legend(*every, fontsize=8.5, ncols=3, loc="outside lower center", frameon=False)


def sky_dome(
    values: xr.DataArray, direction: xr.DataArray, *, subdivision: int = 1, ax: Axes | None = None,
    norm: Normalize | None = None, title: str = "", caption: str = "", label: str | None = None,
) -> Axes:  # fmt: skip
    """Draw values of the bins over the sky, north above and east on the right.

    Parameters
    ----------
    values : DataArray (bin,)
        Value of the ground, of the patches of the sky and of the suns, such as C over the solid
        angle of the bin [–].
    direction : DataArray (bin, axis)
        Unit vectors to the bins: x east, y north, z up.
    subdivision : int
        Subdivision of the Tregenza patches.
    ax : Axes, optional
        Axes to draw on; those of a new figure with a colour bar by default.
    norm : Normalize, optional
        Scale of the colours; a power of 0.35 from 0 to the largest value by default, so that faint
        parts of the sky show.
    title, caption : str
        Case, point and window; place and period in small letters below.
    label : str, optional
        Text at the colour bar; the long name and units of `values` by default.

    Returns
    -------
    Axes
        `collections[0]` holds the ground, a ring, and the patches; the last one the suns that send
        something, above white dots; grey ones send nothing. The distance from the centre is that
        from the zenith over 90°.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> point = drcmitsuba.lights("office.toml", [(3.0, 1.0)]).dataset.isel(sensor=0, state=0)
    >>> sent = point["by_window"].sum(["window", "bounces"]) / point["solid_angle"]
    >>> axes = plots.sky_dome(sent, point["direction"], title="what lights the point")
    """
    is_new = ax is None
    ax = new_axes((6.0, 5.4)) if ax is None else ax
    if norm is None:
        norm = PowerNorm(0.35, vmin=0, vmax=max(float(values.max()), 1e-9))
    drawn = _dome(ax, values.values, direction.values, subdivision, norm)
    if is_new:
        bar = ax.get_figure(root=True).colorbar(drawn, ax=ax, shrink=0.8)
        bar.set_label(label_of(values) if label is None else label)
        head(ax, title, caption)
    return ax


def _dome(
    ax: Axes, values: np.ndarray, direction: np.ndarray, subdivision: int, norm: Normalize
) -> PolyCollection:
    """Draw values (bin,) at directions (bin, axis); return the patches."""
    patches = Patches(subdivision)
    outlines = [_ring(), *map(_outline, patches.bounds[1:])]
    drawn = PolyCollection(
        outlines, array=values[: len(patches)], norm=norm, cmap=COLOURS, edgecolors="none"
    )
    ax.add_collection(drawn)
    d = direction[len(patches) :]
    away = np.arccos(np.clip(d[:, 2], -1, 1)) / (np.pi / 2)
    across = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-9)
    x, y = d[:, 0] / across * away, d[:, 1] / across * away
    suns = values[len(patches) :]
    seen = suns > 0
    ax.scatter(x[~seen], y[~seen], s=1.0, c=UNSEEN, linewidths=0)
    order = np.flatnonzero(seen)[np.argsort(suns[seen])]
    ax.scatter(x[order], y[order], s=9, c="white", linewidths=0)
    ax.scatter(x[order], y[order], s=4, c=suns[order], norm=norm, cmap=COLOURS, linewidths=0)
    for text, at in (("N", (0, 1)), ("E", (1, 0)), ("S", (0, -1)), ("W", (-1, 0))):
        ax.annotate(text, np.multiply(at, 1.22), ha="center", va="center", fontsize=8.5, color=INK)
    ax.set(xlim=(-1.3, 1.3), ylim=(-1.3, 1.3), aspect="equal")
    ax.axis("off")
    return drawn


def _outline(bounds: np.ndarray) -> np.ndarray:
    """Outline of a patch (corner, 2), from its lowest, highest altitude and azimuths [rad]."""
    low, high, first, last = bounds
    azimuth = np.linspace(first, last, max(2, int(np.degrees(last - first) / 3)))
    outer, inner = (1 - altitude / (np.pi / 2) for altitude in (low, high))
    arc = np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    return np.concatenate([outer * arc, inner * arc[::-1]])


def _ring() -> np.ndarray:
    """Outline of the ground's ring, (corner, 2)."""
    azimuth = np.linspace(0, 2 * np.pi, 121)
    arc = np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    return np.concatenate([arc, RIM * arc[::-1]])
