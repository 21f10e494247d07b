"""Sensors of one grid in plan: tiles, discs, or arrows along their normals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.text import Text

from drcmitsuba.report import tiles
from drcmitsuba.report.sheets import facing_up
from drcmitsuba.report.style import COLOURS, INK, LINES, halo
from drcmitsuba.report.tiles import SensorTiles

LONG = 0.7
"""Length of an arrow over the distance of neighbouring sensors [–]."""


@dataclass(frozen=True, eq=False)
class SensorMarks:
    """Marks of the sensors of one grid."""

    name: str
    """Name of the grid."""
    sensors: np.ndarray
    """Indices of the sensors in the plan, shape (sensor,)."""
    at: np.ndarray
    """Positions x, y [m], shape (sensor, 2)."""
    normal: np.ndarray | None
    """East and north part of the normals (sensor, 2) where one does not face up, else None."""
    grid: SensorTiles | None
    """Tiles of the sensors; None where they form no rectangular grid, or do not face up."""

    @classmethod
    def of(cls, name: str, sensors: np.ndarray, values: xr.DataArray) -> SensorMarks:
        """Choose the marks of a grid, whose values (sensor,) have the coordinates of a plan."""
        at = np.column_stack([values[axis].values.astype(float) for axis in "xy"])
        if not facing_up(values).all():
            normal = np.column_stack([values[axis].values for axis in ("nx", "ny")])
            return cls(name, sensors, at, normal, None)
        return cls(name, sensors, at, None, SensorTiles.of(*at.T))

    @property
    def extent(self) -> np.ndarray:
        """Points that enclose the marks, shape (point, 2) [m]."""
        if self.grid is not None:
            return self.grid.corners.reshape(-1, 2)
        around = tiles.around(*self.at.T)
        if self.normal is None:
            return around
        return np.concatenate([around, self.at + self._length * self.normal])

    @property
    def middle(self) -> np.ndarray:
        """Position of the sensor nearest to the middle of all [m], shape (2,)."""
        away = self.at - self.at.mean(axis=0)
        return np.asarray(self.at[np.argmin((away**2).sum(axis=1))])

    @property
    def _length(self) -> float:
        """Length of the arrows [m]."""
        return LONG * tiles.spacing(*np.unique(np.round(self.at, 6), axis=0).T)

    def boundary(self, passed: np.ma.MaskedArray) -> np.ndarray:
        """Edges between sensors that `passed`, of all in the plan, and others, (edge, 2, 2) [m]."""
        if self.grid is None:
            return np.zeros((0, 2, 2))
        return self.grid.boundary(passed[self.sensors])

    def contours(self, ax: Axes, numbers: np.ma.MaskedArray, levels: Sequence[float]) -> list[Text]:
        """Draw lines of equal values, of all in the plan, between the grid's sensors.

        A grid of a single row has none. The labels of the lines are returned.
        """
        if self.grid is None or min(self.grid.shape) < 2:
            return []
        lines = ax.contour(
            *np.moveaxis(self.grid.centres, -1, 0), self.grid.grid(numbers[self.sensors]), levels,
            colors=LINES["contour"]["color"], linewidths=LINES["contour"]["linewidth"],
        )  # fmt: skip
        lines.set_path_effects(LINES["contour"]["path_effects"])
        labels = lines.clabel(fmt="{:g}".format, fontsize=9, colors=INK, inline_spacing=2)
        for text in labels:
            text.set_path_effects(halo(2.4, "white"))
        return list(labels)

    def draw(self, ax: Axes, shown: np.ma.MaskedArray, norm: Normalize, inch: float) -> Any:
        """Draw the values of all sensors in the plan at those of the grid.

        `inch` is the length of a metre on paper [inch].
        """
        colours: dict[str, Any] = {"cmap": COLOURS, "norm": norm}
        values = shown[self.sensors]
        if self.grid is not None:
            cells = self.grid.grid(values)
            return ax.pcolormesh(*self.grid.corners.T, cells.T, **colours, rasterized=True)
        x, y = self.at.T
        if self.normal is not None:
            along = self._length * self.normal
            return ax.quiver(
                x, y, *along.T, values, angles="xy", scale_units="xy", scale=1,
                width=0.08 * self._length, units="xy", **colours,
            )  # fmt: skip
        points = 0.6 * tiles.spacing(x, y) * inch * 72
        return ax.scatter(x, y, points**2, values, edgecolor="white", linewidth=0.5, **colours)
