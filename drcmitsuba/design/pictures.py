"""Pictures of a design: the Pareto front, the façade, the course of the search, the tilts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from drcmitsuba.design.candidate import FacadeScore
from drcmitsuba.design.facade_tiles import Tiles
from drcmitsuba.design.measure import NAMES
from drcmitsuba.design.optimise import Front
from drcmitsuba.design.realise import pieces_of
from drcmitsuba.design.search import Optimum
from drcmitsuba.design.tilt_search import TiltOptimum
from drcmitsuba.report import plots
from drcmitsuba.report.plots import BLUE, GREY, INK, ORANGE

WALL, GLASS, FILM = "#D9D4CC", "#A9D8F2", "#E69F00"
"""Colours of plaster, clear panes and film; colour-blind readers can tell them apart."""
OTHER = ("#CC79A7", "#009E73")


def front(
    pareto: Front, named: Mapping[str, FacadeScore] | None = None, chosen: FacadeScore | None = None
) -> Figure:
    """Draw the aim over ASE, with the Pareto front.

    Dots on the line are façades that no other evaluated façade beats in both numbers; upper left is
    better. Small grey dots are all evaluations. `named` are compositions with names, such as the
    variants of a study; `chosen` is the optimum.
    """
    figure = Figure(figsize=(7.6, 5.4), layout="constrained")
    ax = figure.add_subplot()
    goal = pareto.problem.goal
    ax.set_title("More daylight or less sun?", loc="left", weight="bold", fontsize=11)
    ax.set_xlabel("ASE, sensors in the sun for too long [%]")
    ax.set_ylabel(f"{goal.title} [%]")
    everything = np.array([[c.hard.ase, c.hard.value] for c in pareto.history.candidates])
    if len(everything):
        ax.scatter(*everything.T, 6, color="#C8C8C8", zorder=1, linewidth=0, label="evaluated")
    points = np.array([[p.hard.ase, p.hard.value] for p in pareto.points]).reshape(-1, 2)
    ax.plot(*points.T, color=BLUE, marker="o", markersize=5, linewidth=1.4, zorder=3,
            drawstyle="steps-post", label="best façades")  # fmt: skip
    for label, score in (named or {}).items():
        ax.scatter(
            score.ase, score.value, 60, color=ORANGE, marker="D", edgecolor="white", zorder=4
        )
        ax.annotate(label, (score.ase, score.value), (7, 6), textcoords="offset points",
                    fontsize=9, color=INK, zorder=5)  # fmt: skip
    if chosen is not None:
        ax.scatter(chosen.ase, chosen.value, 230, color=INK, marker="*", edgecolor="white",
                   zorder=5, label="chosen")  # fmt: skip
    if goal.ase_limit is not None:
        text = f"limit {goal.ase_limit:g} %"
        ax.axvline(goal.ase_limit, color=GREY, linewidth=1, linestyle=(0, (4, 3)), label=text)
    plots.tidy(ax)
    left, right = ax.get_xlim()
    ax.set_xlim(min(-1.0, left), right + 0.08 * (right - left))  # room for the names
    # Named compositions may lie anywhere in the axes.
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def facade(
    tiles: Tiles, share: np.ndarray, materials: Sequence[str], film: str, title: str = ""
) -> Figure:
    """Draw a façade from outside, to scale, each tile filled by its `share` (tile, material).

    A mixed tile is cut in height as `realise` cuts it.
    """
    left, right, bottom, top = np.array(tiles.bounds).T
    size = np.array([right.max() - left.min(), top.max() - bottom.min()])
    wide = 8.6
    tall = float(np.clip(wide * size[1] / size[0], 1.2, 7.0))
    figure = Figure(figsize=(wide, tall + 1.5), layout="constrained")
    ax = figure.add_subplot()
    ax.set_title(title, loc="left", weight="bold", fontsize=11, parse_math=False)
    clear = [name for name in materials if name not in ("wall", film)]
    colours = {film: FILM, "wall": WALL}
    colours |= dict(zip(clear, (GLASS, *OTHER, *[GREY] * len(clear)), strict=False))
    ax.bar(left, top - bottom, right - left, bottom, align="edge", color=WALL, linewidth=0)
    for x in np.unique(left):
        column = np.flatnonzero(left == x)
        column = column[np.argsort(bottom[column])]
        width = right[column[0]] - x
        for low, high, name in pieces_of(tiles, share, column, list(materials), film, 0.0):
            ax.bar(x, high - low, width, low, align="edge", color=colours[name], linewidth=0)
    edges: dict[str, Any] = {"fill": False, "edgecolor": "white", "linewidth": 1.0}
    ax.bar(left, top - bottom, right - left, bottom, align="edge", **edges)
    margin = 0.02 * size.max()
    ax.set(xlim=(left.min() - margin, right.max() + margin), xlabel="seen from outside [m]")
    ax.set(ylim=(bottom.min() - margin, top.max() + margin), ylabel="height [m]")
    ax.set_aspect("equal")
    ax.spines[["top", "right"]].set_visible(False)
    area = tiles.area @ np.asarray(share)
    keys = [  # between dollars matplotlib would read a formula
        Patch(
            color=colours[name],
            label=f"{name}, {area[list(materials).index(name)]:.1f} m²".replace("$", r"\$"),
        )
        for name in (*clear, film, "wall")
        if area[list(materials).index(name)] > 1e-3
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    return figure


def panes(
    names: Sequence[str], areas: np.ndarray, film_share: np.ndarray, film: str, title: str = ""
) -> Figure:
    """Draw how much of a model's panes takes a film, a bar for all panes of one name.

    `areas` (pane,) are in m², `film_share` (pane,) is the film's part of each.
    """
    figure = Figure(figsize=(8.6, 1.9 + 0.4 * len(names)), layout="constrained")
    ax = figure.add_subplot()
    ax.set_title(title, loc="left", weight="bold", fontsize=11, parse_math=False)
    row, of_film = np.arange(len(names)), areas * film_share
    for what, colour, left, width in (
        (film, FILM, np.zeros_like(areas), of_film),
        ("as drawn", GLASS, of_film, areas - of_film),
    ):
        label = f"{what}, {width.sum():.1f} m²".replace("$", r"\$")
        ax.barh(row, width, 0.6, left, color=colour, linewidth=0, label=label)
    for k, (area, share) in enumerate(zip(areas, film_share, strict=True)):
        ax.text(area, k, f" {100 * share:.0f} %", va="center", fontsize=9, color=INK)
    ax.set_yticks(row, names, parse_math=False)
    ax.set(xlabel="area of the panes [m²]", ylim=(len(names) - 0.5, -0.5))
    ax.set_xlim(0, 1.1 * float(areas.max()))
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def search(optimum: Optimum) -> Figure:
    """Draw the objective of every evaluation, and the best feasible objective so far."""
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    ax = figure.add_subplot()
    ax.set_title("How the search went", loc="left", weight="bold", fontsize=11)
    candidates = optimum.history.candidates
    values = np.array([candidate.objective for candidate in candidates])
    holds = np.array([optimum.problem.holds(candidate) for candidate in candidates])
    number = np.arange(1, len(values) + 1)
    for kept, colour, label in ((holds, BLUE, "holds the limits"), (~holds, "#BBBBBB", "does not")):
        ax.scatter(number[kept], values[kept], 12, color=colour, linewidth=0, label=label)
    best = np.maximum.accumulate(np.where(holds, values, -np.inf))
    ax.plot(number[best > -np.inf], best[best > -np.inf], color=INK, linewidth=1.4, label="best")
    ax.set(xlabel="evaluation", ylabel="objective [%]")
    plots.tidy(ax)
    ax.legend(loc="lower right", frameon=False, fontsize=9)
    return figure


def tilts(optimum: TiltOptimum) -> Figure:
    """Draw the aim with its 95 % intervals, and ASE, over the tilt."""
    figure = Figure(figsize=(7.6, 5.8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    problem = optimum.problem
    candidates = {problem.at(c.x): c for c in optimum.history.candidates}
    at = np.array(sorted(candidates))
    hard = np.array([candidates[t].hard.aim for t in at])
    smooth = np.array([candidates[t].smooth.aim for t in at])
    intervals = [problem.simulated[t].aim for t in at]
    ends = np.array(
        [(value - i.low, i.high - value) for value, i in zip(hard, intervals, strict=True)]
    )
    above.errorbar(at, hard, np.maximum(ends, 0).T, fmt="o", markersize=4, linewidth=1, capsize=2,
                   color=BLUE, label="with its 95 % interval")  # fmt: skip
    above.plot(at, smooth, color="#BBBBBB", linewidth=1.2, zorder=1, label="smooth twin")
    above.set_title("Which tilt?", loc="left", weight="bold", fontsize=11)
    above.set_ylabel(f"{NAMES[problem.goal.aim]} [%]")
    ase = [candidates[t].hard.ase for t in at]
    below.plot(at, ase, color=ORANGE, marker="o", markersize=4, linewidth=1.2)
    limit = problem.goal.ase_limit
    below.axhline(limit, color=GREY, linewidth=1, linestyle=(0, (4, 3)))
    below.annotate(f"limit {limit:g} %", (at[0], limit), (2, 3), textcoords="offset points",
                   fontsize=9, color=GREY)  # fmt: skip
    below.set(xlabel=f"tilt of {problem.component} [°]", ylabel="ASE [%]")
    for ax in (above, below):
        ax.axvline(problem.at(optimum.best.x), color=INK, linewidth=1, zorder=1)
        plots.tidy(ax)
    above.legend(loc="best", frameon=False, fontsize=9)
    return figure
