"""Pictures of where the light of a point comes from: the year as bars, the sky by window."""

from __future__ import annotations

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure

from drcmitsuba.report.lights import of_period
from drcmitsuba.report.style import BLUE, GREY, INK, NAME, ORANGE, tidy

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
    figure = Figure(figsize=(8.4, 2.0 + 0.35 * len(order) + 2.5 * len(order)), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.6 + 0.4 * len(order), 2.6 * len(order)])
    _bars(above.subplots(), light.isel(window=order), whole)
    x, y = float(of_point["x"]), float(of_point["y"])
    state = str(of_point["state"].values[0])
    title = f"{of_point.attrs['case']}: who lights the point at ({x:.2f}, {y:.2f}) m"
    figure.suptitle(title, fontsize=10, color=INK, **NAME)
    C = of_point["by_window"].isel(state=0, window=order) / of_point["solid_angle"]
    norm = PowerNorm(0.35, vmin=0, vmax=max(float(C.sum("bounces").max()), 1e-9))
    axes = below.subplots(len(order), len(CLASSES), squeeze=False)
    for row, values in zip(axes, C, strict=True):
        for ax, (label, bounces) in zip(row, CLASSES, strict=True):
            drawn = _dome(ax, values.isel(bounces=bounces).sum("bounces").values, of_point, norm)
            ax.set_title(f"{values['window'].item()}, {label}", fontsize=8, **NAME)
    bar = below.colorbar(drawn, ax=axes, shrink=0.6, pad=0.02)
    bar.set_label(f"C per solid angle of the sky or the sun, state {state} [–]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return figure


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
    ax.set_yticks(range(len(names)), names, fontsize=8, **NAME)
    ax.invert_yaxis()
    ax.set_xlabel(f"share of the light of the period, {whole / 1e6:.3g} Mlx·h [%]", fontsize=8)
    ax.tick_params(axis="x", labelsize=8)
    ax.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.25), frameon=False)
    tidy(ax, axis="x")


def _dome(ax: Axes, values: np.ndarray, of_point: xr.Dataset, norm: PowerNorm) -> PolyCollection:
    """Draw values of the bins over the sky, as seen from below with north above and east right."""
    patches = Patches(int(of_point.attrs["subdivision"]))
    outlines = [_ring(), *map(_outline, patches.bounds[1:])]
    drawn = PolyCollection(
        outlines, array=values[: len(patches)], norm=norm, cmap="viridis", edgecolors="none"
    )
    ax.add_collection(drawn)
    d = of_point["direction"].values[len(patches) :]
    away = np.arccos(np.clip(d[:, 2], -1, 1)) / (np.pi / 2)
    across = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-9)
    x, y = d[:, 0] / across * away, d[:, 1] / across * away
    suns = values[len(patches) :]
    seen = suns > 0
    ax.scatter(x[~seen], y[~seen], s=0.3, c=GREY, linewidths=0, alpha=0.5)
    order = np.flatnonzero(seen)[np.argsort(suns[seen])]
    ax.scatter(x[order], y[order], s=3, c=suns[order], norm=norm, cmap="viridis", linewidths=0)
    for text, at in (("N", (0, 1)), ("E", (1, 0)), ("S", (0, -1)), ("W", (-1, 0))):
        ax.annotate(text, np.multiply(at, 1.22), ha="center", va="center", fontsize=7, color=INK)
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
