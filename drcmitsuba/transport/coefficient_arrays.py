"""Arrays of coefficients C with their dims, and statistics of replicates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.schema import describe
from drcmitsuba.transport.deposit import Irradiance
from drcmitsuba.transport.launch_size import SENSORS

PARTS = ("straight", "direct", "interreflected")
"""Parts of C, each with its standard error."""


def as_dataset(
    labels: list[str], points: np.ndarray, parts: dict[str, np.ndarray], replicates: np.ndarray
) -> xr.Dataset:
    """Coefficients [sr] with their dims: parts (sensor, bin) and (replicate, sensor, bin)."""
    coords: dict[str, Any] = {"bin": np.array(labels, dtype=object)}
    coords |= {axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")}
    data: dict[str, Any] = {name: (("sensor", "bin"), values) for name, values in parts.items()}
    data["replicates"] = (("replicate", "sensor", "bin"), replicates)
    return describe(xr.Dataset(data, coords))


def dark(
    labels: list[str], points: np.ndarray, replicates: int
) -> Iterator[tuple[slice, xr.Dataset]]:
    """Coefficients of 0."""
    for start in range(0, len(points), SENSORS):
        here = slice(start, min(start + SENSORS, len(points)))
        dark = np.zeros((replicates, here.stop - start, len(labels)), np.float32)
        parts = {name + suffix: dark[0] for name in PARTS for suffix in ("", "_se")}
        yield here, as_dataset(labels, points[here], parts, dark)


def with_zeros(C: xr.Dataset, labels: list[str], at: list[int]) -> xr.Dataset:
    """C with bins of all labels: its own are those `at` some indices, the others are 0."""

    def widened(part: xr.DataArray) -> xr.Variable:
        values = part.values.reshape(-1, part.shape[-1])
        out = np.zeros((len(values), len(labels)), part.dtype)

        def fill(here: slice) -> None:
            out[here, at] = values[here]

        in_threads(fill, [slice(i, i + SENSORS) for i in range(0, len(values), SENSORS)])
        return xr.Variable(part.dims, out.reshape(*part.shape[:-1], len(labels)), part.attrs)

    parts = {name: widened(part) for name, part in C.items()}
    coords = {**C.drop_vars("bin").coords, "bin": np.array(labels, dtype=object)}
    return xr.Dataset(parts, coords, C.attrs)


def fill_bins(out: np.ndarray, light: Irradiance) -> None:
    """Write light to an array (replicate, sensor, bin), sky and suns side by side."""
    sky, sun = (part.numpy().reshape(*out.shape[:2], -1) for part in light)

    def fill(r: int) -> None:
        out[r, :, : sky.shape[-1]], out[r, :, sky.shape[-1] :] = sky[r], sun[r]

    in_threads(fill, range(len(out)))


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

    def arrays(self, sensors: int) -> dict[str, np.ndarray]:
        """Means and standard errors of all parts, each of shape (sensor, bin)."""
        every = {
            name: [spread.mean_and_error() for spread in pair]
            for name, pair in self.spreads.items()
        }
        dr.eval(every)
        return {
            name + suffix: np.hstack([pair[i].numpy().reshape(sensors, -1) for pair in pairs])
            for name, pairs in every.items()
            for i, suffix in enumerate(("", "_se"))
        }


@dr.syntax
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
