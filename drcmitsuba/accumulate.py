"""Coefficients × luminances = illuminance: E[time, sensor] = Σ_bin C[sensor, bin] · L[time, bin].

Bins are matched by label, exactly. Every time stamp has at most one sun, so its part of the sum is
one product; the sky's is a matrix product. Replicates of C are carried through, and their scatter
is the standard error of E: entries of C share samples, so their errors do not simply add.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.errors import InputError
from drcmitsuba.schema import describe, mean_and_error

BLOCK = 256
"""Sensors that are taken at once: the replicates of a block stay small."""
SAME_SUBDIVISION = "compute sky and coefficients with the same subdivision"


def _positions(coefficients: xr.Dataset, labels: np.ndarray, remedy: str) -> np.ndarray:
    """Positions of bins by label.

    Raises
    ------
    InputError
        A label is not among the coefficients' bins.
    """
    known = {str(label): i for i, label in enumerate(coefficients["bin"].values)}
    missing = [str(label) for label in labels if str(label) not in known]
    if missing:
        raise InputError(
            "coefficients", "bin", f"no {missing[0]!r} ({len(missing)} bins missing)", remedy
        )
    return np.array([known[str(label)] for label in labels], dtype=np.int64)


def _sun_positions(coefficients: xr.Dataset, sky: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Time stamps at which the sun shines, and their bins."""
    shining = np.flatnonzero(sky["sun"].values > 0)
    remedy = "compute coefficients for the time stamps of this sky"
    return shining, _positions(coefficients, sky["sun_bin"].values[shining], remedy)


def _refuse_gaps(values: np.ndarray, sky: xr.Dataset) -> None:
    """Refuse NaN: coefficients of the shaded state are known for the hours that close only."""
    gaps = np.flatnonzero(np.isnan(values).any(axis=-1))
    if len(gaps):
        first = np.datetime_as_string(sky["time"].values[gaps[0]], unit="m")
        raise InputError(
            "coefficients", "bin", f"no numbers for {len(gaps)} time stamps, {first} the first",
            "compute coefficients with this weather and state",
        )  # fmt: skip


def _array(sky: xr.Dataset, values: np.ndarray) -> xr.DataArray:
    coords = {k: v for k, v in sky.coords.items() if v.dims == ("time",) and k != "sun_bin"}
    return xr.DataArray(values, coords, dims=("time", "sensor"))


def _by_sun(c: np.ndarray, sky: xr.Dataset, shining: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Illuminance by the sun, (time, sensor), from C (sensor, bin) and the bins of the suns."""
    out = np.zeros((sky.sizes["time"], len(c)), np.float32)
    out[shining] = c.T[at] * sky["sun"].values[shining].astype(np.float32)[:, None]
    return out


def direct_sun(coefficients: xr.Dataset, sky: xr.Dataset) -> xr.Dataset:
    """Illuminance by sun that comes straight, for ASE and the shade.

    Parameters
    ----------
    coefficients : xr.Dataset
        Of the open state: `straight`, `straight_se` (sensor, bin) [sr].
    sky : xr.Dataset
        From `sky.radiance`: `sun`, `sun_bin`.

    Returns
    -------
    xr.Dataset
        `direct_sun` and `direct_sun_se`, dims (time, sensor) [lx].
    """
    shining, at = _sun_positions(coefficients, sky)
    out = {}
    for name in ("straight", "straight_se"):
        values = _by_sun(coefficients[name].values, sky, shining, at)
        _refuse_gaps(values, sky)
        out[name.replace("straight", "direct_sun")] = _array(sky, values)
    return describe(xr.Dataset(out))


def _of_replicate(
    c: np.ndarray, sky: xr.Dataset, patches: np.ndarray, shining: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Illuminance by sky, by sun and in all, (time, sensor) each, of one replicate's C."""
    by_sky = sky["sky"].values.astype(np.float32) @ c[:, patches].T
    by_sun = _by_sun(c, sky, shining, at)
    total = by_sky + by_sun
    _refuse_gaps(total, sky)
    return by_sky, by_sun, total


def by_source(coefficients: xr.Dataset, sky: xr.Dataset) -> xr.Dataset:
    """Illuminance by the sky with the ground, by the sun, and in all.

    Parameters
    ----------
    coefficients : xr.Dataset
        `replicates` (replicate, sensor, bin) [sr] of one state.
    sky : xr.Dataset
        From `sky.radiance`: `sky` (time, bin), `sun`, `sun_bin` (time) [cd/m²].

    Returns
    -------
    xr.Dataset
        `sky`, `sun`, `total` and `…_se`, dims (time, sensor) [lx].

    Raises
    ------
    InputError
        A bin of the sky has no coefficients, or NaN.
    """
    patches = _positions(coefficients, sky["bin"].values, SAME_SUBDIVISION)
    suns = _sun_positions(coefficients, sky)
    replicates = coefficients["replicates"].values
    shape = (sky.sizes["time"], replicates.shape[1])
    names = ("sky", "sun", "total")
    out = {n + s: np.empty(shape, np.float32) for n in names for s in ("", "_se")}
    for start in range(0, shape[1], BLOCK):
        here = slice(start, start + BLOCK)
        found = [_of_replicate(c[here], sky, patches, *suns) for c in replicates]
        for name, values in zip(names, zip(*found, strict=True), strict=True):
            out[name][:, here], out[f"{name}_se"][:, here] = mean_and_error(np.stack(values))
    return xr.Dataset({name: _array(sky, values) for name, values in out.items()})


def replicates(coefficients: xr.Dataset, sky: xr.Dataset, sensors: np.ndarray) -> np.ndarray:
    """Illuminance in all of every replicate, at some sensors.

    Parameters
    ----------
    coefficients, sky : xr.Dataset
        As for `by_source`.
    sensors : np.ndarray of int, shape (sensor,)

    Returns
    -------
    np.ndarray, shape (replicate, time, sensor)
        [lx].

    Raises
    ------
    InputError
        As `by_source`.
    """
    patches = _positions(coefficients, sky["bin"].values, SAME_SUBDIVISION)
    suns = _sun_positions(coefficients, sky)
    c = coefficients["replicates"].values[:, sensors]
    total = _of_replicate(c.reshape(-1, c.shape[2]), sky, patches, *suns)[2]
    return np.moveaxis(total.reshape(len(total), len(c), len(sensors)), 1, 0)


def illuminance(
    is_open: xr.Dataset, shaded: xr.Dataset | None, sky: xr.Dataset, closed: xr.DataArray
) -> xr.Dataset:
    """Illuminance of the year with the shade that opens and closes.

    Parameters
    ----------
    is_open, shaded : xr.Dataset
        Coefficients of the two states; `shaded` may be None where the shade never closes.
    sky : xr.Dataset
        From `sky.radiance`.
    closed : xr.DataArray of bool, dim time
        When the shade is closed.

    Returns
    -------
    xr.Dataset
        `total`, `total_open`, `sky_open`, `sun_open`, `direct_sun` and `…_se`, dims (time, sensor)
        [lx]; coordinates `x`, `y`, `z`, `shade_closed`.

    Raises
    ------
    InputError
        Coefficients are missing for a bin, or for the shaded state of an hour that closes.
    """
    parts = by_source(is_open, sky)
    out = direct_sun(is_open, sky)
    for name in ("total", "sky", "sun"):
        for suffix in ("", "_se"):
            out[f"{name}_open{suffix}"] = parts[name + suffix]
    out["total"], out["total_se"] = parts["total"].copy(), parts["total_se"].copy()
    shut = np.flatnonzero(closed.values)
    if len(shut):
        if shaded is None:
            raise InputError(
                "coefficients", "state", f"no shaded state; {len(shut)} time stamps close",
                "compute the coefficients of the shaded state",
            )  # fmt: skip
        behind = by_source(shaded, sky.isel(time=shut))
        for suffix in ("", "_se"):
            out["total" + suffix].values[shut] = behind["total" + suffix].values
    out = out.assign_coords({axis: ("sensor", is_open[axis].values) for axis in "xyz"})
    out = out.assign_coords(shade_closed=("time", closed.values))
    return describe(out)
