"""Mountain plots: values of a grid of sensors as the height above the plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report.colour_scale import label_of, scale
from drcmitsuba.report.plan_view import positions
from drcmitsuba.report.style import COLOURS, INK, LINES, head, new_axes
from drcmitsuba.report.tiles import SensorTiles
from drcmitsuba.runtime.errors import InputError

HEIGHT = 0.55
"""Height of the picture over the longest side of the plan [–]."""
MOST_FACES = 64
"""Largest number of faces along a side of a grid; finer grids are drawn by every n-th sensor."""


def mountain(
    values: xr.DataArray, *, ax: Axes | None = None, title: str = "", caption: str = "",
    label: str | None = None, norm: Normalize | None = None,
    room: Sequence[np.ndarray] = (), glazing: Sequence[np.ndarray] = (),
    elevation: float = 32.0, azimuth: float = 215.0,
) -> Axes:  # fmt: skip
    """Draw values over the plan as a mountain, whose height and colour are the value.

    Parameters
    ----------
    values : DataArray (sensor,)
        Illuminance [lx] or another quantity with the coordinates `x` and `y` [m], and `grid` where
        there are several; NaN is left out.
    ax : Axes, optional
        Axes with `projection="3d"` to draw on; those of a new figure by default.
    title, caption : str
        Case, metric and period; place, weather and accuracy in small letters below.
    label : str, optional
        Text at the vertical axis; the long name and units of `values` by default.
    norm : Normalize, optional
        Scale of the colours; from 0 to the largest value by default.
    room, glazing : sequence of arrays (n, 2)
        Outlines of rooms, and lines along the glazing x, y [m], drawn on the floor.
    elevation, azimuth : float
        Place from which the mountain is seen: degrees above the plan, and from north by east.

    Returns
    -------
    Axes

    Raises
    ------
    InputError
        The sensors of a grid form no rectangle of at least two rows and columns.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> mean = result.illuminance["total"].mean("time", keep_attrs=True)
    >>> axes = plots.mountain(mean, title="mean of the year")
    """
    positions(values)
    numbers = np.ma.masked_invalid(values.values.astype(float))
    norm = scale(numbers, norm)
    ax = new_axes((7.6, 5.2), projection="3d") if ax is None else ax
    space: Any = ax
    low = min(0.0, float(numbers.min()))
    for name, sensors in _grids(values).items():
        tiles = _tiles(values, sensors)
        if tiles is None:
            got = f"the sensors {name} form no grid of rows and columns".replace("  ", " ")
            raise InputError("mountain", "sensors", got, "draw a plan or a section of them")
        cells = tiles.grid(numbers[sensors]).filled(np.nan)
        x, y = np.moveaxis(tiles.centres, -1, 0)
        space.plot_surface(
            x, y, cells, cmap=COLOURS, norm=norm, edgecolor=INK, linewidth=0.25,
            rcount=MOST_FACES, ccount=MOST_FACES,
        )  # fmt: skip
    for kind, lines in (("room", room), ("glazing", glazing)):
        for line in lines:
            ends = np.vstack([line, line[:1]]) if kind == "room" else np.asarray(line)
            space.plot(*ends.T, low, **LINES[kind])
    sides = np.ptp([ax.get_xlim(), ax.get_ylim()], axis=1)
    space.set_box_aspect((*sides, HEIGHT * sides.max()), zoom=0.95)
    space.set_zlim(low, max(float(numbers.max()), low + 1e-9))
    space.view_init(elev=elevation, azim=90 - azimuth)
    for axis in (space.xaxis, space.yaxis, space.zaxis):
        axis.set_pane_color((1, 1, 1, 0))
    space.set(xlabel="x, east [m]", ylabel="y, north [m]", zlabel="")
    bar = ax.get_figure(root=True).colorbar(
        ScalarMappable(norm, colormaps[COLOURS]), ax=ax, shrink=0.6, pad=0.08
    )
    bar.set_label(label_of(values) if label is None else label)
    head(ax, title, caption)
    return ax


def forms_rows(values: xr.DataArray) -> bool:
    """Whether the sensors of all grids form rows and columns, as a mountain needs them."""
    return all(_tiles(values, sensors) is not None for sensors in _grids(values).values())


def _grids(values: xr.DataArray) -> dict[str, np.ndarray]:
    return sensors_by_grid(values) or {"": np.arange(values.size)}


def _tiles(values: xr.DataArray, sensors: np.ndarray) -> SensorTiles | None:
    """Tiles of a grid of at least two rows and columns; None of others."""
    tiles = SensorTiles.of(*(values[axis].values[sensors].astype(float) for axis in "xy"))
    return None if tiles is None or min(tiles.shape) < 2 else tiles
