"""Sun paths: where the sun stands, and the hours that close the shade.

The sky is drawn in stereographic projection: a direction at the height h is tan((90° − h)/2) from
the centre, so that angles on the sky stay angles and the horizon has the radius 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from drcmitsuba.report.captions import MONTHS
from drcmitsuba.report.style import GREY, INK, ORANGE, halo, head, new_axes
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.sun import sun_position
from drcmitsuba.sky.weather import Site

OPEN = "#56B4E9"
DAYS = (12, 1, 2, 3, 4, 5, 6)
"""Months on whose 21st day a path is drawn; the other half of the year has nearly the same."""
HEIGHTS = (0, 15, 30, 45, 60, 75)
"""Heights of the rings [deg]."""


def sun_path(
    closed: xr.DataArray, site: Site, *, step: float = 1.0, sun_time: str = "middle",
    ax: Axes | None = None, title: str = "", caption: str = "",
) -> Axes:  # fmt: skip
    """Draw the suns of a period in the sky, and mark those of hours that close the shade.

    Parameters
    ----------
    closed : DataArray of bool (time,)
        Whether the shade is closed, as `shade_closed` of E, with the coordinate `time`: starts of
        the intervals in local standard time.
    site : Site
        Place.
    step : float
        Length of the intervals [h].
    sun_time : {"middle", "instant"}
        Time of the sun within an interval, as for `sky.sun_position`.
    ax : Axes, optional
        Axes with `projection="polar"` to draw on; those of a new figure by default.
    title, caption : str
        Case, metric and period; place and weather in small letters below.

    Returns
    -------
    Axes
        Polar, north above, east on the right: angles are azimuths [rad], radii tan(zenith/2).
        Collections labelled "shade open …" and "shade closed …" hold the suns above the horizon.

    Raises
    ------
    InputError
        `closed` has other dims than `time`, or no time stamps.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> from drcmitsuba.report.year_figures import site_of
    >>> E = drcmitsuba.evaluate("office.toml").illuminance
    >>> axes = plots.sun_path(E["shade_closed"], site_of("office", E), title="office")
    """
    if closed.dims != ("time",) or "time" not in closed.coords or closed.size == 0:
        dims = ", ".join(f"{dim}: {size}" for dim, size in closed.sizes.items())
        raise InputError("sun path", "dims", dims or "none", "give one value for each time stamp")
    is_new = ax is None
    ax = new_axes((6.6, 7.8), projection="polar") if ax is None else ax
    sky: Any = ax
    sky.set(theta_zero_location="N", theta_direction=-1)
    time = closed["time"].values
    _paths(ax, site, int(time[0].astype("datetime64[Y]").astype(int)) + 1970)
    sun = sun_position(time, step, site, sun_time)
    zenith, azimuth = sun["solar_zenith"].values, np.radians(sun["solar_azimuth"].values)
    for name, which, style in (
        ("shade open", ~closed.values.astype(bool), {"color": OPEN, "s": 9, "linewidths": 0}),
        ("shade closed", closed.values.astype(bool),
         {"color": ORANGE, "s": 15, "edgecolors": INK, "linewidths": 0.4, "marker": "D"}),
    ):  # fmt: skip
        up = which & (zenith < 90)
        label = f"{name}: {step * up.sum():g} h with the sun up"
        ax.scatter(azimuth[up], radius(zenith[up]), label=label, zorder=3, **style)
    ax.set_ylim(0, 1)
    ax.set_yticks(radius(90.0 - np.array(HEIGHTS)), [f"{h}°" if h else "" for h in HEIGHTS])
    sky.set_rlabel_position(0 if site.latitude >= 0 else 180)
    azimuths = np.arange(0, 360, 30)
    named = {0: "N", 90: "E", 180: "S", 270: "W"}
    ax.set_xticks(np.radians(azimuths), [named.get(int(a), f"{a}°") for a in azimuths])
    ax.tick_params(labelsize=9, colors=INK)
    for text in ax.get_yticklabels():
        text.set(color=GREY, path_effects=halo(2.0, "white"))
    ax.grid(color="#DDDDDD", linewidth=0.7)
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.07), frameon=False, fontsize=9.5,
              markerscale=1.6, borderaxespad=0)  # fmt: skip
    head(ax, title, caption, above=22)
    if is_new:  # a circle leaves no more room for further lines
        figure, lines = ax.get_figure(root=True), ax.get_title(loc="left").count("\n")
        figure.set_figheight(figure.get_figheight() + 0.19 * lines)
    return ax


def radius(zenith: np.ndarray) -> np.ndarray:
    """Distance from the centre tan(zenith/2) of directions at zenith angles [deg]."""
    return np.tan(np.radians(zenith) / 2)


def _paths(ax: Axes, site: Site, year: int) -> None:
    """Draw paths of the sun on the 21st of the months, and the hours on the longest of them."""
    longest = 6 if site.latitude >= 0 else 12
    minutes = np.arange(0, 24 * 60 + 1, 5).astype("timedelta64[m]")
    for month in DAYS:
        day = np.datetime64(f"{year}-{month:02d}-21", "m")
        sun = sun_position(day + minutes, 1.0, site, "instant")
        zenith, azimuth = sun["solar_zenith"].values, np.radians(sun["solar_azimuth"].values)
        up = np.where(zenith < 90, radius(zenith), np.nan)
        if np.isnan(up).all():
            continue
        ax.plot(azimuth, up, color=GREY, linewidth=0.9, zorder=2)
        if month in (3, 6, 12):
            noon = int(np.nanargmin(up))
            ax.annotate(
                f"21 {MONTHS[month - 1]}", (azimuth[noon], up[noon]), (0, -13), fontsize=9,
                textcoords="offset points", ha="center", path_effects=halo(2.4, "white"), zorder=4,
            )  # fmt: skip
        if month == longest:
            for hour in range(24):
                at = 12 * hour
                if up[at] < 1:
                    ax.annotate(
                        f"{hour}", (azimuth[at], up[at]), (0, 5), fontsize=8, color=GREY,
                        textcoords="offset points", ha="center", zorder=4,
                        path_effects=halo(2.0, "white"),
                    )  # fmt: skip
