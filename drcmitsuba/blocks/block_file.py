"""One block on disk: a zarr folder of format 2 in a ZIP archive.

The archive is one file: it appears whole or not at all, and its CRC-32 of every chunk finds damage.
"""

from __future__ import annotations

import errno
import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.runtime import lazy, storage, zarr_folder

numcodecs = lazy.module("numcodecs")

UNREADABLE = (zipfile.BadZipFile, ValueError, KeyError, TypeError, RuntimeError, EOFError, OSError)
"""Errors of a damaged archive; a place before its begin is an OSError, EINVAL."""
HOLLOW, SMALL = 1000, 1 << 28
"""Largest ratio of an array's bytes to those of its file; bytes beyond which it holds."""


def write_block(data: xr.Dataset, path: Path) -> None:
    """Write a dataset whole or not at all; OSError where the disk is full."""
    with storage.whole(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        zarr_folder.put_all([data], archive.writestr, along="")


def read_block(path: Path, sizes: Mapping[str, int]) -> xr.Dataset | None:
    """Read a dataset; None where the file is damaged.

    Parameters
    ----------
    path : Path
    sizes : mapping of str to int
        Sizes that dims must have: arrays of other sizes are damage, and are not read.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _dataset(archive, sizes)
    except UNREADABLE as error:
        if isinstance(error, OSError) and error.errno != errno.EINVAL:
            raise
        return None


def attributes_of(path: Path) -> dict[str, Any]:
    """Attributes of the dataset of a block; empty where the file is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return dict(json.loads(archive.read(".zattrs")))
    except UNREADABLE:
        return {}


def _dataset(archive: zipfile.ZipFile, sizes: Mapping[str, int]) -> xr.Dataset:
    files = json.loads(archive.read(".zmetadata"))["metadata"]
    attributes = files.pop(".zattrs")
    variables = {}
    for name in (key.removesuffix("/.zarray") for key in files if key.endswith("/.zarray")):
        entry, described = files[f"{name}/.zarray"], files[f"{name}/.zattrs"]
        dims = described.pop("_ARRAY_DIMENSIONS")
        for dim, size in zip(dims, entry["shape"], strict=True):
            if sizes.get(dim, size) != size:
                raise ValueError(f"{dim} has the size {size}")
        variables[name] = xr.Variable(dims, _values(archive, name, entry), described)
    return xr.decode_cf(xr.Dataset(variables, attrs=attributes)).load()


def _values(archive: zipfile.ZipFile, name: str, entry: dict[str, Any]) -> np.ndarray:
    """Values of an array, chunk by chunk."""
    shape, chunks = entry["shape"], entry["chunks"]
    if 8 * math.prod(shape) > SMALL + HOLLOW * sum(i.compress_size for i in archive.infolist()):
        raise ValueError(f"{name} is hollow")
    out = np.empty(shape, object if entry["dtype"] == "|O" else entry["dtype"])
    counts = [-(-n // chunk) for n, chunk in zip(shape, chunks, strict=True)]
    for place in np.ndindex(*counts):
        key = ".".join(map(str, place)) or "0"
        content = numcodecs.Blosc().decode(archive.read(f"{name}/{key}"))
        if out.dtype.hasobject:
            chunk = numcodecs.VLenUTF8().decode(content)
        else:
            chunk = np.frombuffer(content, out.dtype)
        chunk = np.asarray(chunk).reshape(chunks)
        here = tuple(slice(i * n, (i + 1) * n) for i, n in zip(place, chunks, strict=True))
        out[here] = chunk[tuple(slice(n) for n in out[here].shape)]
    return out
