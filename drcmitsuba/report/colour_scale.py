"""Scales of colours: from numbers to colours, and the bar that explains them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import LogLocator, MaxNLocator


def scale(
    numbers: np.ma.MaskedArray, norm: Normalize | None = None, limit: float | None = None
) -> Normalize:
    """Scale of the colours; default: 0 to the largest value, or to a little above a limit."""
    if norm is None:
        highest = numbers.max() if limit is None else max(float(numbers.max()), 1.1 * limit)
        return Normalize(min(0.0, numbers.min()), highest or 1.0)
    norm = copy.copy(norm)
    norm.autoscale_None(numbers)
    return norm


def colour_bar(picture: Any, numbers: np.ma.MaskedArray, at: Axes | None = None) -> Colorbar:
    """Draw the scale of a picture's colours, with arrows where numbers lie beyond it.

    The bar fills the axes `at`, or stands beside the picture.
    """
    norm = picture.norm
    below, above = bool((numbers < norm.vmin).any()), bool((numbers > norm.vmax).any())
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[below, above]
    place = {"ax": picture.axes, "pad": 0.02} if at is None else {"cax": at}
    bar = picture.axes.get_figure(root=True).colorbar(picture, extend=extend, **place)
    if isinstance(norm, LogNorm):  # 200, 500, 1000 rather than powers of ten
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.minorticks_off()
    return bar


def round_levels(numbers: np.ma.MaskedArray, most: int = 7) -> list[float]:
    """Round values inside the range of numbers, at most so many, in increasing order."""
    low, high = float(numbers.min()), float(numbers.max())
    ticks = MaxNLocator(most, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    return [float(tick) for tick in ticks if low < tick < high]


def label_of(values: xr.DataArray) -> str:
    """Long name and units of values, as "illuminance [lx]"."""
    name = str(values.attrs.get("long_name", values.name or ""))
    units = values.attrs.get("units")
    return f"{name} [{units}]".strip() if units else name
