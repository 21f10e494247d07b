"""Arrays of coefficients C with their dims, and statistics of replicates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.schema import describe
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


@dr.syntax
def mean_and_error_of(values: mi.Float, replicates: int) -> tuple[mi.Float, mi.Float]:
    """Mean of replicates that stand one after another, and its standard error.

    Differences from the first replicate keep the digits.
    """
    size = dr.width(values) // replicates
    lane, step = dr.arange(mi.UInt32, size), dr.opaque(mi.UInt32, size)
    number = dr.opaque(mi.UInt32, replicates)
    first, at, each = dr.gather(mi.Float, values, lane), lane + step, mi.UInt32(1)
    total, squares = mi.Float(0), mi.Float(0)
    while each < number:
        difference = dr.gather(mi.Float, values, at) - first
        total += difference
        squares += dr.square(difference)
        at += step
        each += 1
    n = mi.Float(number)
    total /= n
    squares -= n * dr.square(total)
    mean, error = first + total, dr.sqrt(dr.maximum(squares, 0) / (n * (n - 1)))
    dr.eval(mean, error)
    return mean, error
