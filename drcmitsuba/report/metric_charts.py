"""Metrics of a period and of its months: bars and lines with their 95 % intervals.

References
----------
.. [1] C. Bauer, S. Wittkopf, "Annual daylight simulations with EvalDRC", Journal of Facade Design
   and Engineering 3, 2015, figure 11.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from drcmitsuba.report.captions import MONTHS
from drcmitsuba.report.standing import SheetFigure
from drcmitsuba.report.style import BLUE, GREY, INK, METRICS, NAME, ORANGE, letters, tidy

ACCEPTED, PREFERRED = 55, 75
"""Spatial daylight autonomy that LM-83 calls nominally accepted, preferred [%]."""
Months = Sequence[Mapping[str, float] | None]
"""Twelve values with their 95 % intervals, January first; None for a month without hours."""


def monthly(
    metrics: Mapping[str, Any],
    *,
    title: str = "",
    caption: str = "",
    period: str = "year",
    rated: bool = False,
    shade: bool = True,
) -> Figure:
    """Metrics of a period as bars and monthly metrics as lines, like figure 11 of [1].

    Parameters
    ----------
    metrics : mapping
        As in `metrics.json`: `sDA`, `ASE`, `shade_closed` as `{"value", "low", "high"}` [%], and
        `msDA`, `MSE`, `shade_closed_monthly` as 12 of these, None for a month without hours; those
        of the shade are means of `groups`, where there are any.
    title : str
        Name of the case, above the panels.
    caption : str
        Weather, period and accuracy, in small letters below the title.
    period : str
        Name of the period of `sDA` and `ASE`.
    rated : bool
        True draws the levels of LM-83, valid only for LM-83's threshold and hours.
    shade : bool
        True if the case has a shade.

    Returns
    -------
    Figure
        Error bars and light bands are 95 % intervals.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> figure = plots.monthly(result.metrics, title="office", shade=False)
    """
    figure = SheetFigure(figsize=(9.6, 4.3))
    year, months = figure.subplots(1, 2, width_ratios=[1, 2.6])
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.1, top=0.76, wspace=0.42)
    _head(figure, title, caption)
    for ax, name in ((year, period), (months, "months")):
        ax.set_title(name, loc="left", fontsize=10, color=GREY, pad=24, **NAME)
        ax.set_ylim(0, 100)
        ax.set_yticks(range(0, 101, 10))
        tidy(ax, "#E4E4E4", 0.7, axis="y")

    for at, name in enumerate(("sDA", "ASE")):
        _bar(year, at, metrics[name], METRICS[name])
    year.set(xlim=(-0.6, 1.6), ylabel="share of sensors [%]")
    year.set_xticks([0, 1], ["sDA", "ASE"])
    year.tick_params(axis="x", length=0)
    for level, name in ((ACCEPTED, "accepted"), (PREFERRED, "preferred")) if rated else ():
        year.axhline(level, color=INK, linewidth=0.9, linestyle=(0, (1, 1.5)))
        text = f"{name}\n(sDA {level} %)"
        year.text(1.65, level, text, fontsize=8, va="center", color=INK, linespacing=1.1)

    _line(months, metrics["msDA"], "msDA, of sensors", color=METRICS["msDA"], marker="o")
    _line(months, metrics["MSE"], "MSE, of sensors", color=METRICS["MSE"], marker="s")
    if shade:
        closed = f"shade closed for {metrics['shade_closed']['value']:.1f} % of the "
        closed += "year's hours" if period == "year" else "period's hours"
        if (groups := len(metrics.get("groups", {}))) > 1:
            closed += f", mean of {groups} groups"
        months.set_title(closed, loc="right", fontsize=10, color=GREY, pad=24)
        style: dict[str, Any] = {"color": GREY, "marker": ".", "linestyle": "--"}
        _line(months, metrics["shade_closed_monthly"], "shade closed, of hours", **style)
    months.set(xlim=(0.7, 12.3), ylabel="share [%]")
    months.set_xticks(range(1, 13), MONTHS)
    axes = year.xaxis, year.yaxis, months.xaxis, months.yaxis
    figure.stands(("monthly", shade), *axes, _legend(months))
    return figure


def season(
    title: str, *, design: Months, clear: Months, opening: Months, relative: Sequence[float | None]
) -> Figure:
    """Draw msDA of a façade beside clear glazing and an unobstructed opening.

    Parameters
    ----------
    title : str
        Name of the case, above the panels.
    design, clear, opening : sequence of 12 mappings or None
        msDA by month, as `{"value", "low", "high"}` [%]; None for a month without hours.
    relative : sequence of 12 floats or None
        Ratio of the façade's msDA to that of the opening [%].

    Returns
    -------
    Figure
        Light bands are 95 % intervals.

    Examples
    --------
    >>> from drcmitsuba.report import plots
    >>> clear = [{"value": m, "low": m - 2.0, "high": m + 2.0} for m in range(40, 100, 5)]
    >>> months = {"design": clear, "clear": clear, "opening": clear}
    >>> figure = plots.season("office", **months, relative=[100.0] * 12)
    """
    figure = Figure(figsize=(9.6, 4.3))
    ax, share = figure.subplots(1, 2, width_ratios=[1.5, 1])
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.1, top=0.8, wspace=0.2)
    _head(figure, title)
    _line(ax, opening, "unobstructed opening, no shade", color=GREY, marker=".")
    _line(ax, clear, "clear glazing", color=ORANGE, marker="s")
    _line(ax, design, "design", color=BLUE, marker="o")
    ratio = [np.nan if v is None else v for v in relative]
    share.bar(np.arange(1, 13), ratio, color=BLUE, width=0.7)
    share.set_title("msDA over that of the opening [%]", loc="left", fontsize=10, color=GREY)
    share.set_ylim(0, max(105.0, np.nanmax([*ratio, 0.0]) + 5))
    share.tick_params(axis="x", labelsize=8)
    ax.set(ylabel="msDA [%]", ylim=(0, 105))
    for axes in (ax, share):
        axes.set_xlim(0.4, 12.6)
        axes.set_xticks(range(1, 13), MONTHS)
        tidy(axes, "#E4E4E4", 0.7, axis="y")
    _legend(ax)
    return figure


def _head(figure: Figure, title: str, caption: str = "") -> None:
    """Write the title above the panels, and the caption below it."""
    size = letters(title, 0.9 * figure.get_figwidth(), 12)
    bold: dict[str, Any] = {"fontsize": size, "weight": "bold", "color": INK}
    figure.text(0.075, 0.955, title, va="center", **bold, **NAME)
    figure.text(0.075, 0.9, caption, va="center", fontsize=8, color=GREY, **NAME)


def _legend(ax: Axes) -> Legend:
    """Name the lines above a panel."""
    legend: dict[str, Any] = {"ncols": 3, "frameon": False, "fontsize": 9, "borderaxespad": 0.3}
    return ax.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), borderpad=0, **legend)


def _bar(ax: Axes, at: int, interval: Mapping[str, float], colour: str) -> None:
    """Draw a bar with its interval and its value, written where no line crosses it."""
    value, low, high = (interval[key] for key in ("value", "low", "high"))
    ax.bar(at, value, width=0.72, color=colour)
    reach = [[value - low], [high - value]]
    ax.errorbar(at, value, reach, color=INK, capsize=5, linewidth=1.2, clip_on=False)
    inside = low >= 12  # the error bar stays clear of a number at the foot of the bar
    y, colour, va = (4.0, "white", "center") if inside else (high + 1.5, INK, "bottom")
    text = f"{value:.1f} %"
    ax.text(at, y, text, ha="center", va=va, weight="bold", fontsize=10, color=colour)


def _line(ax: Axes, intervals: Months, label: str, **style: Any) -> None:
    """Draw a monthly line and its band, broken where a month has no hours."""
    rows = [[i["value"], i["low"], i["high"]] if i is not None else [np.nan] * 3 for i in intervals]
    value, low, high = np.array(rows, dtype=float).T
    month = np.arange(1, 13)
    ax.fill_between(month, low, high, color=style["color"], alpha=0.18, linewidth=0)
    ax.plot(month, value, label=label, linewidth=1.8, markersize=4.5, clip_on=False, **style)
