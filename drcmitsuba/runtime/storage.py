"""Files of results, written whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import uuid
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from drcmitsuba.runtime import zarr_folder
from drcmitsuba.runtime.errors import InputError

SPARE = 1 << 20
"""Largest number of bytes of a NetCDF file beyond its arrays."""
ABANDONED = re.compile(r"\..+\.[0-9a-f]{8}")
"""Name of a temporary file or folder, see `whole`."""


def _replace(temporary: Path, path: Path) -> None:
    """Put a finished file or folder in its place; a file does not replace a folder."""
    if path.is_dir() and temporary.is_dir():
        shutil.rmtree(path)
    temporary.replace(path)


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """Temporary path that takes the place of `path` where the block ends without an error."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        yield temporary
        _replace(temporary, path)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path.parent)) from None
    finally:
        remove(temporary)


def remove_abandoned(folder: Path) -> None:
    """Remove the temporary files of processes that were killed, from a folder that is locked."""
    for path in folder.glob(".*"):
        if ABANDONED.fullmatch(path.name):
            remove(path)


def remove(path: Path) -> None:
    """Remove a file or a folder, where there is one."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def remove_others(folder: Path, names: re.Pattern[str], kept: Collection[str]) -> None:
    """Remove files of some names from a folder, but for those that are kept."""
    for path in folder.iterdir():
        if names.fullmatch(path.name) and path.name not in kept:
            path.unlink(missing_ok=True)


def _refuse_full_disk(path: Path, size: int) -> None:
    """Raise OSError where the disk has no room for `size` bytes: HDF5 would crash the process."""
    try:
        with path.open("wb") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            elif shutil.disk_usage(path.parent).free < size:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    finally:
        path.unlink(missing_ok=True)


def save_netcdf(data: xr.Dataset, path: Path) -> None:
    """Write a dataset as NetCDF; OSError where the disk is full or the folder not writable.

    The file is not compressed: compression takes ten times as long and saves a third.
    """
    with whole(path) as temporary:
        _refuse_full_disk(temporary, data.nbytes + data.nbytes // 20 + SPARE)
        data.to_netcdf(temporary, engine="h5netcdf")


def save_zarr(data: xr.Dataset | Iterable[xr.Dataset], path: Path, along: str = "time") -> None:
    """Write a dataset as a zarr folder; never leaves half a folder at `path`.

    A dataset that would not fit in memory comes in parts, one after another along the dim `along`.

    The format is zarr 2, whose consolidated metadata and strings are standard; with format 3 xarray
    warns where the file has them, and where it has not.
    """
    with whole(path) as temporary:
        zarr_folder.write([data] if isinstance(data, xr.Dataset) else data, temporary, along)


def save_json(data: object, path: Path) -> None:
    """Write JSON; never leaves half a file at `path`. NaN raises ValueError."""
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False, default=str)
    save_text(text + "\n", path)


def load_json(path: Path, what: str, most: int, remedy: str) -> Any:
    """Read JSON; InputError where it is damaged, no plain file, or larger than `most` [bytes]."""
    try:
        if not path.exists() or (path.is_file() and path.stat().st_size <= most):
            return json.loads(path.read_text(encoding="utf-8"))
        got = "no plain file, or too large a one"
    except (OSError, ValueError, RecursionError) as error:
        got = str(error)[:120]
    raise InputError(path, what, got, remedy)


def save_csv(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV with six digits; never leaves half a file at `path`."""
    save_text(table.to_csv(index=False, float_format="%.6g", lineterminator="\n"), path)


def save_text(text: str, path: Path) -> None:
    """Write text; never leaves half a file at `path`."""
    save_lines([text], path)


def save_lines(lines: Iterable[str], path: str | Path) -> None:
    """Write lines of text one after another; never leaves half a file at `path`.

    Lines end as given, so that a file is the same on all systems.
    """
    with whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.writelines(lines)


@contextmanager
def new_folder(path: str | Path) -> Iterator[Path]:
    """Yield a temporary folder whose files move to `path` where the block ends without an error.

    Raises
    ------
    InputError
        The folder holds files: those of two exports would mix.
    """
    folder = Path(path).resolve()
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(path, "folder", "it holds files already", "name a new folder")
    made = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:8]}")
    made.mkdir(parents=True)
    try:
        yield made
        folder.mkdir(exist_ok=True)  # it may be there, empty, and some shell's current folder
        for file in sorted(made.iterdir()):
            file.rename(folder / file.name)
    finally:
        shutil.rmtree(made, ignore_errors=True)
