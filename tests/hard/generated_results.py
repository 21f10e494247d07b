"""Results on disk: coefficients.zarr, sky.zarr, illuminance.nc, metrics.json; and damage."""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path

import h5py
import numpy as np
import xarray as xr
from hypothesis import strategies as st

from tests.hard.mutations import damaged, mutated, places

ODD = (np.nan, np.inf, -np.inf, -1.0, 1e38, 1e300, 0.0)
TYPES = ("int8", "float16", "float64", "bool", "U5", "datetime64[ns]", "complex64")
SIZES = (0, -1, 1, 3, 10**6, 10**12, 2**63, None, "4", 0.5)
UNWRITABLE = (TypeError, ValueError, NotImplementedError, OverflowError)
"""Writers raise these for datasets that cannot lie on disk."""

remarks = st.integers(0, 10**9)
"""A remark makes a whole file another one: hypothesis tries nothing twice."""


@st.composite
def heads(draw, folder: Path):
    """Change the JSON of a zarr folder: shapes, types, dims, attributes."""
    file = draw(st.sampled_from(sorted(folder.rglob(".z*"))))
    text = file.read_text(encoding="utf-8")
    if draw(st.integers(0, 5)) == 0:
        file.write_bytes(draw(damaged(text)))
        return
    head = json.loads(text)
    sized = [k for k in ("shape", "chunks") if k in head]
    if sized and draw(st.booleans()):
        for key in sized if draw(st.booleans()) else sized[:1]:
            at = draw(st.integers(0, len(head[key]) - 1))
            head[key][at] = draw(st.sampled_from(SIZES))
    elif places(head):
        head = draw(mutated(head))
    file.write_text(json.dumps(head, default=str), encoding="utf-8")


@st.composite
def chunks(draw, folder: Path):
    """Change, cut or remove a file of numbers."""
    files = sorted(p for p in folder.rglob("[0-9]*") if p.is_file())
    file = draw(st.sampled_from(files))
    raw = file.read_bytes()
    at = draw(st.integers(0, len(raw)))
    how = draw(st.sampled_from(["remove", "cut", "change"]))
    if how == "remove":
        file.unlink()
    else:
        rest = b"" if how == "cut" else raw[at + 4 :]
        file.write_bytes(raw[:at] + (b"" if how == "cut" else draw(st.binary(max_size=6))) + rest)


@st.composite
def arrays(draw, data: xr.Dataset):
    """Dataset with other values, types, dims, labels or attributes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numbers that overflow are what is wanted
        return draw(_arrays(data))


@st.composite
def _arrays(draw, data: xr.Dataset):
    how = draw(
        st.sampled_from(["values", "values", "drop", "dims", "type", "size", "attrs", "none"])
    )
    name = draw(st.sampled_from(sorted(map(str, data.variables))))
    v = data[name]
    if how == "values" and v.dtype.kind == "f":
        values = v.values.copy()
        values.flat[draw(st.integers(0, values.size - 1))] = draw(st.sampled_from(ODD))
        return data.assign({name: (v.dims, values)})
    if how == "drop":
        return data.drop_vars(name)
    if how == "dims" and v.dims:
        if draw(st.booleans()):
            return data.assign({name: v.transpose(*v.dims[::-1])}) if v.ndim > 1 else data
        return data.rename({v.dims[0]: draw(st.sampled_from(["channel", "x2", "Sensor"]))})
    if how == "type":
        try:
            return data.assign({name: v.astype(draw(st.sampled_from(TYPES)))})
        except (TypeError, ValueError, RuntimeError):
            return data
    if how == "size" and data.sizes:
        dim = draw(st.sampled_from(sorted(map(str, data.sizes))))
        return data.isel({dim: draw(st.sampled_from([[], [0], [0, 0], slice(None, None, -1)]))})
    if how == "attrs" and data.attrs:
        key = draw(st.sampled_from(sorted(data.attrs)))
        new = draw(st.sampled_from([None, "x", -1.0, np.nan, 0.0, 1e300, np.array([1.0, 2.0])]))
        rest = {k: a for k, a in data.attrs.items() if k != key}
        return data.assign_attrs().pipe(_with_attrs, rest if new is None else rest | {key: new})
    return data


def _with_attrs(data: xr.Dataset, attrs: dict) -> xr.Dataset:
    out = data.copy()
    out.attrs = attrs
    return out


@st.composite
def zarrs(draw, good: Path, work: Path):
    """Copy a zarr folder to `work`, damaged or not; its arrays, its heads or its chunks."""
    shutil.rmtree(work, ignore_errors=True)
    how = draw(st.sampled_from(["whole"] * 4 + ["arrays", "arrays", "head", "head", "chunk"]))
    if how == "arrays":
        data = xr.open_zarr(good, consolidated=False, chunks=None).load()
        try:
            changed = draw(arrays(plain_labels(data)))
            changed.drop_encoding().to_zarr(work, mode="w", zarr_format=2)
        except (
            TypeError,
            ValueError,
            NotImplementedError,
            OverflowError,
        ):  # what cannot be written
            shutil.rmtree(work, ignore_errors=True)
            shutil.copytree(good, work)
        return work
    shutil.copytree(good, work)
    attributes = json.loads((work / ".zattrs").read_text(encoding="utf-8"))
    attributes["remark"] = draw(remarks)
    (work / ".zattrs").write_text(json.dumps(attributes), encoding="utf-8")
    if how in ("head", "chunk"):
        draw(heads(work) if how == "head" else chunks(work))
    return work


@st.composite
def netcdfs(draw, good: Path, work: Path):
    """Write a NetCDF file to `work`, damaged or not; its arrays or its bytes."""
    how = draw(st.sampled_from(["whole"] * 3 + ["arrays"] * 3 + ["bytes"]))
    if how == "arrays":
        with xr.open_dataset(good, engine="h5netcdf") as data:
            try:
                changed = draw(arrays(plain_labels(data.load())))
                changed.drop_encoding().to_netcdf(work, engine="h5netcdf")
                return work
            except UNWRITABLE:
                pass
    raw = good.read_bytes()
    if how == "bytes":
        at = draw(st.integers(0, len(raw)))
        rest = draw(st.sampled_from([b"", raw[at + 3 :], raw[at:]]))
        raw = raw[:at] + draw(st.binary(max_size=5)) + rest
    work.write_bytes(raw)
    if how == "whole":
        with h5py.File(work, "a") as file:
            file.attrs["remark"] = draw(remarks)
    return work


def plain_labels(data: xr.Dataset) -> xr.Dataset:
    """Labels as objects, which every writer takes."""
    texts = {k: v.astype(object) for k, v in data.variables.items() if v.dtype.kind in "TU"}
    return data.assign(texts)


@st.composite
def numbers(draw, good: Path, work: Path):
    """Write metrics.json to `work`, damaged or not."""
    text = good.read_text(encoding="utf-8")
    how = draw(st.sampled_from(["whole"] * 4 + ["tree"] * 2 + ["text"]))
    if how == "text":
        work.write_bytes(draw(damaged(text)))
    elif how == "tree":
        work.write_text(json.dumps(draw(mutated(json.loads(text))), default=str), "utf-8")
    else:
        work.write_text(json.dumps(json.loads(text) | {"remark": draw(remarks)}), "utf-8")
    return work
