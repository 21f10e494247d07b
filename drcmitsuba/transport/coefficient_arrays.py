"""Arrays of coefficients C with their dims, and statistics of replicates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat_indices, row_and_column
from drcmitsuba.schema import describe
from drcmitsuba.transport.deposit import Irradiance
from drcmitsuba.transport.launch_size import SENSORS

PARTS = ("straight", "direct", "interreflected")
"""Parts of C, each with its standard error."""


def without_values(labels: list[str], points: np.ndarray) -> xr.Dataset:
    """Bins and sensors of coefficients; points (sensor, 3) are the positions [m]."""
    coords: dict[str, Any] = {"bin": np.array(labels, dtype=object)}
    coords |= {axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")}
    return xr.Dataset(coords=coords)


def with_values(
    empty: xr.Dataset, parts: dict[str, np.ndarray], replicates: np.ndarray
) -> xr.Dataset:
    """Coefficients [sr] with their dims: parts (sensor, bin) and (replicate, sensor, bin)."""
    data: dict[str, Any] = {name: (("sensor", "bin"), values) for name, values in parts.items()}
    data["replicates"] = (("replicate", "sensor", "bin"), replicates)
    return describe(empty.assign(data))


def dark(
    labels: list[str], points: np.ndarray, replicates: int
) -> Iterator[tuple[slice, xr.Dataset]]:
    """Coefficients of 0."""
    for start in range(0, len(points), SENSORS):
        here = slice(start, min(start + SENSORS, len(points)))
        dark = np.zeros((replicates, here.stop - start, len(labels)), np.float32)
        parts = {name + suffix: dark[0] for name in PARTS for suffix in ("", "_se")}
        yield here, with_values(without_values(labels, points[here]), parts, dark)


@dataclass(frozen=True)
class Bins:
    """Bins of C: those that are followed, and others, of which C is 0."""

    labels: list[str]
    place: np.ndarray
    """Place of each bin among those that are followed, int, shape (bin,); −1 for others."""

    @classmethod
    def of(cls, labels: list[str], followed: list[str] | None = None) -> Bins:
        """Bins by their labels; by default all are followed."""
        if followed is None or len(followed) == len(labels):
            return cls(labels, np.arange(len(labels)))
        number = {label: i for i, label in enumerate(followed)}
        return cls(labels, np.array([number.get(label, -1) for label in labels]))

    def joined(self, light: tuple[mi.Float, mi.Float], rows: int) -> mi.Float:
        """Values of all bins, flat (row, bin), from those of sky and suns that are followed."""
        first, number = (dr.width(part) // rows for part in light)
        known = flat_indices(np.where(self.place < 0, first + number, self.place))
        row, bin = row_and_column(dr.arange(mi.UInt32, rows * len(known)), len(known))
        at, out = dr.gather(mi.UInt32, known, bin), mi.Float(0)
        for start, size, part in zip((0, first), (first, number), light, strict=True):
            if size:
                begin, count = dr.opaque(mi.UInt32, start), dr.opaque(mi.UInt32, size)
                own = (at >= begin) & (at < begin + count)
                out += dr.gather(mi.Float, part, row * count + at - begin, own)
        return mi.Float(out)

    def put(self, out: mi.Float, light: Irradiance, row: int) -> None:
        """Put the values of light into flat (row, bin), from a row on."""
        values = self.joined((light.sky.array, light.sun.array), len(light.sky))
        first = dr.opaque(mi.UInt32, row * len(self.labels))
        dr.scatter(out, values, dr.arange(mi.UInt32, dr.width(values)) + first)
        dr.eval(out)


@dataclass
class Spread:
    """Sums over replicates that are added one after another: their mean and its standard error.

    Differences from the first replicate keep the digits.
    """

    first: mi.Float | None = None
    total: mi.Float | None = None
    squares: mi.Float | None = None
    count: int = 0

    def add(self, values: mi.Float, replicates: int) -> None:
        """Add some replicates, one after another in an array; nothing is evaluated yet."""
        size = dr.width(values) // replicates
        if size == 0:
            self.first = self.total = self.squares = values
            return
        if self.first is None:
            self.first = dr.gather(mi.Float, values, dr.arange(mi.UInt32, size))
            self.total, self.squares = dr.zeros(mi.Float, size), dr.zeros(mi.Float, size)
        number = dr.opaque(mi.UInt32, replicates)
        self.total, self.squares = _added(values, self.first, self.total, self.squares, number)
        self.count += replicates

    @property
    def sums(self) -> tuple[mi.Float | None, ...]:
        """Arrays to be evaluated after `add`."""
        return self.first, self.total, self.squares

    def mean_and_error(self) -> tuple[mi.Float, mi.Float]:
        """Mean of all replicates, and its standard error, flat."""
        assert self.first is not None
        if dr.width(self.first) == 0:
            return self.first, self.first
        n = dr.opaque(mi.Float, self.count)
        off = self.total / n
        squares = dr.maximum(self.squares - n * dr.square(off), 0)
        return self.first + off, dr.sqrt(squares / (n * (n - 1)))


@dataclass
class Statistics:
    """Parts of C in sums over replicates, apart for sky and suns: they are never joined."""

    spreads: dict[str, tuple[Spread, Spread]] = field(
        default_factory=lambda: {name: (Spread(), Spread()) for name in PARTS}
    )

    def add(self, lights: dict[str, Irradiance], replicates: int) -> None:
        """Add the parts in some replicates, each (replicate · sensor, bin) [sr].

        Where nothing is added to straight light, direct light is the same object.
        """
        if lights["direct"] is lights["straight"]:
            self.spreads["direct"] = self.spreads["straight"]
            lights = {name: light for name, light in lights.items() if name != "direct"}
        for name, light in lights.items():
            for spread, values in zip(self.spreads[name], light, strict=True):
                spread.add(values.array, replicates)
        dr.eval([spread.sums for pair in self.spreads.values() for spread in pair])

    def arrays(self, sensors: int, bins: Bins) -> dict[str, np.ndarray]:
        """Means and standard errors of all parts, each of shape (sensor, bin)."""
        every = {}
        for name, (sky, sun) in self.spreads.items():
            pairs = zip(sky.mean_and_error(), sun.mean_and_error(), strict=True)
            every[name], every[f"{name}_se"] = (bins.joined(pair, sensors) for pair in pairs)
        dr.eval(every)
        return {name: values.numpy().reshape(sensors, -1) for name, values in every.items()}


@symbolic
def _added(
    values: mi.Float, first: mi.Float, total: mi.Float, squares: mi.Float, replicates: mi.UInt32
) -> tuple[mi.Float, mi.Float]:
    """Sums with the differences of some replicates from the first one, and with their squares."""
    size = dr.width(first)
    at, step, each = dr.arange(mi.UInt32, size), dr.opaque(mi.UInt32, size), mi.UInt32(0)
    total, squares = mi.Float(total), mi.Float(squares)
    while each < replicates:
        difference = dr.gather(mi.Float, values, at) - first
        total += difference
        squares += dr.square(difference)
        at += step
        each += 1
    return total, squares
