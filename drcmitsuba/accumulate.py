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


def _array(sky: xr.Dataset, values: np.ndarray) -> xr.DataArray:
    coords = {k: v for k, v in sky.coords.items() if v.dims == ("time",) and k != "sun_bin"}
    return xr.DataArray(values, coords, dims=("time", "sensor"))


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
    luminance = sky["sun"].values[shining].astype(np.float32)[:, None]
    out = {}
    for name in ("straight", "straight_se"):
        values = np.zeros((sky.sizes["time"], coefficients.sizes["sensor"]), np.float32)
        values[shining] = coefficients[name].values.T[at] * luminance
        out[name.replace("straight", "direct_sun")] = _array(sky, values)
    return describe(xr.Dataset(out))


def _of_replicate(
    c: np.ndarray, sky: xr.Dataset, patches: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Illuminance by sky and by sun, (time, sensor) each, of one replicate's C (sensor, bin)."""
    by_sky = sky["sky"].values.astype(np.float32) @ c[:, patches].T
    by_sun = np.zeros_like(by_sky)
    shining = np.flatnonzero(sky["sun"].values > 0)
    luminance = sky["sun"].values[shining].astype(np.float32)[:, None]
    by_sun[shining] = c.T[at] * luminance
    return by_sky, by_sun


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
        A bin of the sky has no coefficients.
    """
    remedy = "compute sky and coefficients with the same subdivision"
    patches = _positions(coefficients, sky["bin"].values, remedy)
    _, at = _sun_positions(coefficients, sky)
    found = [_of_replicate(c, sky, patches, at) for c in coefficients["replicates"].values]
    out = {}
    for name, values in (
        ("sky", np.stack([a for a, _ in found])),
        ("sun", np.stack([b for _, b in found])),
        ("total", np.stack([a + b for a, b in found])),
    ):
        mean, error = mean_and_error(values)
        out[name], out[f"{name}_se"] = _array(sky, mean), _array(sky, error)
    return xr.Dataset(out)


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
