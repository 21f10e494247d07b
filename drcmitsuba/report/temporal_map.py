"""Temporal maps: values of a year by the day and the hour of the day."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize

from drcmitsuba.report.captions import MONTHS
from drcmitsuba.report.colour_scale import colour_bar, label_of, scale
from drcmitsuba.report.style import COLOURS, head, new_axes
from drcmitsuba.runtime.errors import InputError

MINUTES = 60
"""Largest height of a cell [min]."""
SHORT = 100
"""Days up to which a period is labelled by day, not by month."""
MOST_LABELS = 9
"""Largest number of labels by day."""


def temporal_map(
    values: xr.DataArray, *, ax: Axes | None = None, title: str = "", caption: str = "",
    label: str | None = None, norm: Normalize | None = None, cmap: str | Colormap = COLOURS,
) -> Axes:  # fmt: skip
    """Draw values over the days of the period and the hours of the day.

    Parameters
    ----------
    values : DataArray (time,)
        Illuminance of a sensor or its mean over sensors [lx], DGP [–], or another quantity, with
        the coordinate `time`, the starts of the intervals in local standard time. Days without
        time stamps, such as weekends, are left out; other gaps, and NaN, stay blank.
    ax : Axes, optional
        Axes to draw on; those of a new figure by default.
    title, caption : str
        Case, metric and period; place, weather and accuracy in small letters below.
    label : str, optional
        Text at the colour bar; the long name and units of `values` by default.
    norm : Normalize, optional
        Scale of the colours; from 0 to the largest value by default. Values beyond its limits take
        the colour of the limit.
    cmap : str or Colormap
        Colours.

    Returns
    -------
    Axes
        Its image, `images[0]`, holds one cell a day and time of day.

    Raises
    ------
    InputError
        `values` has other dims than `time`, or no time stamps.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> mean = result.illuminance["total"].mean("time", keep_attrs=True)
    >>> axes = plots.temporal_map(result.illuminance["total"].mean("sensor", keep_attrs=True))
    """
    days, minutes, cells = day_by_hour(values)
    ax = new_axes((9.0, 3.9)) if ax is None else ax
    known = np.ma.masked_invalid(cells)
    norm = scale(known, norm)
    step = minutes[1] - minutes[0] if len(minutes) > 1 else MINUTES
    image = ax.imshow(
        np.ma.clip(known, norm.vmin, norm.vmax), cmap=cmap, norm=norm, origin="lower",
        aspect="auto", interpolation="nearest",
        extent=(0, len(days), minutes[0] / 60, (minutes[-1] + step) / 60),
    )  # fmt: skip
    ax.set_xticks(*_labels(days))
    ax.set_ylabel("hour of the day,\nstandard time [h]")
    bar = colour_bar(image, known)
    bar.set_label(label_of(values) if label is None else label)
    head(ax, title, caption)
    return ax


def day_by_hour(values: xr.DataArray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sort values (time,) into days and times of the day.

    Returns
    -------
    tuple
        Days with time stamps, datetime64[D] (day,); minutes since midnight at which the rows begin,
        an equal step apart, (row,); the values, NaN where there is none, (row, day). A value
        fills the least time between two stamps of a day, or `MINUTES`.
    """
    if values.dims != ("time",) or "time" not in values.coords or values.size == 0:
        dims = ", ".join(f"{dim}: {size}" for dim, size in values.sizes.items())
        remedy = "give one value for each time stamp, as E.mean('sensor')"
        raise InputError("temporal map", "dims", dims or "none", remedy)
    time = values["time"].values.astype("datetime64[m]")
    days, column = np.unique(time.astype("datetime64[D]"), return_inverse=True)
    minute = (time - days[column]).astype(int)
    step = int(np.gcd.reduce(np.diff(np.unique(minute)), initial=MINUTES))
    order = np.lexsort((minute, column))
    between = np.diff(minute[order])[np.diff(column[order]) == 0]
    rows = int(between[between > 0].min(initial=MINUTES)) // step  # of a value
    row = (minute - minute.min()) // step
    cells = np.full((int(row.max()) + rows, len(days)), np.nan)
    for k in range(rows):
        cells[row + k, column] = values.values
    return days, minute.min() + step * np.arange(len(cells)), cells


def _labels(days: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Columns and texts of the labels: first days of the months, or single days."""
    months = days.astype("datetime64[M]")
    if len(days) > SHORT:
        numbers = months.astype(int)  # since January 1970
        at = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        return at, [MONTHS[int(m) % 12] for m in numbers[at]]
    at = np.arange(0, len(days), -(-len(days) // MOST_LABELS))
    names = (str(day).split("-") for day in days[at])
    return at + 0.5, [f"{int(day)} {MONTHS[int(month) - 1]}" for _, month, day in names]
