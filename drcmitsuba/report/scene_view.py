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
from matplotlib.transforms import ScaledTranslation, Transform

from drcmitsuba.report.edges import outlines
from drcmitsuba.report.style import BLUE, GREY, INK, NAME, ORANGE, halo

KINDS: dict[str, dict[str, Any]] = {
    "context": {"color": GREY, "linewidth": 0.6, "linestyle": (0, (4, 2))},
    "surface": {"color": INK, "linewidth": 0.8},
    "pane": {"color": BLUE, "linewidth": 2.0},
}
"""Lines of the kinds of surfaces, in the order in which they are drawn."""
LABELS = {"surface": "surfaces", "context": "context", "pane": "panes"}
GROUPS = ("#CC79A7", "#E69F00", "#56B4E9", "#332288", "#999933", "#882255")
"""Colours of groups of panes, which colour-blind readers tell apart; then `DASHES` change."""
DASHES: tuple[Any, ...] = ("-", (0, (3, 1)), (0, (1, 0.8)))
MOST_ROWS, WIDEST = 10, 54
"""Largest number of lines of text below the view, and of the characters of a line."""
NARROW = 0.5
"""Width over height of a panel below which it has few ticks."""
MOST_EDGES = 40_000
"""Largest number of edges of a kind that are drawn, the longest first."""
NAMES = {
    True: ("x, east [m]", "y, north [m]", "from the east", "the south-east"),
    False: ("x [m]", "y [m]", "against the x axis", "x high, y low"),
}
"""Axes in plan, and the sides from which section and view are seen: y to the north, or turned."""
SENSOR = {"marker": "o", "color": ORANGE, "linestyle": ""}
VIEW: dict[str, Any] = {"marker": "o", "color": "#009E73", "markersize": 4}
ARROW = {"arrowstyle": "-|>", "linewidth": 1.6}
# The viewer stands where x is high and y low, 30° above: right and up on paper, from x, y, z.
_RIGHT = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
_UP = np.array([-0.5, 0.5, np.sqrt(1.5)]) / np.sqrt(2)


class DrawnSurfaces(NamedTuple):
    """Surfaces to draw."""

    kind: str
    """Key of `KINDS`."""
    quads: np.ndarray
    """Parallelograms, and triangles that repeat their last corner [m], shape (quad, 4, 3)."""
    group: str = ""
    """Line of text for the group of panes, which has a colour of its own; "" for none."""


def scene_view(
    drawn: Sequence[DrawnSurfaces],
    sensors: np.ndarray,
    *,
    title: str = "",
    names: Sequence[str] = (),
    views: Mapping[str, np.ndarray] = MappingProxyType({}),
    north: Sequence[float] | np.ndarray = (0.0, 1.0),
) -> Figure:
    """Draw a scene in plan, in section along the x axis, and from above at an angle.

    Parameters
    ----------
    drawn : sequence of Drawn
        Surfaces in the coordinates of the file, z up.
    sensors : np.ndarray, shape (sensor, 3)
        Positions of the sensors [m].
    title : str
        Name of the case.
    names : sequence of str
        Lines of text in the legend, such as the panes by material.
    views : mapping of str to np.ndarray, shape (2, 3)
        Position [m] and direction of views by their names: arrows in the plan.
    north : sequence of float, shape (2,)
        Direction of the north in plan, a unit vector; other than y for a turned case.

    Returns
    -------
    Figure
        The pictures are framed by surfaces, panes and sensors; context is cut at the frame.
    """
    every = [_Lines.of(kind, "", drawn, style) for kind, style in KINDS.items()]
    groups = dict.fromkeys(one.group for one in drawn if one.group)
    every += [_Lines.of("pane", name, drawn, _style(i)) for i, name in enumerate(groups)]
    lines = [one for one in every if len(one.quads)]
    framed = [one.edges.reshape(-1, 3) for one in lines if one.kind != "context"]
    within = np.concatenate([*framed, sensors])
    figure = Figure(figsize=(11, 8.6))
    figure.text(0.03, 0.965, title, fontsize=12, weight="bold", va="top", **NAME)
    plan = figure.add_axes((0.06, 0.43, 0.40, 0.47))
    section = figure.add_axes((0.06, 0.07, 0.40, 0.26))
    view = figure.add_axes((0.50, 0.24, 0.48, 0.66))
    along_x, along_y, up = np.eye(3)
    _panel(plan, lines, sensors, within, along_x, along_y)
    _panel(section, lines, sensors, within, along_y, up)
    for one in lines:
        if one.kind == "pane":
            onto, tint = np.stack([_RIGHT, _UP], axis=1), one.style["color"]
            view.add_collection(PolyCollection(one.quads @ onto, facecolor=tint, alpha=0.25))
    _panel(view, lines, sensors, within, _RIGHT, _UP)
    x, y, seen, corner = NAMES[bool(np.allclose(north, (0, 1)))]
    plan.set(title="plan", xlabel=x, ylabel=y)
    section.set(title=f"section, seen {seen}", xlabel=y, ylabel="z [m]")
    view.set(title=f"from {corner}")
    view.set_axis_off()
    _north(plan, np.asarray(north, float))
    _views(plan, views)
    _legend(figure, lines, len(sensors), names)
    return figure


class _Lines(NamedTuple):
    """Surfaces of one kind, or panes of one group, and how their edges are drawn."""

    kind: str
    group: str
    quads: np.ndarray
    edges: np.ndarray
    """The longest edges of the quads, shape (edge, 2, 3) [m]."""
    style: dict[str, Any]

    @classmethod
    def of(
        cls, kind: str, group: str, drawn: Sequence[DrawnSurfaces], style: dict[str, Any]
    ) -> _Lines:
        """Join what is drawn alike."""
        mine = [one.quads for one in drawn if (one.kind, one.group) == (kind, group)]
        quads = np.concatenate([np.zeros((0, 4, 3)), *mine])
        edges = outlines(quads)
        longest = np.argsort(-np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1), kind="stable")
        return cls(kind, group, quads, edges[longest[:MOST_EDGES]], style)


def _style(group: int) -> dict[str, Any]:
    """Lines of the panes of a group."""
    dashes, colour = divmod(group, len(GROUPS))
    look = {"color": GROUPS[colour], "linestyle": DASHES[dashes % len(DASHES)]}
    return {**KINDS["pane"], **look}


def _panel(
    ax: Axes, lines: Sequence[_Lines], sensors: np.ndarray, within: np.ndarray,
    right: np.ndarray, up: np.ndarray,
) -> None:  # fmt: skip
    """Draw edges and sensors in parallel projection, panes last."""
    onto = np.stack([right, up], axis=1)
    for one in lines:
        ax.add_collection(LineCollection(one.edges @ onto, **one.style))
    size = float(np.clip(40 / np.sqrt(max(len(sensors), 1)), 1, 3))
    ax.plot(*(sensors @ onto).T, markersize=size, **SENSOR)
    at = within @ onto
    low, high = at.min(axis=0), at.max(axis=0)
    margin = 0.04 * float((high - low).max()) + 1e-3
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)
    ax.set_aspect("equal")
    if high[0] - low[0] < NARROW * (high[1] - low[1]):  # else labels of ticks touch
        ax.locator_params(axis="x", nbins=2)
    ax.ticklabel_format(useOffset=False, style="plain")  # a map's coordinates in full


def _north(ax: Axes, along: np.ndarray) -> None:
    """Draw an arrow `along` (2,) the north of the plan beside it."""
    figure = ax.get_figure()
    assert isinstance(figure, Figure)

    def beside(points: float) -> Transform:
        """Place on the arrow's line, so many points from its middle."""
        shift = ScaledTranslation(*(points / 72 * along), figure.dpi_scale_trans)
        return ax.transAxes + shift

    tail, head, letter = beside(-16), beside(16), beside(-24)
    at = (1.08, 0.9)
    arrow = {**ARROW, "color": INK}
    ax.annotate("", at, at, head, tail, arrowprops=arrow, annotation_clip=False)
    ax.annotate(
        "N", at, xycoords=letter, ha="center", va="center", fontsize=11, weight="bold",
        annotation_clip=False,
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
        # Views from one place have their names at their ends.
        flat = float(np.hypot(dx, dy))
        sideways, upward = (round(d / flat) if flat else 1 for d in (dx, dy))
        ax.annotate(
            cut(name, 29), (x + dx, y + dy), (4 * sideways, 4 * upward), fontsize=8,
            ha=("center", "left", "right")[sideways], va=("center", "bottom", "top")[upward],
            textcoords="offset points", color=VIEW["color"], path_effects=halo(2, "white"), **NAME,
        )  # fmt: skip


def _legend(figure: Figure, lines: Sequence[_Lines], count: int, names: Sequence[str]) -> None:
    """Explain lines and dots on the left, panes by group and by material on the right."""
    groups = [one for one in lines if one.group]
    labels = LABELS | {"pane": "panes of no group"} if groups else LABELS
    left = [Line2D([], [], label=labels[x.kind], **x.style) for x in lines if not x.group]
    left.append(Line2D([], [], label=f"{count} sensors", markersize=4, **SENSOR))
    rows = [(x.group, x.style) for x in groups] + [(name, {"linestyle": ""}) for name in names]
    if len(rows) > MOST_ROWS:
        more = f"… and {len(rows) - MOST_ROWS + 1} more"
        rows = [*rows[: MOST_ROWS - 1], (more, {"linestyle": ""})]
    right = [Line2D([], [], label=cut(text, WIDEST), **style) for text, style in rows]
    place: dict[str, Any] = {"loc": "upper left", "frameon": False, "borderaxespad": 0}
    figure.legend(handles=left, bbox_to_anchor=(0.50, 0.21), **place)
    place |= {"fontsize": 8, "labelcolor": GREY, "handlelength": 2.0 if groups else 0.0}
    for text in figure.legend(handles=right, bbox_to_anchor=(0.67, 0.21), **place).get_texts():
        text.set_parse_math(False)


def cut(text: str, width: int) -> str:
    """Text of at most so many characters."""
    return text if len(text) <= width else f"{text[: width - 1]}…"
