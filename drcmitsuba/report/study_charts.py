"""Pictures of a study: parallel coordinates of keys and metrics, sDA against ASE."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.figure import Figure

from drcmitsuba.report.style import BLUE, GREY, NAME, tidy

MOST_AXES = 12
"""Largest number of keys in the picture of parallel coordinates."""
MOST_LABELS = 6
"""Largest number of labels beside an axis."""
MOST_NAMED = 60
"""Largest number of rows whose numbers stand beside their points."""


def charts(frame: pd.DataFrame, keys: Sequence[str]) -> dict[str, Figure]:
    """Draw the pictures of a study, by file name; rows without metrics are left out.

    Parameters
    ----------
    frame : pd.DataFrame
        Table of the study: the keys, `sDA` and `ASE` [%] with `…_low` and `…_high`.
    keys : sequence of str
        Columns that are keys.

    Returns
    -------
    dict of str to Figure
        Empty where no row has metrics.
    """
    known = frame[frame["sDA"].notna()]
    if len(known) == 0:
        return {}
    told = [key for key in keys if known[key].notna().any()]
    return {"parallel.png": _parallel(known, told), "scatter.png": _scatter(known)}


def _positions(column: pd.Series) -> tuple[np.ndarray, list[tuple[float, str]]]:
    """Places of the values of an axis, 0 to 1, and its labels; texts stand in their order."""
    if pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column):
        values = column.to_numpy(float)
        low, high = np.nanmin(values), np.nanmax(values)
        span = (high - low) or 1.0
        ticks = np.linspace(low, high, 3 if high > low else 1)
        return (values - low) / span, [((t - low) / span, f"{t:.4g}") for t in ticks]
    number, names = pd.factorize(column.astype(str))
    last = max(1, len(names) - 1)
    step = -(-len(names) // MOST_LABELS)
    return number / last, [(i / last, str(names[i])[-24:]) for i in range(0, len(names), step)]


def _parallel(known: pd.DataFrame, keys: Sequence[str]) -> Figure:
    """Lines through the values of each row, coloured by sDA."""
    columns = [*list(keys)[:MOST_AXES], "sDA", "ASE"]
    figure = Figure(figsize=(max(6.0, 1.9 * len(columns)), 4.8), layout="constrained")
    ax = figure.add_subplot()
    placed = [_positions(known[name]) for name in columns]
    at, share = np.array([p for p, _ in placed]), known["sDA"].to_numpy() / 100
    for row in range(at.shape[1]):
        colour = colormaps["viridis"](share[row])
        ax.plot(at[:, row], color=colour, alpha=max(0.25, 1 - at.shape[1] / 400), linewidth=1.3)
    for i, (_, labels) in enumerate(placed):
        ax.axvline(i, color=GREY, linewidth=0.8)
        for height, text in labels:
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
            ax.text(i + 0.04, height, text, fontsize=8, va="center", bbox=box, **NAME)
    ends = [name.rpartition(".")[0][-26:] + "\n" + name.rpartition(".")[2] for name in columns[:-2]]
    ax.set_xticks(range(len(columns)), [*ends, "sDA [%]", "ASE [%]"], fontsize=8, **NAME)
    ax.set_yticks([])
    ax.spines[:].set_visible(False)
    ax.set_xlim(-0.1, len(columns) - 0.6)
    ax.set_title(f"{len(known)} rows, coloured by sDA", loc="left", fontsize=10)
    return figure


def _scatter(known: pd.DataFrame) -> Figure:
    """SDA against ASE with the 95 % intervals of both."""
    figure = Figure(figsize=(5.6, 4.8), layout="constrained")
    ax = figure.add_subplot()
    x, y = known["ASE"].to_numpy(), known["sDA"].to_numpy()
    errors = {
        axis: np.abs(known[[f"{name}_low", f"{name}_high"]].to_numpy().T - values)
        for axis, name, values in (("xerr", "ASE", x), ("yerr", "sDA", y))
    }
    ax.errorbar(x, y, **errors, fmt="o", color=BLUE, ecolor=GREY, elinewidth=0.7, markersize=4)
    if len(known) <= MOST_NAMED:
        for (a, b), rows in known.groupby(["ASE", "sDA"])["row"]:
            numbers = ", ".join(map(str, rows[:3])) + ", …" * (len(rows) > 3)
            ax.annotate(numbers, (a, b), textcoords="offset points", xytext=(5, 4), fontsize=7)
    for limits, name in ((ax.set_xlim, "ASE"), (ax.set_ylim, "sDA")):
        low, high = known[f"{name}_low"].min(), known[f"{name}_high"].max()
        limits(max(-2.0, low - 5), min(104.0, high + 5))
    ax.set_xlabel("ASE [%]")
    ax.set_ylabel("sDA [%]")
    ax.set_title("rows of the study, 95 % intervals", loc="left", fontsize=10)
    tidy(ax)
    return figure
