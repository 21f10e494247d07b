"""Arrays of earlier results, read from files as untrusted input."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import DATES, DIMS, LARGEST, LARGEST_OTHER, MOST, NUMBERS, TEXTS
from drcmitsuba.sky.luminances import from_luminances

HOLLOW = 1000
"""Largest ratio of an array's bytes in memory to the bytes of its file."""
SMALL = 1 << 28
"""Number of bytes up to which an array may have any ratio."""
REMEDY = "give a file of this program"


def open_dataset(path: Path, *variables: str) -> xr.Dataset:
    """Open a zarr folder or NetCDF file and check that it holds `variables`.

    Raises
    ------
    InputError
        The path does not exist, is not readable, or lacks a variable. Where variables are named,
        also: a variable has other dims or types than `schema.DIMS` says.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "results", "no such file or folder", "run the step that writes it")
    if not (path.is_dir() or path.is_file()):  # a device would never end
        raise InputError(path, "results", "no plain file", REMEDY)
    if some := [file.name for file in sorted(path.glob("*")) if file.suffix in (".nc", ".zarr")]:
        remedy = f"name one of its files: {', '.join(some[:5])}"
        raise InputError(path, "results", "a folder of several", remedy)
    data = _attempt(path, lambda: _opened(path, mask_and_scale=False))
    if not _is_plain(data):
        data = _attempt(path, lambda: _opened(path, mask_and_scale=True))
    missing = [v for v in variables if v not in data]
    if missing:
        raise InputError(path, "results", f"has no {missing[0]!r}", REMEDY)
    _refuse_hollow(path, data)
    if variables:
        data = _ordered(path, data)
    return _attempt(path, lambda: _with_plain_labels(data))


def _opened(path: Path, *, mask_and_scale: bool) -> xr.Dataset:
    """Open a file or folder without reading its arrays."""
    if path.is_dir():
        return xr.open_zarr(path, consolidated=False, chunks=None, mask_and_scale=mask_and_scale)
    return xr.open_dataset(path, engine="h5netcdf", mask_and_scale=mask_and_scale)


def _is_plain(data: xr.Dataset) -> bool:
    """Whether values stand as they are: without a scale, and NaN for what is missing.

    Then their fill value is taken out; with it xarray would copy every array once more.
    """
    for v in data.variables.values():
        fill = v.attrs.get("_FillValue")
        is_nan = isinstance(fill, np.floating) and np.isnan(fill) and v.dtype.kind == "f"
        if {"scale_factor", "add_offset", "missing_value"} & v.attrs.keys() or not (
            fill is None or is_nan
        ):
            return False
    for v in data.variables.values():
        v.attrs.pop("_FillValue", None)
    return True


def _with_plain_labels(data: xr.Dataset) -> xr.Dataset:
    """Turn labels from NumPy's variable-width strings, which few functions take, into objects."""
    texts = {k: v.astype(object) for k, v in data.variables.items() if v.dtype.kind in "TU"}
    return data.assign({k: v for k, v in texts.items() if k in data.data_vars}).assign_coords(
        {k: v for k, v in texts.items() if k in data.coords}
    )


def _attempt(path: Path, read: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Read, and describe in one line any error that zarr or HDF5 raises for a damaged file.

    The hook is silent because h5netcdf complains again when the half-open file is dropped.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read()
    except MemoryError as error:
        got = f"larger than memory: {error}"[:200]
        raise InputError(path, "results", got, "take fewer sensors or time stamps") from None
    except Exception as error:
        got = f"{type(error).__name__}: {error}"[:200]
    finally:
        sys.unraisablehook = hook
    raise InputError(path, "results", got, REMEDY)


def _refuse_hollow(path: Path, data: xr.Dataset) -> None:
    """Refuse arrays declared far larger than their file: they would fill the memory."""
    files = path.rglob("*") if path.is_dir() else [path]
    held = sum(file.stat().st_size for file in files if file.is_file())
    for name, v in data.variables.items():
        block = [c if isinstance(c, int) else max(c) for c in v.encoding.get("chunks") or ()]
        declared = max(v.nbytes, v.dtype.itemsize * math.prod(block))
        if declared > max(SMALL, HOLLOW * held):
            got = f"{name} stands for {declared >> 20} MiB in a file of {held} bytes"
            raise InputError(path, "results", got, REMEDY)


def _ordered(path: Path, data: xr.Dataset) -> xr.Dataset:
    """Put the dims of known variables in order; refuse other dims and other types."""
    changed = {}
    if ("blend_bin" in data) != ("blend_weight" in data):
        raise InputError(path, "results", "half of the sun's blend is missing", REMEDY)
    # Where there is a dim `sun`, `sun` holds its labels; beside L it is the sun's luminance.
    sun_dims = ("sun",) if "sun" in data.dims else ("time",)
    for name, v in data.variables.items():
        dims = sun_dims if name == "sun" else DIMS.get(str(name))
        if dims is None:
            continue
        if name == "pane_group" and "sun" in v.dims:  # of an adaptive sun
            dims = ("state", "sensor", "sun")
        if set(v.dims) - {"channel"} != set(dims) or ("channel" in v.dims and name in data.coords):
            got = f"{name} has the dims {', '.join(map(str, v.dims)) or 'none'}"
            raise InputError(path, "results", got, f"give {', '.join(dims)}")
        texts = name in TEXTS or (name == "sun" and "sun" in data.dims)
        wanted = "TUO" if texts else "M" if name in DATES else "f"
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
    """Load a dataset from `open_dataset` into memory.

    Raises
    ------
    InputError
        The file is damaged, or holds numbers beyond any light; NaN marks values not computed.
    """
    data = _attempt(path, data.load)
    for attribute in sorted(NUMBERS & data.attrs.keys()):
        number = data.attrs[attribute]
        if not isinstance(number, int | float | np.number) or not abs(number) <= MOST:
            raise InputError(path, f"results, {attribute}", repr(number)[:60], "give a number")
    for name, v in data.variables.items():
        # Attributes go with coordinates into NetCDF, which takes fewer types than zarr.
        v.attrs = {k: a for k, a in v.attrs.items() if k and type(a) in (str, int, float)}
        if name in DATES and v.isnull().any():
            raise InputError(path, "results", f"{name} is not known everywhere", REMEDY)
        if v.dtype.kind == "f":
            most = LARGEST.get(str(name).removesuffix("_se"), LARGEST_OTHER)
            # fmin and fmax ignore NaN, and copy nothing.
            low, high = (float(f.reduce(v.values, axis=None)) for f in (np.fmin, np.fmax))
            if low < -most or high > most:
                raise InputError(path, "results", f"{name} is beyond {most:g}", REMEDY)
    return data


def coefficients_and_sky(c: Path, l: Path) -> tuple[Coefficients, xr.Dataset]:  # noqa: E741
    """Read C of all states from `coefficients.zarr` and the sky of L from `sky.zarr`."""
    C = open_dataset(c, "replicates", "straight", "straight_se", "state", "bin", *"xyz")
    return Coefficients.of(loaded(c, C)), sky(l)


def sky(path: Path) -> xr.Dataset:
    """Read the sky of L from `sky.zarr`, see `sky.luminances.from_luminances`.

    The columns of the suns stay on disk, where they come last: `sun` has their luminance.
    """
    L = open_dataset(path, "L", "bin", "sun", "sun_bin", "clock")
    L = L.isel(channel=0) if "channel" in L.dims else L
    suns = np.array([str(label).startswith("sun_") for label in L["bin"].values])
    if not suns[: np.count_nonzero(~suns)].any():
        L = L.isel(bin=slice(np.count_nonzero(~suns)))
    return from_luminances(loaded(path, L))
