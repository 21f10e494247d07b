"""Picture of the walls of a model with the windows that a search has found."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from drcmitsuba.design.pictures import FILM, GLASS, WALL
from drcmitsuba.report.plots import GREY
from drcmitsuba.scene.tiled_walls import TiledWalls, WallPane

DRAWN = "#6F8796"
"""Colour of panes that were there before."""
EDGE = {"edgecolor": "white", "linewidth": 1.0}


def wall_picture(
    walls: TiledWalls, panes: Sequence[WallPane], materials: tuple[str, str], title: str = ""
) -> Figure:
    """Draw walls side by side from outside, to scale, each with its panes and its space's name.

    `materials` are the clear one and the film; white lines are the edges of the tiles.
    """
    colours = dict(zip(materials, (GLASS, FILM), strict=True))
    size = defaultdict(float, {"wall": walls.area})
    bounds = np.array([wall.outline.bounds for wall in walls.walls])
    feet = np.array([wall.floor - wall.plane.corner[2] for wall in walls.walls])
    wide = walls.places[-1] + bounds[-1, 2] - bounds[-1, 0]
    low, high = (bounds[:, 1] - feet).min(), (bounds[:, 3] - feet).max()
    figure = Figure(
        figsize=(8.6, float(np.clip(8.6 * (high - low) / wide, 1.2, 7.0)) + 1.5),
        layout="constrained",
    )
    ax = figure.add_subplot()
    ax.set_title(title, loc="left", weight="bold", fontsize=11, parse_math=False)

    def draw(shape: Any, wall: int, **style: Any) -> None:
        move = [walls.places[wall] - bounds[wall, 0], -feet[wall]]
        _add(ax, shapely.transform(shape, lambda uv: uv + move), **style)

    for w, wall in enumerate(walls.walls):
        draw(wall.outline, w, facecolor=WALL, linewidth=0)
        draw(wall.openings, w, facecolor=DRAWN, linewidth=0)
        size["as drawn"] += wall.openings.area
    for tile in walls.tiles:
        draw(tile.shape, tile.wall, fill=False, **EDGE)
    for pane in panes:
        draw(pane.shape, pane.wall, facecolor=colours[pane.name], **EDGE)
        size[pane.name] += pane.shape.area
    size["wall"] -= sum(area for name, area in size.items() if name != "wall")
    margin = 0.02 * max(wide, high - low)
    ax.set(xlim=(-margin, wide + margin), ylim=(low - margin, high + margin))
    ax.set(xlabel="walls side by side, seen from outside [m]", ylabel="height above the floor [m]")
    ax.set_aspect("equal")
    ax.spines[["top", "right"]].set_visible(False)
    for w, wall in enumerate(walls.walls):
        at = walls.places[w], high + 0.3 * margin
        ax.text(*at, f"{wall.space} ({wall.facing})", fontsize=8, color=GREY, parse_math=False)
    kinds = {**colours, "as drawn": DRAWN, "wall": WALL}
    keys = [  # between dollars matplotlib would read a formula
        Patch(color=colour, label=f"{name}, {size[name]:.1f} m²".replace("$", r"\$"))
        for name, colour in kinds.items()
        if size[name] > 1e-3
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    return figure


def _add(ax: Axes, shape: Any, **style: Any) -> None:
    """Add the polygons of a shape, with their holes."""
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon":
            rings = [Path(np.array(ring.coords)) for ring in (part.exterior, *part.interiors)]
            ax.add_patch(PathPatch(Path.make_compound_path(*rings), **style))
