"""Light paths of a view on disk: a Zarr folder for the cells and one for each group of pixels.

They are those of all states of the façade. The light of the sky on the cells is computed anew for a
state, with the same random numbers: it takes as long as that of one hour's sun.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.rendering.pixel_paths import PixelPaths
from drcmitsuba.rendering.view_by_element import ViewByElement, ViewCells
from drcmitsuba.runtime import zarr_folder
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.interreflection.cell_rays import Blocks
from drcmitsuba.transport.interreflection.solved_cells import OneBounce, Transfer

KEPT = 1 << 30
"""Largest size of light paths that stay in memory [bytes]."""
CELLS, STATED = "cells.zarr", "view.json"
FORMAT = 6
"""Version of the arrays of a view: a folder of another one is written anew."""
DRAWN = ("rank", "p", "n", "within")
"""Arrays of the points that stand for cells."""
_SHORT = 1 << 16


def _numpy(array: Any) -> np.ndarray:
    """Array (number,) or (axis, number); whole numbers in two bytes where they fit."""
    values = np.asarray(array.numpy())
    if values.dtype == np.uint32 and values.max(initial=0) < _SHORT:
        return values.astype(np.uint16)
    return values


def _dataset(arrays: dict[str, Any], **attributes: Any) -> xr.Dataset:
    """Arrays, each with dims of its own."""
    data = {}
    for name, array in arrays.items():
        values = _numpy(array)
        data[name] = xr.Variable(("axis", f"of_{name}")[-values.ndim :], values)
    return xr.Dataset(data, attrs=attributes)


def save_paths(paths: PixelPaths, folder: Path) -> None:
    """Write the light paths of some pixels to a folder of a view."""
    part = _dataset(paths.arrays(), first=paths.first, slots=paths.slots)
    zarr_folder.write([part], folder / f"{paths.first:010d}.zarr", along="")


def save_cells(cells: ViewCells, folder: Path, stated: dict[str, Any]) -> None:
    """Write the cells of a view, and last what the view is of."""
    arrays: dict[str, Any] = {"keys": cells.keys}
    points = {f"drawn_{name}": getattr(cells.drawn, name) for name in DRAWN}
    arrays |= {name: values for name, values in points.items() if values is not None}
    attributes: dict[str, float] = {"again": cells.again}
    if cells.transfer is not None:
        blocks = cells.transfer.blocks
        arrays |= {"blocks_of": blocks.of, "blocks_share": blocks.share}
        attributes |= {"blocks": blocks.count, "steps": cells.transfer.steps}
        attributes["sending"] = cells.transfer.sending or dr.width(blocks.of)
        for r, bounce in enumerate(cells.transfer.bounces):
            arrays |= {f"bounce_{r}_{k}": v for k, v in bounce._asdict().items()}
        arrays |= {f"marks_{r}": mark for r, mark in enumerate(cells.transfer.marks)}
    zarr_folder.write([_dataset(arrays, **attributes)], folder / CELLS, along="")
    (folder / STATED).write_text(json.dumps(stated), encoding="utf-8")


def is_of(folder: Path, stated: dict[str, Any]) -> bool:
    """Whether a folder holds the light paths of a view as it is stated."""
    return _stated(folder) == stated


def is_of_another_program(folder: Path, stated: dict[str, Any]) -> bool:
    """Whether a folder holds the light paths of a view that another program traced."""
    there = _stated(folder)
    return there != stated and {**there, "program": stated["program"]} == stated


def _stated(folder: Path) -> dict[str, Any]:
    """Statement of a folder on its view; empty where there is none."""
    try:
        return dict(json.loads((folder / STATED).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def _opened(folder: Path) -> xr.Dataset:
    try:
        return xr.open_zarr(folder, mask_and_scale=False, chunks=None)
    except (OSError, KeyError, ValueError):
        remedy = "delete the folder of the view, and render again"
        raise InputError(folder, "light paths", "they cannot be read", remedy) from None


def _array(kind: Any, values: np.ndarray) -> Any:
    """Array of a type from NumPy, of one or three axes."""
    if dr.depth_v(kind) > 1:
        return kind(*(mi.Float(np.ascontiguousarray(axis)) for axis in values))
    if kind is mi.UInt32:
        values = values.astype(np.uint32)
    return kind(np.ascontiguousarray(values))


_KINDS = {"mi.UInt32": "UInt32", "mi.Float": "Float", "mi.Float16": "Float16",
          "mi.Vector3f": "Vector3f"}  # fmt: skip


def _paths(folder: Path) -> PixelPaths:
    """Light paths of some pixels."""
    with _opened(folder) as data:
        arrays = {
            f.name: _array(getattr(mi, _KINDS[str(f.type)]), data[f.name].values)
            for f in fields(PixelPaths)[2:]
        }
        return PixelPaths(int(data.attrs["first"]), int(data.attrs["slots"]), **arrays)


def tiles(folder: Path) -> Iterator[PixelPaths]:
    """Light paths of all pixels, some at a time."""
    for part in sorted(folder.glob("[0-9]*.zarr")):
        yield _paths(part)


def with_tiles_of(
    views: Sequence[ViewByElement], folders: Sequence[Path]
) -> tuple[ViewByElement, ...]:
    """Return views whose light paths are read from folders, once where all fit in memory."""
    files = [file for folder in folders for file in folder.rglob("*") if file.is_file()]
    if sum(file.stat().st_size for file in files) > KEPT // 2:
        return tuple(
            replace(view, tiles=partial(tiles, folder))
            for view, folder in zip(views, folders, strict=True)
        )
    kept = [list(tiles(folder)) for folder in folders]
    return tuple(
        replace(view, tiles=partial(iter, paths)) for view, paths in zip(views, kept, strict=True)
    )


def load_cells(folder: Path, replicates: int) -> ViewCells:
    """Read the cells of a view."""
    with _opened(folder / CELLS) as data:

        def array(name: str) -> Any:
            values = data[name].values
            kinds = {"u": mi.UInt32, "f": mi.Float, "b": mi.Bool, "i": mi.Bool}
            return _array(kinds[values.dtype.kind], values)

        keys, every = array("keys"), range(replicates)
        points = {name: array(f"drawn_{name}") for name in DRAWN if f"drawn_{name}" in data}
        drawn = CellPoints(replicates, dr.width(keys), **points)
        transfer = None
        if "blocks" in data.attrs:
            blocks = Blocks(array("blocks_of"), int(data.attrs["blocks"]), array("blocks_share"))
            bounces = (
                OneBounce(*(array(f"bounce_{r}_{name}") for name in OneBounce._fields))
                for r in every
            )
            marks = tuple(array(f"marks_{r}") for r in every if f"marks_{r}" in data)
            steps, sending = (int(data.attrs[name]) for name in ("steps", "sending"))
            transfer = Transfer(blocks, tuple(bounces), steps, sending, marks)
        again = float(data.attrs["again"])
    return ViewCells(keys, drawn, transfer, again)
