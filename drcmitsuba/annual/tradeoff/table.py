"""Result of a trade-off: a table of the settings, and a picture of their frontier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from drcmitsuba.annual.tradeoff.errors import HEADER, Row, Yardstick
from drcmitsuba.report import plots
from drcmitsuba.report.plots import BLUE, GREY, INK, ORANGE
from drcmitsuba.runtime import storage

COLOURS = {
    "default": INK,
    "yours": INK,
    "samples": BLUE,
    "cell size": ORANGE,
    "interreflection": "#8C6BB1",
    "film": "#CC79A7",
    "sun model": "#009E73",
    "sky": "#56B4E9",
    "combination": "#E69F00",
}
"""Colour of a setting by what varies in it; colour-blind readers tell them apart."""
MARKED = {"default": ("*", 260), "yours": ("D", 80)}
"""Marker and size [pt²] of the default setting and of the case's own."""
OWN, HIDDEN = "#ECECEC", "#DADADA"
"""Colours of the band of the reference's own error, and of the band that its noise hides."""
FEWEST = 3
"""Smallest number of settings that allows a choice."""
FONT = 8.0
"""Size of the labels [pt]."""


def pareto(seconds: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Positions of the settings that no other one beats in both time and error, by time."""
    order = np.lexsort((error, seconds))
    best = np.minimum.accumulate(error[order])
    new = np.concatenate([[True], error[order][1:] < best[:-1]])
    return order[new]


def frontier(name: str, rows: Sequence[Row], own_rms: float) -> Figure:
    """Draw seconds against the RMS error of E on logarithmic axes.

    A setting whose error the reference's noise hides stands at the upper bound of its error, with
    an arrow down. The grey bands show the reference's own RMS error [%], and the errors that its
    noise hides.
    """
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    ax = figure.add_subplot()
    rows = [row for row in rows if row.is_on_plot]
    title = f"{name}: what accuracy costs"
    ax.set_title(title, loc="left", weight="bold", fontsize=11, parse_math=False)
    ax.set_xlabel("seconds for the period, without start-up")
    ax.set_ylabel("RMS error of E [% of its mean]")
    if not rows:
        ax.text(0.5, 0.5, "no setting was reached", transform=ax.transAxes, ha="center")
        return figure
    seconds = np.array([row.seconds for row in rows])
    error = np.array([row.errors.shown for row in rows if row.errors is not None])
    _axes(ax, seconds, np.append(error, own_rms))
    spread = min(row.errors.square.error for row in rows if row.errors is not None)
    hidden = 100 * float(np.sqrt(spread))  # smallest error that the reference's noise shows
    for error_of_reference, grey in ((own_rms, OWN), (hidden, HIDDEN)):
        ax.axhspan(ax.get_ylim()[0], error_of_reference, color=grey, zorder=0, linewidth=0)
    at = pareto(seconds, error)
    ax.plot(seconds[at], error[at], color=GREY, linewidth=1.2, zorder=1)
    for row, x, y in zip(rows, seconds, error, strict=True):
        _point(ax, row, x, y)
    _labels(figure, ax, rows, np.column_stack([seconds, error]), at)
    _legend(figure, rows, own_rms, hidden)
    return figure


def _axes(ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Logarithmic axes around the points, with plain numbers and room for labels."""
    for axis, values, margin in ((ax.xaxis, x, 0.16), (ax.yaxis, y, 0.12)):
        low, high = np.log10([values.min(), values.max()])
        room = max(margin * (high - low), 0.08)
        limits = 10 ** (low - room), 10 ** (high + room)
        if axis is ax.xaxis:
            ax.set(xscale="log", xlim=limits)
        else:
            ax.set(yscale="log", ylim=limits)
        axis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axis.set_minor_formatter(NullFormatter())
    plots.tidy(ax)


def _point(ax: Axes, row: Row, x: float, y: float) -> None:
    assert row.errors is not None
    marker, size = MARKED.get(row.varied, ("o", 46))
    style: dict[str, Any] = {"color": COLOURS[row.varied], "zorder": 3}
    if row.errors.is_hidden:
        ax.scatter(x, y, size, marker=marker, facecolor="white", edgecolor=style["color"], zorder=3)
        arrow = {"arrowstyle": "<-", "color": style["color"], "linewidth": 1.1, "shrinkB": 4}
        ax.annotate("", (x, y), (0, -20), textcoords="offset points", arrowprops=arrow)
        return
    bar = min(row.errors.rms_error, 0.9 * y)
    ax.errorbar(x, y, bar, elinewidth=0.8, alpha=0.6, **style)
    ax.scatter(x, y, size, marker=marker, edgecolor="white", linewidth=0.7, **style)


def _labels(
    figure: Figure, ax: Axes, rows: Sequence[Row], points: np.ndarray, best: np.ndarray
) -> None:
    """Label every point clear of other points, labels and the frontier through `best`.

    A thin line joins a label to its point where the two are not close.
    """
    figure.canvas.draw()  # sets the layout, on which the places depend
    dots = ax.transData.transform(points)
    scale = figure.dpi / 72
    steps = np.linspace(0, 1, 60)[:, None, None]
    on_line = (dots[best[:-1]] * (1 - steps) + dots[best[1:]] * steps).reshape(-1, 2)
    taken = [
        (x - half * scale, y - half * scale, x + half * scale, y + half * scale)
        for places, half in ((dots, 6), (on_line, 2))
        for x, y in places
    ]
    frame = ax.get_window_extent()
    for i in np.argsort(points[:, 0]):
        text = rows[i].name
        bold = rows[i].varied in MARKED
        width = (0.62 if bold else 0.54) * FONT * scale * len(text)
        height = 1.25 * FONT * scale
        left, bottom = _free(dots[i], width, height, taken, frame.extents, scale)
        taken.append((left, bottom, left + width, bottom + height))
        shift = (np.array([left, bottom + height / 2]) - dots[i]) / scale
        centre = (np.array([left + width / 2, bottom + height / 2]) - dots[i]) / scale
        far = np.hypot(*centre) > width / 2 / scale + 16
        line = {"arrowstyle": "-", "color": "#AAAAAA", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 4}
        ax.annotate(
            text, points[i], tuple(shift), textcoords="offset points", va="center",
            fontsize=FONT, color=INK, zorder=4,
            weight="bold" if bold else "normal",
            arrowprops=line if far else None,
        )  # fmt: skip


def _free(
    dot: np.ndarray, width: float, height: float, taken: Sequence[tuple[float, ...]],
    frame: np.ndarray, scale: float,
) -> tuple[float, float]:  # fmt: skip
    """Lower left corner [px] of the nearest place for a label that overlaps least."""
    best, least = (dot[0], dot[1]), np.inf
    for ring in range(12):
        gap = (9 + 7 * ring) * scale
        for angle in np.radians([0, 180, 90, 270, 30, -30, 150, 210, 60, -60, 120, 240]):
            c, s = np.cos(angle), np.sin(angle)
            left = dot[0] + gap * c + width * (c - 1) / 2
            bottom = dot[1] + gap * s + height * (s - 1) / 2
            box = (left, bottom, left + width, bottom + height)
            overlap = sum(_overlap(box, other) for other in taken)
            outside = width * height - _overlap(box, tuple(frame))
            cost = overlap + 2 * outside + 0.02 * ring * width * height
            if cost < least - 1e-6:
                best, least = (left, bottom), cost
    return best


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Area that two boxes (left, bottom, right, top) share."""
    wide = min(a[2], b[2]) - max(a[0], b[0])
    high = min(a[3], b[3]) - max(a[1], b[1])
    return max(wide, 0.0) * max(high, 0.0)


def _legend(figure: Figure, rows: Sequence[Row], own_rms: float, hidden: float) -> None:
    varied = [name for name in COLOURS if name in {row.varied for row in rows}]
    keys: list[Any] = [
        Line2D(
            [], [], linestyle="", marker=MARKED.get(name, ("o", 0))[0], color=COLOURS[name],
            markersize=11 if name == "default" else 6.5, label=name,
        )
        for name in varied
    ]  # fmt: skip
    keys += [
        Line2D([], [], color=GREY, linewidth=1.2, label="frontier"),
        Patch(color=OWN, label=f"own error of the reference, {own_rms:.1f} %"),
        Patch(color=HIDDEN, label=f"errors that its noise hides, to {hidden:.1f} %"),
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=5, frameon=False, fontsize=9)


@dataclass(frozen=True)
class Tradeoff:
    """Errors and costs of the settings of one case; shows itself in Jupyter.

    The yardstick is the reference with its own errors; the period has `year` time stamps.
    """

    name: str
    rows: tuple[Row, ...]
    yardstick: Yardstick
    year: int
    daylight_notes: tuple[str, ...] = ()
    """Notes on the weather, the place and the period."""

    @property
    def frame(self) -> pd.DataFrame:
        """Table of all numbers; its first row is the reference with its own errors."""
        mean = self.yardstick.mean
        reference = {
            "setting": "reference",
            "varied": "reference",
            "status": "done",
            "method": self.yardstick.reference.method,
            "E_rms_percent": self.yardstick.own_rms,
            "E_mean_se": 100 * mean.error / mean.value,
            "seconds": round(self.yardstick.reference.seconds, 3),
        }
        return pd.DataFrame([reference, *(row.as_dict() for row in self.rows)])

    def notes(self) -> list[str]:
        """Notes for the reader of the numbers."""
        yardstick, ref = self.yardstick, self.yardstick.reference
        mean, sda = yardstick.mean, yardstick.sda
        return [
            f"Reference: {ref.method}, in {yardstick.count} rounds, {ref.seconds:.0f} s; its own "
            "error is "
            f"{yardstick.own_rms:.1f} % RMS and {100 * mean.error / mean.value:.2f} % of the mean, "
            f"{mean.value:.0f} lx. "
            "Its noise is subtracted from the errors; '<' is an upper bound (95 %).",
            f"Errors compare {len(ref.times)} of {self.year} time stamps, E in the same state of "
            f"the façade. The reference's sDA ({sda.value:.1f} ± {1.96 * sda.error:.1f} %) and ASE "
            f"({yardstick.ase:.1f} %) count these hours, by the rules of the year.",
            "Seconds count the whole period, without start-up and compilation.",
            *self._doubts(),
            *self.daylight_notes,
        ]

    def _doubts(self) -> list[str]:
        """Reasons why the settings cannot be compared, if there are any."""
        errors = [row.errors for row in self.rows if row.is_on_plot and row.errors is not None]
        if len(errors) < FEWEST:
            return [f"Settings compared: {len(errors)}, too few for a choice; give more time."]
        if all(one.is_hidden for one in errors):
            return ["The noise of the reference hides all errors: give it more time."]
        return []

    def save(self, folder: str | Path) -> None:
        """Write `tradeoff.csv` and `tradeoff.png`, each whole or not at all."""
        self.save_csv(folder)
        plots.save(self.figure(), Path(folder) / "tradeoff.png")

    def save_csv(self, folder: str | Path) -> None:
        """Write `tradeoff.csv`, whole or not at all."""
        storage.save_csv(self.frame, Path(folder) / "tradeoff.csv")

    def figure(self) -> Figure:
        """Draw the frontier: seconds against the RMS error of E."""
        return frontier(self.name, self.rows, self.yardstick.own_rms)

    def _repr_html_(self) -> str:
        shown = pd.DataFrame([row.cells() for row in self.rows], columns=HEADER)
        remarks = "".join(f"<p>{escape(note)}</p>" for note in self.notes())
        image = plots.html_image(self.figure(), "seconds against error")
        return f"{shown.to_html(index=False, border=0)}{remarks}{image}"
