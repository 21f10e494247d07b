"""Arrays of coefficients C with their dims, and statistics of replicates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.aligned_arrays import aligned_empty
from drcmitsuba.runtime.flat_arrays import flat_indices, row_and_column
from drcmitsuba.runtime.launch_size import SENSORS
from drcmitsuba.schema import describe, positions
from drcmitsuba.transport.light.irradiance import Irradiance

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
    """Place of each followed bin, of the sky first, among all of them, int, shape (followed,)."""

    @classmethod
    def of(cls, labels: list[str], followed: list[str] | None = None) -> Bins:
        """Bins by their labels; by default all are followed."""
        return cls(labels, positions(labels if followed is None else followed, labels))

    def zeros(self, rows: int) -> mi.Float:
        """Make an array of all bins, flat (row, bin), in memory."""
        out = dr.zeros(mi.Float, rows * len(self.labels))
        dr.make_opaque(out)
        return out

    def put(self, out: mi.Float, light: Iterable[mi.Float], rows: int, first: int = 0) -> None:
        """Put `rows` rows of light into `out`, from the row `first` on.

        `light` are the values of sky and suns, flat (row, followed bin) each.
        """
        bins, start = len(self.labels), 0
        begin, stride = (dr.opaque(mi.UInt32, n) for n in (first * bins, bins))
        for part in light:
            count = dr.width(part) // rows
            if not count:
                continue
            place = flat_indices(self.place[start : start + count])
            row, bin = row_and_column(dr.arange(mi.UInt32, rows * count), count)
            dr.scatter(out, part, row * stride + begin + dr.gather(mi.UInt32, place, bin))
            dr.eval(out)
            start += count


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
        """Add some replicates, one after another in an array.

        The sums have a launch of their own. Large arrays begin at the same place of a page, and a
        launch that reads and writes more than eight of them side by side, as many as have room in
        a set of the cache, takes three times as long.
        """
        size = dr.width(values) // replicates
        if size == 0:
            self.first = self.total = self.squares = values
            return
        if self.first is None:
            self.first = dr.gather(mi.Float, values, dr.arange(mi.UInt32, size))
            self.total, self.squares = dr.zeros(mi.Float, size), dr.zeros(mi.Float, size)
            dr.make_opaque(self.first, self.total, self.squares)
        number = dr.opaque(mi.UInt32, replicates)
        self.total, self.squares = _added(values, self.first, self.total, self.squares, number)
        dr.eval(self.total, self.squares)
        self.count += replicates

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

    def __post_init__(self) -> None:
        self.spreads["direct"] = self.spreads["straight"]

    @property
    def _are_one(self) -> bool:
        """Whether direct light is straight light in all replicates so far."""
        return self.spreads["direct"] is self.spreads["straight"]

    def add(self, lights: dict[str, Irradiance], replicates: int) -> None:
        """Add the parts in some replicates, each (replicate · sensor, bin) [sr].

        Where nothing is added to straight light, direct light is the same object: both have one
        sum until some replicates have more.
        """
        if self._are_one and lights["direct"] is lights["straight"]:
            lights = {name: light for name, light in lights.items() if name != "direct"}
        elif self._are_one:
            sky, sun = self.spreads["straight"]
            self.spreads["direct"] = replace(sky), replace(sun)
        for name, light in lights.items():
            for spread, values in zip(self.spreads[name], light, strict=True):
                spread.add(values.array, replicates)

    def arrays(self, sensors: int, bins: Bins) -> dict[str, np.ndarray]:
        """Means and standard errors of all parts, each of shape (sensor, bin)."""
        every: dict[str, np.ndarray] = {}
        for name, (sky, sun) in self.spreads.items():
            if name == "direct" and self._are_one:
                every |= {f"direct{end}": every[f"straight{end}"].copy() for end in ("", "_se")}
                continue
            pairs = zip(sky.mean_and_error(), sun.mean_and_error(), strict=True)
            for key, light in zip((name, f"{name}_se"), pairs, strict=True):
                out = bins.zeros(sensors)
                bins.put(out, light, sensors)
                every[key] = out.numpy().reshape(sensors, -1)
        return every


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


def joined(blocks: Iterable[tuple[slice, xr.Dataset]], sensors: int) -> xr.Dataset:
    """Coefficients of all sensors, filled in block by block: no copy of all of them is made."""
    out: xr.Dataset | None = None
    for here, block in blocks:
        if block.sizes["sensor"] == sensors:
            return block
        if out is None:
            out = _of_sensors(block, sensors)
        for name, part in block.variables.items():
            if "sensor" in part.dims:
                at = tuple(here if dim == "sensor" else slice(None) for dim in part.dims)
                out[name].values[at] = part.values
    assert out is not None
    return out


def _of_sensors(block: xr.Dataset, sensors: int) -> xr.Dataset:
    """Dataset like a block with another number of sensors, of which nothing is known yet.

    Memory that is written for the first time in one go is there sooner than block by block.
    """

    def grown(variable: xr.Variable) -> xr.Variable:
        sizes = {**variable.sizes, "sensor": sensors}
        values = aligned_empty([sizes[dim] for dim in variable.dims], variable.dtype)
        values.fill(np.nan)
        return xr.Variable(variable.dims, values, variable.attrs)

    variables = {
        name: grown(part) if "sensor" in part.dims else part
        for name, part in block.variables.items()
    }
    out = xr.Dataset({name: variables[name] for name in block.data_vars}, attrs=block.attrs)
    return out.assign_coords({name: variables[name] for name in block.coords})
