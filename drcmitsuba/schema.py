"""Names, dimensions and units of every array that passes between modules or lies on disk."""

from __future__ import annotations

import json
import shutil
import uuid
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.errors import InputError

VARIABLES: dict[str, tuple[str, str]] = {
    # name: (unit, long name)
    "L": ("cd/m2", "luminance of the sky patches, the ground and the suns"),
    "sky": ("cd/m2", "luminance of the sky patches and the ground"),
    "sun": ("cd/m2", "luminance of the sun"),
    "straight": ("sr", "coefficient of light that comes straight, through clear panes only"),
    "direct": ("sr", "coefficient of light that met no diffuse surface"),
    "interreflected": ("sr", "coefficient of light that met a diffuse surface"),
    "sun_straight": ("sr", "coefficient of each time stamp's own sun, straight"),
    "mesh_error": ("sr", "standard error of interpolation between the suns of the mesh"),
    "replicates": ("sr", "direct + interreflected of each independent replicate"),
    "total": ("lx", "illuminance, shade applied"),
    "total_open": ("lx", "illuminance, shade open"),
    "sky_open": ("lx", "illuminance by sky and ground, shade open"),
    "sun_open": ("lx", "illuminance by the sun, all bounces, shade open"),
    "direct_sun": ("lx", "illuminance by sun that comes straight, shade open"),
}
"""Unit and long name of the variables; `…_se` is the standard error of each."""

LUMINANCE_WEIGHTS = {"red": 0.2126, "green": 0.7152, "blue": 0.0722}
"""Channels of a coloured case and their share of luminance (ITU-R BT.709 primaries)."""


def describe(data: xr.Dataset) -> xr.Dataset:
    """Set unit and long name of every variable that the table knows."""
    for name, variable in data.data_vars.items():
        base = str(name).removesuffix("_se")
        if base in VARIABLES:
            unit, long_name = VARIABLES[base]
            error = "standard error of: " if base != name else ""
            variable.attrs.update(units=unit, long_name=error + long_name)
    return data


def luminance(values: xr.DataArray) -> xr.DataArray:
    """Weigh the colour channels of an array to luminance; a grey array passes unchanged."""
    if "channel" not in values.dims:
        return values
    weights = xr.DataArray(list(LUMINANCE_WEIGHTS.values()), dims="channel")
    return (values * weights).sum("channel").astype(values.dtype)


def _replace(temporary: Path, path: Path) -> None:
    """Put a finished file or folder in its place."""
    if path.is_dir():
        shutil.rmtree(path)
    temporary.replace(path)


def _temporary(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")


def save_netcdf(data: xr.Dataset, path: Path) -> None:
    """Write a dataset as NetCDF; never leaves half a file at `path`.

    It is not compressed: that takes ten times as long and saves a third.
    """
    temporary = _temporary(path)
    try:
        data.to_netcdf(temporary, engine="h5netcdf")
        _replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def save_zarr(data: xr.Dataset | Iterable[xr.Dataset], path: Path) -> None:
    """Write a dataset as a zarr folder; never leaves half a folder at `path`.

    A dataset that would not fit in memory is given in parts, one after another along `time`.

    Format 2, whose consolidated metadata and strings are standard: `xarray.open_zarr` warns of
    format 3 without them, `to_zarr` of format 3 with them.
    """
    temporary = _temporary(path)
    try:
        parts = iter([data] if isinstance(data, xr.Dataset) else data)
        next(parts).to_zarr(temporary, mode="w", zarr_format=2, consolidated=True)
        for part in parts:
            part.to_zarr(temporary, append_dim="time", zarr_format=2, consolidated=True)
        _replace(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def save_json(data: object, path: Path) -> None:
    """Write JSON; never leaves half a file at `path`. NaN has no place in it and raises."""
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False, default=str)
    save_text(text + "\n", path)


def save_text(text: str, path: Path) -> None:
    """Write text; never leaves half a file at `path`."""
    temporary = _temporary(path)
    try:
        temporary.write_text(text, encoding="utf-8")
        _replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def open_dataset(path: Path, *variables: str) -> xr.Dataset:
    """Open a zarr folder or NetCDF file and check that it holds `variables`.

    Raises
    ------
    InputError
        The path does not exist, is not readable, or lacks a variable.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "results", "no such file or folder", "run the step that writes it")
    try:
        if path.is_dir():
            data = xr.open_zarr(path, consolidated=False, chunks=None)
        else:
            data = xr.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError, KeyError) as error:
        raise InputError(path, "results", str(error)[:120], "give a file of this program") from None
    missing = [v for v in variables if v not in data]
    if missing:
        raise InputError(path, "results", f"has no {missing[0]!r}", "give a file of this program")
    # Labels come back as NumPy's variable-width strings, which few of its functions take.
    texts = {k: v.astype(object) for k, v in data.variables.items() if v.dtype.kind in "TU"}
    return data.assign({k: v for k, v in texts.items() if k in data.data_vars}).assign_coords(
        {k: v for k, v in texts.items() if k in data.coords}
    )


def mean_and_error(replicates: np.ndarray, axis: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Mean of independent replicates and its standard error, along `axis`."""
    n = replicates.shape[axis]
    return replicates.mean(axis=axis), replicates.std(axis=axis, ddof=1) / np.sqrt(n)
