"""Counts that the metrics share: time stamps and sensors at or above a threshold, exactly.

In every threshold a tie passes. Temporal and spatial thresholds become whole counts by exact
rational arithmetic before anything is compared: 0.55 · 100 is 55.00000000000001 in floating point
and would lose a tie.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from fractions import Fraction

import numpy as np
import xarray as xr

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.pieces import run

BLOCK = 2**18
"""Values compared at once: the comparison stays in the cache, and no large grid is copied whole."""
MOST = 255
"""Largest count of a byte: sums of bytes are several times as fast as sums of larger numbers."""


def months(array: xr.DataArray, name: str = "illuminance") -> np.ndarray:
    """Month of each time stamp, by the clock that the working hours are kept by.

    Parameters
    ----------
    array : DataArray (time, …)
        With dates in the coordinate `clock`, else in `time`.
    name : str
        Name of the array in error messages.

    Returns
    -------
    np.ndarray of int, shape (time,)
        1 to 12.

    Raises
    ------
    InputError
        The time stamps are not dates.
    """
    if not isinstance(array, xr.DataArray):
        raise InputError(name, "type", type(array).__name__, "give an xarray DataArray")
    key = "clock" if "clock" in array.coords else "time"
    if key not in array.coords or array[key].dims != ("time",) or array[key].dtype.kind != "M":
        raise InputError(name, key, "no dates along time", "give a datetime64 for each time stamp")
    stamps = array[key].values
    if np.isnat(stamps).any():
        raise InputError(name, key, "NaT", "give a datetime64 for each time stamp")
    return stamps.astype("datetime64[M]").astype(np.int64) % 12 + 1


def hour_of_day(times: xr.Dataset | xr.DataArray, step_hours: float) -> np.ndarray:
    """Hour of the day in the middle of each interval, shape (time,) [h].

    It is that of the coordinate `clock` where there is one, else that of `time`; an interval is
    `step_hours` long [h].
    """
    clock = (times["clock"] if "clock" in times.coords else times["time"]).values
    middle = clock + np.timedelta64(round(step_hours * 1800), "s")
    return np.asarray((middle - middle.astype("datetime64[D]")) / np.timedelta64(1, "h"))


def checked(array: xr.DataArray, name: str) -> np.ndarray:
    """Values E[time, sensor] of an array, a view where it is held in memory.

    InputError for other dims, no time stamp or sensor, or values that are not finite real numbers.
    """
    if not isinstance(array, xr.DataArray):
        raise InputError(name, "type", type(array).__name__, "give an xarray DataArray")
    if set(array.dims) != {"time", "sensor"}:
        dims = ", ".join(map(str, array.dims)) or "none"
        raise InputError(name, "dims", dims, "give an array with exactly the dims time, sensor")
    if array.size == 0:
        raise InputError(name, "size", f"{dict(array.sizes)}", "give a time stamp and a sensor")
    if array.dtype.kind not in "fiu":
        raise InputError(name, "dtype", f"{array.dtype}", "give real numbers [lx]")
    E = array.transpose("time", "sensor").values
    if not all(np.isfinite(block).all() for block in blocks(E)):
        bad = sum(int((~np.isfinite(block)).sum()) for block in blocks(E))
        raise InputError(
            name, "values", f"{bad} of {E.size} are NaN or infinite", "give finite illuminances"
        )
    return E


def blocks(E: np.ndarray) -> Iterator[np.ndarray]:
    """Cut `E[time, sensor]` along time into views of about `BLOCK` values."""
    rows = max(1, BLOCK // E.shape[1])
    return (E[start : start + rows] for start in range(0, len(E), rows))


def stamps_reached(E: np.ndarray, threshold: float) -> np.ndarray:
    """Number of time stamps with E ≥ threshold of each sensor, shape (sensor,)."""
    limit = not_negative("threshold", threshold)
    count = np.zeros(E.shape[1], dtype=np.int64)
    for block in blocks(E):
        count += stamps_passed(block >= limit)
    return count


def stamps_passed(passed: np.ndarray) -> np.ndarray:
    """Number of the first dim's entries that passed, int32, of bool (time, …): (…)."""
    count = np.zeros(passed.shape[1:], np.int32)
    for start in range(0, len(passed), MOST):
        piece = passed[start : start + MOST].view(np.uint8)
        count += np.add.reduce(piece, axis=0, dtype=np.uint8)
    return count


def share(passed: np.ndarray) -> float:
    """Share of the sensors that passed [%]."""
    return 100.0 * int(passed.sum()) / len(passed)


def monthly_share(
    array: xr.DataArray, name: str, threshold: float, required: Callable[[int, int], int]
) -> xr.DataArray:
    """Share [%] of the sensors that reach the threshold at `required(t_m, t_y)` time stamps.

    It has the dim `month`, 1 to 12; NaN for a month without time stamps.
    """
    return monthly(*stamps_by_month(array, name, threshold), required)


def stamps_by_month(
    array: xr.DataArray, name: str, threshold: float
) -> tuple[np.ndarray, np.ndarray]:
    """Number of time stamps with E ≥ threshold (month, sensor), and of all time stamps (month,)."""
    E, month = checked(array, name), months(array, name)
    reached, stamps = np.zeros((12, E.shape[1]), np.int64), np.bincount(month, minlength=13)[1:]
    for m in np.flatnonzero(stamps):
        reached[m] = stamps_reached(E[run(np.flatnonzero(month == m + 1))], threshold)
    return reached, stamps


def monthly(
    reached: np.ndarray, stamps: np.ndarray, required: Callable[[int, int], int]
) -> xr.DataArray:
    """Share [%] of the sensors by month, as `monthly_share`, from `stamps_by_month`."""
    shares, whole = np.full(12, np.nan), int(stamps.sum())
    for m in np.flatnonzero(stamps):
        shares[m] = share(reached[m] >= required(int(stamps[m]), whole))
    return xr.DataArray(shares, {"month": np.arange(1, 13)}, ("month",), attrs={"units": "%"})


def exact(value: float) -> Fraction:
    """Rational number that the float stands for: 0.55 is 11/20, ten minutes are 1/6 hour."""
    return Fraction(value).limit_denominator(10**9)


def exact_fraction(name: str, value: float) -> Fraction:
    """Exact number from 0 to 1, else an `InputError` of the parameter `name`."""
    if not 0 <= value <= 1:
        raise InputError("metrics", name, f"{value}", "give a fraction from 0 to 1")
    return exact(float(value))


def not_negative(name: str, value: float) -> float:
    """Finite number of 0 or above, else an `InputError` of the parameter `name`.

    A plain float takes the array's type in a comparison: 300.3 ties with float32(300.3).
    """
    if not 0 <= value < math.inf:
        raise InputError("metrics", name, f"{value}", "give a finite number, 0 or above")
    return float(value)
