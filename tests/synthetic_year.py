"""A year in which E is linear in the composition by formula: no simulation, exact gradients.

Not a room, but shaped like one: glass lets sun in to a depth that rises with the pane and falls
with the sun, film throws the sun deep and evenly and lets no sun through, and the sky comes in near
the window.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

MATERIALS = ("wall", "glass", "film", "shade")


@dataclass(frozen=True)
class Tiles:
    """Equal tiles, row by row from the bottom left."""

    bounds: np.ndarray

    @property
    def area(self):
        width, height = (
            self.bounds[:, 1] - self.bounds[:, 0],
            self.bounds[:, 3] - self.bounds[:, 2],
        )
        return width * height

    @classmethod
    def grid(cls, rows, segments, *, bottom=0.9, top=2.7, width=8.8):
        low = np.linspace(bottom, top, rows + 1)
        left = np.linspace(0, width, segments + 1)
        return cls(
            np.array(
                [
                    (left[i], left[i + 1], low[j], low[j + 1])
                    for j in range(rows)
                    for i in range(segments)
                ]
            )
        )


@dataclass(frozen=True)
class Found:
    open: mi.TensorXf
    shaded: mi.TensorXf
    direct: mi.TensorXf


@dataclass(frozen=True)
class SyntheticYear:
    """E[time, sensor] = Σ share[tile, material] · basis[tile, material, time, sensor]."""

    groups = None
    daylight = None
    eyes = None
    tiles: Tiles
    time: int = 240
    grid: tuple = (5, 8)
    materials: tuple = MATERIALS
    step_hours: float = 1.0

    @property
    def months(self):
        return 1 + np.arange(self.time) * 12 // self.time

    @property
    def sensors(self):
        across, deep = self.grid
        x = (np.arange(across) + 0.5) * 8.8 / across
        y = (np.arange(deep) + 0.5) * 9.0 / deep
        return np.repeat(x, deep), np.tile(y, across)

    @cached_property
    def arrays(self):
        """Basis of open, shaded and direct, each of shape (tile, material, time, sensor)."""
        rng = np.random.default_rng(7)
        t = np.arange(self.time)
        noon = np.sin(np.pi * ((t % 10) + 0.5) / 10)
        summer = -np.cos(2 * np.pi * (t + 0.5) / self.time)
        height = np.radians(noon * (38 + 22 * summer)) + 0.05
        sun = np.where(rng.random(self.time) < 0.5, 60_000 * np.sin(height), 0.0)
        sky = 8_000 + 12_000 * noon * (1 + 0.5 * summer)
        drift = 3.0 * np.cos(np.pi * ((t % 10) + 0.5) / 10)
        x, y = self.sensors
        left, right, bottom, top = self.tiles.bounds.T
        centre, level = (left + right) / 2, (bottom + top) / 2 - 0.8
        reach = level[:, None] / np.tan(height)
        area = self.tiles.area[:, None, None]
        beside = x[None, None, :] - centre[:, None, None] - drift[None, :, None]
        depth = y[None, None, :] - reach[:, :, None]
        spot = np.exp(-((depth / 0.7) ** 2) - (beside / 1.2) ** 2)
        direct = 0.65 * sun[None, :, None] * spot * np.minimum(area, 1.0)
        far = (y[None, None, :] + 0.3) / (level[:, None, None] + 0.3)
        near = np.hypot(far, (x[None, None, :] - centre[:, None, None]) / 2)
        diffuse = 0.02 * sky[None, :, None] * area / (1 + near**2) ** 1.5
        bounced = 0.0008 * (sky + sun)[None, :, None] * area
        deep = 0.004 * sun[None, :, None] * area * (0.4 + y[None, None, :] / 9)
        basis = np.zeros((3, len(area), 4, self.time, len(x)), np.float32)
        basis[0, :, 1] = direct + diffuse + bounced
        basis[0, :, 2] = 0.7 * diffuse + bounced + deep
        basis[1] = basis[0]
        basis[1, :, 1] = 0.15 * diffuse + 0.1 * bounced
        basis[2, :, 1] = direct
        return basis

    def illuminance(self, share, scale=None):
        shape = (self.time, len(self.sensors[0]))
        scale = scale or {}
        factor = dr.concat([mi.Float(scale.get(m, 1.0)) for m in self.materials])
        tiles, columns = share.shape
        scaled = share * mi.TensorXf(factor, (1, columns))
        row = dr.reshape(mi.TensorXf, scaled, (1, tiles * columns))
        return Found(*(dr.reshape(mi.TensorXf, row @ b, shape) for b in self._tensors))

    @cached_property
    def _tensors(self):
        return [mi.TensorXf(b.reshape(-1, b[0, 0].size)) for b in self.arrays]

    def built(self, share, E, scale=None):
        """Tiles that are built as they are mixed."""
        return E

    def at(self, hours):
        return SomeHours(self, hours)


@dataclass(frozen=True)
class SomeHours:
    """Some time stamps of a year by formula, each of which stands for several."""

    year: SyntheticYear
    hours: np.ndarray

    def __getattr__(self, name):
        return getattr(self.year, name)

    @property
    def months(self):
        return self.year.months[self.hours]

    @property
    def step_hours(self):
        return self.year.step_hours * self.year.time / len(self.hours)

    def illuminance(self, share, scale=None):
        E, sensors = self.year.illuminance(share, scale), len(self.year.sensors[0])
        entries = mi.UInt32((self.hours[:, None] * sensors + np.arange(sensors)).ravel())
        shape = len(self.hours), sensors
        of = (dr.gather(mi.Float, e.array, entries) for e in (E.open, E.shaded, E.direct))
        return Found(*(mi.TensorXf(e, shape) for e in of))
