"""Sheet of a plan: axes to scale, a place for the colour bar, the north arrow, the legend."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from drcmitsuba.report.standing import SheetFigure
from drcmitsuba.report.style import GREY, INK, LINES, NAME

COLUMNS = 3
"""Number of entries in a row of the legend."""
LEFT, RIGHT, LEAST, LARGEST = 0.75, 1.15, 5.2, 5.4
"""Space beside the plan, least width of a sheet, and longest side of a plan [inch]."""


@dataclass(frozen=True)
class PlanSheet:
    """All that decides how the standing parts of a plan look.

    The layout is in inches, so that the plan's scale and the text's size hold for a room of any
    shape.
    """

    view: tuple[float, ...]
    """Lowest x and y, and highest ones, that the plan shows [m]."""
    heading: int
    """Number of lines of the title."""
    small: int
    """Number of lines of the caption."""
    legend: tuple[tuple[str, str], ...]
    """Lines by their name in `style.LINES`, and their names in the legend."""

    @classmethod
    def begun(
        cls, view: np.ndarray, title: str, caption: str, legend: tuple[tuple[str, str], ...]
    ) -> tuple[SheetFigure, Axes, Axes]:
        """Figure of a sheet with its title and caption, and the axes of plan and colour bar.

        `view` are the lower left and upper right corner x, y [m].
        """
        wide = _across(view) - LEFT
        heading = textwrap.wrap(title, int(wide / 0.1))  # bold letters are 0.09 inch wide
        small = textwrap.wrap(caption, int(wide / 0.073))
        sheet = cls(tuple(view.ravel().tolist()), len(heading), len(small), legend)
        figure, ax, bar = sheet._drawn()
        across, high = sheet.size
        start = LEFT / across, 1 - 0.12 / high
        figure.text(*start, "\n".join(heading), va="top", fontsize=11, weight="bold", **NAME)
        below = start[0], start[1] - (0.02 + 0.21 * len(heading)) / high
        figure.text(*below, "\n".join(small), va="top", fontsize=8, color=GREY, **NAME)
        return figure, ax, bar

    @property
    def corners(self) -> np.ndarray:
        """Lower left and upper right corner x, y of the view [m]."""
        return np.reshape(self.view, (2, 2))

    @cached_property
    def rows(self) -> int:
        """Number of rows of the legend."""
        return -(-len(self.legend) // COLUMNS)

    @cached_property
    def bottom(self) -> float:
        """Space below the plan [inch]."""
        return 0.6 + 0.1 * bool(self.rows) + 0.25 * self.rows

    @cached_property
    def size(self) -> tuple[float, float]:
        """Width and height [inch]."""
        top = 0.3 + 0.22 * self.heading + 0.17 * self.small
        return _across(self.corners), self.bottom + float(_plan_size(self.corners)[1]) + top

    def _drawn(self) -> tuple[SheetFigure, Axes, Axes]:
        """Figure with the standing parts alone."""
        view, (width, height), (across, high) = self.corners, _plan_size(self.corners), self.size
        figure = SheetFigure(figsize=self.size)
        at = LEFT / across, self.bottom / high, width / across, height / high
        ax = figure.add_axes(at)
        ax.set(xlim=view[:, 0], xlabel="x, east [m]", ylim=view[:, 1], ylabel="y, north [m]")
        ax.set_aspect("equal")
        beside = LEFT + width + 0.2
        bar = figure.add_axes(
            (beside / across, self.bottom / high, 0.18 / across, (height - 0.75) / high)
        )
        arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "mutation_scale": 16}
        end = (beside + 0.09) / across, (self.bottom + height) / high
        tail = end[0], end[1] - 0.5 / high
        fraction = "figure fraction"
        north = ax.annotate("", end, tail, fraction, fraction, arrowprops=arrow)
        style = {"va": "top", "weight": "bold", "fontsize": 11}
        name = figure.text(end[0] + 0.12 / across, end[1], "N", **style)
        look = self.view, self.heading, self.small, self.rows
        figure.stands((type(self), *look), ax.xaxis, ax.yaxis, north, name)
        figure.also_stands(self.legend, *self._legend(figure, ax))
        return figure, ax, bar

    def _legend(self, figure: SheetFigure, ax: Axes) -> list[Artist]:
        """Draw the legend of lines below the plan; none without lines."""
        if not self.legend:
            return []
        handles = [Line2D([], [], label=label, **LINES[name]) for name, label in self.legend]
        legend = figure.legend(
            handles=handles, loc=3, bbox_to_anchor=(ax.get_position().x0, 0), ncols=COLUMNS,
            frameon=False, fontsize=9,
        )  # fmt: skip
        for text in legend.get_texts():
            text.set_parse_math(False)
        return [legend]


def _plan_size(view: np.ndarray) -> np.ndarray:
    """Width and height of a view on paper [inch]."""
    size = view[1] - view[0]
    return np.asarray(LARGEST * size / size.max())


def _across(view: np.ndarray) -> float:
    """Width of the sheet of a view [inch]."""
    return max(LEFT + float(_plan_size(view)[0]) + RIGHT, LEAST)
