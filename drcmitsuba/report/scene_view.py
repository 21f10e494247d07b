"""A scene before anything is simulated: plan, section and axonometric view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from drcmitsuba.report.style import BLUE, GREY, INK, NAME, ORANGE, halo

KINDS = {
    "surface": {"color": INK, "linewidth": 0.8},
    "context": {"color": GREY, "linewidth": 0.6, "linestyle": (0, (4, 2))},
    "pane": {"color": BLUE, "linewidth": 2.0},
}
"""Lines of the kinds of surfaces."""
LABELS = {"surface": "surfaces", "context": "context", "pane": "panes"}
MOST_EDGES = 40_000
"""Largest number of edges of a kind that are drawn, the longest first."""
SENSOR = {"marker": "o", "color": ORANGE, "linestyle": ""}
VIEW: dict[str, Any] = {"marker": "o", "color": "#009E73", "markersize": 4}
ARROW = {"arrowstyle": "-|>", "linewidth": 1.6}
# The viewer stands in the south-east, 30° above: right and up on paper, from east, north, up.
_RIGHT = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
_UP = np.array([-0.5, 0.5, np.sqrt(1.5)]) / np.sqrt(2)


class Drawn(NamedTuple):
    """Surfaces to draw."""

    kind: str
    """Key of `KINDS`."""
    quads: np.ndarray
    """Parallelograms, and triangles that repeat their last corner [m], shape (quad, 4, 3)."""


def outlines(quads: np.ndarray) -> np.ndarray:
    """Edges (edge, 2, 3) [m] of quads that no other quad of the same plane shares."""
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    facing = _digest(np.round(np.abs(n) * 1e3))
    # The sum is that of both ends, whichever comes first.
    corner = _digest(np.round(ends * 1e4))
    keys = _digest(np.column_stack([corner.sum(axis=1), np.repeat(facing, 4)]))
    _, first, times = np.unique(keys, return_index=True, return_counts=True)
    once = np.sort(first[times == 1])
    return ends[once][np.linalg.norm(ends[once][:, 1] - ends[once][:, 0], axis=1) > 1e-6]


def _digest(rows: np.ndarray) -> np.ndarray:
    """64-bit numbers of rows (…, column) of whole numbers, equal for equal rows."""
    out = np.zeros(rows.shape[:-1], np.uint64)
    for column in np.moveaxis(rows, -1, 0):
        word = column.astype(np.int64 if column.dtype.kind == "f" else np.uint64).view(np.uint64)
        out = (out ^ word) * np.uint64(0x9E3779B97F4A7C15)
        out ^= out >> np.uint64(29)
    return out


def scene_view(
    drawn: Sequence[Drawn], sensors: np.ndarray, *, title: str = "", names: Sequence[str] = (),
    views: Mapping[str, np.ndarray] = MappingProxyType({}),
) -> Figure:  # fmt: skip
    """Draw a scene in plan, in section from the east, and from the south-east above.

    Parameters
    ----------
    drawn : sequence of Drawn
        Surfaces, x east, y north, z up.
    sensors : np.ndarray, shape (sensor, 3)
        Positions of the sensors [m].
    title : str
        Name of the case.
    names : sequence of str
        Lines of text below the legend, such as the panes by material.
    views : mapping of str to np.ndarray, shape (2, 3)
        Position [m] and direction of views by their names: arrows in the plan.

    Returns
    -------
    Figure
        The pictures are framed by surfaces, panes and sensors; context is cut at the frame.
    """
    edges: dict[str, np.ndarray] = {}
    for kind in KINDS:
        quads = [one.quads for one in drawn if one.kind == kind and len(one.quads)]
        if quads:
            own = outlines(np.concatenate(quads))
            longest = np.argsort(-np.linalg.norm(own[:, 1] - own[:, 0], axis=1), kind="stable")
            edges[kind] = own[longest[:MOST_EDGES]]
    framed = [e.reshape(-1, 3) for kind, e in edges.items() if kind != "context"]
    within = np.concatenate([*framed, sensors])
    figure = Figure(figsize=(11, 8.6))
    figure.text(0.03, 0.965, title, fontsize=12, weight="bold", va="top", **NAME)
    plan = figure.add_axes((0.06, 0.43, 0.40, 0.47))
    section = figure.add_axes((0.06, 0.07, 0.40, 0.26))
    view = figure.add_axes((0.50, 0.24, 0.48, 0.66))
    east, north, up = np.eye(3)
    _panel(plan, edges, sensors, within, east, north)
    _panel(section, edges, sensors, within, north, up)
    panes = [one.quads for one in drawn if one.kind == "pane"]
    _panel(view, edges, sensors, within, _RIGHT, _UP, panes)
    plan.set(title="plan", xlabel="x, east [m]", ylabel="y, north [m]")
    section.set(title="section, seen from the east", xlabel="y, north [m]", ylabel="z [m]")
    view.set(title="from the south-east")
    view.set_axis_off()
    _north(plan)
    _views(plan, views)
    _legend(figure, edges, len(sensors), names)
    return figure


def _panel(
    ax: Axes, edges: Mapping[str, np.ndarray], sensors: np.ndarray, within: np.ndarray,
    right: np.ndarray, up: np.ndarray, filled: Sequence[np.ndarray] = (),
) -> None:  # fmt: skip
    """Draw edges and sensors in parallel projection; `filled` quads are tinted."""
    onto = np.stack([right, up], axis=1)
    for quads in filled:
        ax.add_collection(PolyCollection(quads @ onto, facecolor=BLUE, alpha=0.25))
    for kind in ("context", "surface", "pane"):
        if kind in edges:
            ax.add_collection(LineCollection(edges[kind] @ onto, **KINDS[kind]))
    size = float(np.clip(40 / np.sqrt(max(len(sensors), 1)), 1, 3))
    ax.plot(*(sensors @ onto).T, markersize=size, **SENSOR)
    at = within @ onto
    low, high = at.min(axis=0), at.max(axis=0)
    margin = 0.04 * float((high - low).max()) + 1e-3
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)
    ax.set_aspect("equal")


def _north(ax: Axes) -> None:
    """Draw the arrow to the north beside a plan."""
    ax.annotate(
        "N", (1.06, 1.0), (1.06, 0.86), "axes fraction", arrowprops={**ARROW, "color": INK},
        ha="center", va="top", fontsize=11, weight="bold", annotation_clip=False,
    )  # fmt: skip


def _views(ax: Axes, views: Mapping[str, np.ndarray]) -> None:
    """Draw a dot, an arrow and a name for each view whose position lies in the plan."""
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    long = 0.09 * max(high - low, top - bottom)
    for name, (at, along) in views.items():
        (x, y), (dx, dy) = at[:2], long * along[:2] / np.linalg.norm(along)
        if not (low <= x <= high and bottom <= y <= top):
            continue
        ax.plot([x], [y], **VIEW)
        ax.annotate("", (x + dx, y + dy), (x, y), arrowprops={**ARROW, "color": VIEW["color"]})
        ax.annotate(
            name if len(name) < 30 else f"{name[:28]}…", (x, y), (5, -3), fontsize=8, va="top",
            textcoords="offset points", color=VIEW["color"], path_effects=halo(2, "white"), **NAME,
        )  # fmt: skip


def _legend(
    figure: Figure, edges: Mapping[str, np.ndarray], count: int, names: Sequence[str]
) -> None:
    handles = [Line2D([], [], label=LABELS[kind], **KINDS[kind]) for kind in KINDS if kind in edges]
    handles.append(Line2D([], [], label=f"{count} sensors", markersize=4, **SENSOR))
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.50, 0.21), frameon=False)
    text = "\n".join(names)
    figure.text(0.66, 0.20, text, fontsize=8, va="top", color=GREY, linespacing=1.4, **NAME)
