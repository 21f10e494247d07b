"""Zarr folders of format 2, as zarr and xarray read them.

`Dataset.to_zarr` writes hundreds of small files one by one, and opens the folder anew for every
part; here chunks are large, and metadata are written once, at the end.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray import conventions

from drcmitsuba.runtime import lazy

numcodecs = lazy.module("numcodecs")

Put = Callable[[str, bytes], object]
"""Function that writes a file of the folder: its name, which may hold a slash, and its content."""

COMPRESSOR = {"cname": "lz4", "clevel": 5, "shuffle": 1, "blocksize": 0}
DATES = {"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian", "dtype": "int64"}
"""Encoding of dates, the same in all parts."""
LARGEST_CHUNK = 1 << 24
"""Largest size of a chunk [bytes], unless a part of one row is larger."""


@dataclass
class _Array:
    """Array of a folder, which may grow along one axis, by parts of as many rows."""

    name: str
    put: Put
    variable: xr.Variable
    """First part, as it is encoded."""
    axis: int | None
    """Axis along which it grows, if it does."""
    length: int = 0
    """Length along this axis so far."""
    chunks: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        shape = list(self.variable.shape)
        for axis in range(len(shape)):
            times = math.prod(shape) * self.variable.dtype.itemsize / LARGEST_CHUNK
            if axis != self.axis and times > 1:
                shape[axis] = max(1, int(shape[axis] / times))
        self.chunks = tuple(max(1, n) for n in shape)

    @property
    def is_text(self) -> bool:
        return bool(self.variable.dtype.kind in "OUT")

    def append(self, values: np.ndarray, at: np.ndarray | None = None) -> None:
        """Write the chunks of a part, whose last axis may lack places: it has those of `at`."""
        shape = [*values.shape]
        if at is not None:
            shape[-1] = self.variable.shape[-1]
        for i, (own, known) in enumerate(zip(shape, self.variable.shape, strict=True)):
            if i != self.axis and own != known:  # would be filled up with zeros
                raise ValueError(f"{self.name} has {own} values for {known} along axis {i}")
        first = [0] * values.ndim
        if self.axis is not None:
            first[self.axis] = self.length // self.chunks[self.axis]
            self.length += values.shape[self.axis]
        steps = [range(math.ceil(n / chunk)) for n, chunk in zip(shape, self.chunks, strict=True)]
        for place in itertools.product(*steps):
            here = tuple(slice(i * n, (i + 1) * n) for i, n in zip(place, self.chunks, strict=True))
            name = ".".join(str(i + j) for i, j in zip(place, first, strict=True)) or "0"
            chunk = values[here] if at is None else _chunk(values, at, here, shape[-1])
            self.put(f"{self.name}/{name}", self._encoded(chunk))

    def _encoded(self, chunk: np.ndarray) -> bytes:
        """Compressed content of a chunk, which is filled up to its full shape."""
        if chunk.shape != self.chunks:
            wider = [(0, n - m) for n, m in zip(self.chunks, chunk.shape, strict=True)]
            chunk = np.pad(chunk, wider, constant_values="" if self.is_text else 0)
        content = np.ascontiguousarray(chunk)
        if self.is_text:
            texts = np.array([*map(str, chunk.ravel())], dtype=object)
            content = numcodecs.VLenUTF8().encode(texts)
        return numcodecs.Blosc(**COMPRESSOR).encode(content)

    def metadata(self) -> dict[str, dict[str, Any]]:
        """Content of `.zarray` and `.zattrs`."""
        shape, dtype = list(self.variable.shape), self.variable.dtype
        if self.axis is not None:
            shape[self.axis] = self.length
        attributes = {k: v for k, v in self.variable.attrs.items() if k != "_FillValue"}
        return {
            ".zarray": {
                "zarr_format": 2,
                "shape": shape,
                "chunks": self.chunks,
                "dtype": "|O" if self.is_text else dtype.str,
                "fill_value": "NaN" if dtype.kind == "f" else None,
                "order": "C",
                "filters": [{"id": "vlen-utf8"}] if self.is_text else None,
                "dimension_separator": ".",
                "compressor": {"id": "blosc", **COMPRESSOR},
            },
            ".zattrs": _plain(attributes) | {"_ARRAY_DIMENSIONS": self.variable.dims},
        }


def write(parts: Iterable[xr.Dataset], folder: Path, along: str) -> None:
    """Write datasets one after another along a dim to a new folder; arguments as for `put_all`."""
    folder.mkdir()

    def put(name: str, content: bytes) -> None:
        file = folder / name
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(content)

    put_all(parts, put, along)


def put_all(parts: Iterable[xr.Dataset], put: Put, along: str) -> None:
    """Write datasets one after another along a dim.

    Parameters
    ----------
    parts : iterable of xr.Dataset
        Parts of equal length along the dim, the last one may be shorter. Arrays without this dim
        and attributes are those of the first part. A later part may lack labels of the last dim of
        an array: its numbers are NaN there.
    put : callable
        Function that writes a file.
    along : str
        Dim along which the parts follow each other.
    """
    arrays: dict[str, _Array] = {}
    attributes: dict[str, Any] = {}
    labels: dict[Any, np.ndarray] = {}
    for number, part in enumerate(parts):
        plain = part.drop_encoding()
        for variable in plain.variables.values():
            if variable.dtype.kind == "M":
                variable.encoding = DATES
        variables, described = conventions.encode_dataset_coordinates(plain)
        own = {dim: part[dim].values for dim in part.dims if dim in part.coords and dim != along}
        labels = labels if number else own
        both = labels.keys() & own.keys() if number else ()
        places = {dim: _places(own[dim], labels[dim]) for dim in both}
        for name, variable in variables.items():
            if number and along not in variable.dims:
                continue
            encoded = conventions.encode_cf_variable(variable, name=name)
            if number == 0:
                axis = variable.dims.index(along) if along in variable.dims else None
                arrays[str(name)] = _Array(str(name), put, encoded, axis)
            at = places.get(variable.dims[-1]) if variable.dims else None
            arrays[str(name)].append(np.asarray(encoded.values), at)
        attributes = attributes or _plain(described)
    files: dict[str, Any] = {".zgroup": {"zarr_format": 2}, ".zattrs": attributes}
    for name, array in arrays.items():
        files |= {f"{name}/{key}": content for key, content in array.metadata().items()}
    consolidated = {"zarr_consolidated_format": 1, "metadata": files}
    for name, content in (files | {".zmetadata": consolidated}).items():
        put(name, json.dumps(content).encode())


def _places(labels: np.ndarray, every: np.ndarray) -> np.ndarray | None:
    """Places of labels among all; None where they are all. KeyError for one that is unknown."""
    if np.array_equal(labels, every):
        return None
    place = {label: i for i, label in enumerate(every.tolist())}
    return np.array([place[label] for label in labels.tolist()], int)


def _chunk(values: np.ndarray, at: np.ndarray, here: tuple[slice, ...], count: int) -> np.ndarray:
    """Chunk of values whose last axis has the places `at` of some number; the others are NaN."""
    start, stop, _ = here[-1].indices(count)
    inside = (at >= start) & (at < stop)
    return widened(values[here[:-1]][..., inside], at[inside] - start, stop - start)


def widened(values: np.ndarray, at: np.ndarray, count: int) -> np.ndarray:
    """Values whose last axis has some of `count` places, those of `at`; the others are NaN."""
    out = np.full((*values.shape[:-1], count), np.nan, values.dtype)
    out[..., at] = values
    return out


def _plain(attributes: dict[Any, Any]) -> dict[str, Any]:
    """Attributes as JSON has them."""
    return {str(k): v.tolist() if isinstance(v, np.generic | np.ndarray) else v
            for k, v in attributes.items()}  # fmt: skip
