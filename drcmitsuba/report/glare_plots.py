"""Pictures of a year of glare: days and hours of one view, and a plan of all views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from drcmitsuba.report.style import GREY, INK, LINES, halo, head
from drcmitsuba.report.temporal_map import temporal_map

LIMITS = (0.35, 0.40, 0.45)
"""DGP between whose classes the colours change."""
WORDS = ("imperceptible", "perceptible", "disturbing", "intolerable")
"""Glare of the classes."""
COLOURS = ("#F0F0F0", "#9ECAE1", "#E69F00", "#7A1E1E")
"""Colours of the classes, which differ in lightness."""


def year(dgp: xr.DataArray, *, title: str = "", caption: str = "") -> Figure:
    """Draw DGP over the days of the year and the hours of the day.

    Parameters
    ----------
    dgp : DataArray (time,)
        Daylight glare probability with the coordinate `time`, as for `temporal_map`.
    title, caption : str
        Words above the picture.

    Returns
    -------
    Figure
    """
    norm = BoundaryNorm([0, *LIMITS, 1], len(COLOURS))
    ax = temporal_map(
        dgp, norm=norm, cmap=ListedColormap(COLOURS), label="", title=title, caption=caption
    )
    bar = ax.images[0].colorbar
    assert bar is not None
    bar.set_ticks(LIMITS)
    bar.ax.set_title("DGP [–]", fontsize=9)
    for i, word in enumerate(WORDS):
        colour = "white" if i == len(WORDS) - 1 else INK
        bar.ax.text(
            0.5, (i + 0.5) / len(WORDS), word, rotation=90, ha="center", va="center", fontsize=6.8,
            color=colour, transform=bar.ax.transAxes,
        )  # fmt: skip
    return ax.get_figure(root=True)


def plan(
    at: np.ndarray, towards: np.ndarray, shares: np.ndarray, *, title: str = "", caption: str = "",
    lines: Mapping[str, Sequence[np.ndarray]] | None = None, most: float = 0.0,
) -> Figure:  # fmt: skip
    """Draw views as arrows in a plan, in the colour of their share of the hours.

    Parameters
    ----------
    at, towards : np.ndarray, shape (view, 2)
        Places of the eyes [m], and horizontal parts of their lines of sight [–].
    shares : np.ndarray, shape (view,)
        Shares of the hours [%].
    title, caption : str
        Words above the picture.
    lines : mapping of str to sequence of arrays (n, 2), optional
        Outlines x, y [m] by their kind in `style.LINES`.
    most : float
        Share at the end of the colours [%], at least the largest one that is drawn.

    Returns
    -------
    Figure
    """
    figure = Figure(figsize=(6.4, 5.6), layout=ConstrainedLayoutEngine(h_pad=0.12))
    ax = figure.subplots()
    for kind, outlines in (lines or {}).items():
        for outline in outlines:
            closed = outline if kind == "glazing" else np.vstack([outline, outline[:1]])
            ax.plot(*closed.T, **LINES[kind])
    norm = Normalize(0, max(5.0, most, float(shares.max(initial=0))))
    colours = colormaps["cividis_r"]
    spread = max(np.ptp([*ax.get_xlim()]), np.ptp([*ax.get_ylim()])) if lines else 5.0
    length = 0.09 * spread
    for place, direction, share in zip(at, towards, shares, strict=True):
        end = place + length * direction
        arrow = {
            "arrowstyle": "-|>,head_width=0.35,head_length=0.6", "linewidth": 2.4, "shrinkA": 0,
            "shrinkB": 0, "color": colours(norm(share)), "path_effects": halo(3.6, GREY),
        }  # fmt: skip
        ax.annotate("", end, place, arrowprops=arrow)
        ax.text(
            *(place + 1.3 * length * direction), f"{share:.0f}", fontsize=8, ha="center",
            va="center", path_effects=halo(2.0, "white"), color=INK,
        )  # fmt: skip
    ax.plot(*at.T, "o", color=INK, markersize=4)
    ax.update_datalim(at + 1.3 * length * towards)
    ax.set_aspect("equal")
    ax.margins(0.1)
    ax.set_xlabel("x, east [m]")
    ax.set_ylabel("y, north [m]")
    wide, high = ax.dataLim.size
    figure.set_figwidth(1.8 + float(np.clip(4.4 * wide / max(high, 1e-9), 2.2, 5.6)))
    figure.colorbar(ScalarMappable(norm, colours), ax=ax, label="share of the hours [%]")
    head(ax, title, caption)
    return figure
