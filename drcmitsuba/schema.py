"""Names, dimensions and units of every array that passes between modules or lies on disk."""

from __future__ import annotations

import json
import math
import shutil
import sys
import uuid
import warnings
from collections.abc import Callable, Iterable
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

_OF_C, _OF_E = ("state", "sensor", "bin"), ("time", "sensor")
DIMS: dict[str, tuple[str, ...]] = {
    "replicates": ("state", "replicate", "sensor", "bin"),
    **{n + s: _OF_C for n in ("straight", "direct", "interreflected") for s in ("", "_se")},
    **dict.fromkeys(("sun_straight", "sun_straight_se"), ("state", "sensor", "sun")),
    "mesh_error": ("state", "sensor"),
    **dict.fromkeys("xyz", ("sensor",)),
    **{name: (name,) for name in ("state", "bin", "time")},
    "L": ("time", "bin"),
    "sun_direction": ("time", "axis"),
    **dict.fromkeys(("blend_bin", "blend_weight"), ("time", "blend")),
    **dict.fromkeys(("sun_bin", "clock"), ("time",)),
    **{n + s: _OF_E for n in ("total", "direct_sun") for s in ("", "_se")},
}
"""Dims of what lies on disk; `channel` comes first where there is one."""

_TEXTS, _DATES = ("state", "bin", "sun_bin", "blend_bin"), ("time", "clock")
LARGEST = {"L": 1e13, "sun": 1e13, "total": 1e17, "direct_sun": 1e17}
"""Values beyond the brightest sun (of 0.01°, [cd/m²]) and beyond what it lights [lx] are damage."""
LARGEST_OTHER = 1e6

NUMBERS = {"latitude", "longitude", "timezone", "sun_diameter", "step_hours", "interval_factor"}
NUMBERS |= {"has_shade", "shade_threshold", "shade_area"}
"""Attributes that are numbers."""

MOST = 1e9
"""Largest of them."""

HOLLOW = 1000
"""A file may stand for so many times the bytes that it has, beyond `SMALL`."""
SMALL = 1 << 28

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
        The path does not exist, is not readable, or lacks a variable; where variables are asked
        for, also one of other dims or types than `DIMS` has.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "results", "no such file or folder", "run the step that writes it")
    if not (path.is_dir() or path.is_file()):  # a device would never end
        raise InputError(path, "results", "no plain file", REMEDY)
    if path.is_dir():
        data = _attempt(path, lambda: xr.open_zarr(path, consolidated=False, chunks=None))
    else:
        data = _attempt(path, lambda: xr.open_dataset(path, engine="h5netcdf"))
    missing = [v for v in variables if v not in data]
    if missing:
        raise InputError(path, "results", f"has no {missing[0]!r}", REMEDY)
    _refuse_hollow(path, data)
    if variables:
        data = _ordered(path, data)
    return _attempt(path, lambda: _with_plain_labels(data))


def _with_plain_labels(data: xr.Dataset) -> xr.Dataset:
    """Labels come back as NumPy's variable-width strings, which few of its functions take."""
    texts = {k: v.astype(object) for k, v in data.variables.items() if v.dtype.kind in "TU"}
    return data.assign({k: v for k, v in texts.items() if k in data.data_vars}).assign_coords(
        {k: v for k, v in texts.items() if k in data.coords}
    )


REMEDY = "give a file of this program"


def _attempt(path: Path, read: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Read, and tell in one line what the readers of zarr and HDF5 make of a damaged file.

    That may be any error, and h5netcdf complains a second time when the half-open file is dropped.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read()
    except Exception as error:
        got = f"{type(error).__name__}: {error}"[:200]
    finally:
        sys.unraisablehook = hook
    raise InputError(path, "results", got, REMEDY)


def _refuse_hollow(path: Path, data: xr.Dataset) -> None:
    """Refuse arrays that are declared far larger than their file: they would fill the memory."""
    files = path.rglob("*") if path.is_dir() else [path]
    held = sum(file.stat().st_size for file in files if file.is_file())
    for name, v in data.variables.items():
        block = [c if isinstance(c, int) else max(c) for c in v.encoding.get("chunks") or ()]
        declared = max(v.nbytes, v.dtype.itemsize * math.prod(block))
        if declared > max(SMALL, HOLLOW * held):
            got = f"{name} stands for {declared >> 20} MiB in a file of {held} bytes"
            raise InputError(path, "results", got, REMEDY)


def _ordered(path: Path, data: xr.Dataset) -> xr.Dataset:
    """Known variables with their dims in order; others or other types are refused."""
    changed = {}
    if ("blend_bin" in data) != ("blend_weight" in data):
        raise InputError(path, "results", "half of the sun's blend is missing", REMEDY)
    # Where there is a dim `sun`, this is its labels; beside L it is the sun's luminance.
    sun_dims = ("sun",) if "sun" in data.dims else ("time",)
    for name, v in data.variables.items():
        dims = sun_dims if name == "sun" else DIMS.get(str(name))
        if dims is None:
            continue
        if set(v.dims) - {"channel"} != set(dims) or ("channel" in v.dims and name in data.coords):
            got = f"{name} has the dims {', '.join(map(str, v.dims)) or 'none'}"
            raise InputError(path, "results", got, f"give {', '.join(dims)}")
        texts = name in _TEXTS or (name == "sun" and "sun" in data.dims)
        wanted = "TUO" if texts else "M" if name in _DATES else "f"
        if v.dtype.kind not in wanted or v.dtype == np.float16:
            raise InputError(path, "results", f"{name} has the type {v.dtype}", REMEDY)
        if name in data.indexes and not data.indexes[name].is_unique:
            raise InputError(path, "results", f"a label of {name} comes twice", REMEDY)
        if 0 in v.shape and name not in ("blend_bin", "blend_weight"):
            raise InputError(path, "results", f"{name} is empty", REMEDY)
        if v.dims[-len(dims) :] != dims:
            changed[name] = v.transpose(..., *dims)
    return data.assign(changed)


def loaded(path: Path, data: xr.Dataset) -> xr.Dataset:
    """Load what `open_dataset` opened.

    Raises
    ------
    InputError
        It cannot be read, or holds numbers that no light makes. NaN is what was not computed.
    """
    data = _attempt(path, data.load)
    for attribute in sorted(NUMBERS & data.attrs.keys()):
        number = data.attrs[attribute]
        if not isinstance(number, int | float | np.number) or not abs(number) <= MOST:
            raise InputError(path, f"results, {attribute}", repr(number)[:60], "give a number")
    for name, v in data.variables.items():
        # They go with coordinates into what is written, and not all that zarr takes fits NetCDF.
        v.attrs = {k: a for k, a in v.attrs.items() if k and type(a) in (str, int, float)}
        if name in _DATES and v.isnull().any():
            raise InputError(path, "results", f"{name} is not known everywhere", REMEDY)
        if v.dtype.kind == "f":
            most = LARGEST.get(str(name).removesuffix("_se"), LARGEST_OTHER)
            # These pass over NaN, and copy nothing.
            low, high = (float(f.reduce(v.values, axis=None)) for f in (np.fmin, np.fmax))
            if low < -most or high > most:
                raise InputError(path, "results", f"{name} is beyond {most:g}", REMEDY)
    return data


def mean_and_error(replicates: np.ndarray, axis: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Mean of independent replicates and its standard error, along `axis`."""
    n = replicates.shape[axis]
    return replicates.mean(axis=axis), replicates.std(axis=axis, ddof=1) / np.sqrt(n)
