"""zarr and xarray read the folders as they read their own."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.runtime import zarr_folder


def dataset(times=5):
    rng = np.random.default_rng(1)
    stamps = np.datetime64("2015-01-01T08:00", "ns") + np.arange(times) * np.timedelta64(90, "s")
    values = rng.random((2, times, 7), np.float32)
    values[1, 2] = np.nan
    return xr.Dataset(
        {
            "L": (("channel", "time", "bin"), values, {"units": "cd/m2"}),
            "sun": ("time", rng.random(times)),
            "is_up": ("time", np.arange(times) % 2 == 0),
            "count": ("time", np.arange(times)),
            "label": ("time", np.array([f"sun_{i} é" for i in range(times)], object)),
            "scalar": ((), np.float64(3.0)),
            "nothing": (("time", "none"), np.zeros((times, 0))),
        },
        coords={
            "time": stamps,
            "clock": ("time", stamps + np.timedelta64(1, "h")),
            "bin": np.array([np.str_(f"b{i}") for i in range(7)], object),
            "wide": ("bin", np.array(["x"] * 7)),
        },
        attrs={"case": "Café", "step": np.float64(1.5), "list": np.array([1, 2])},
    )


def read(folder, **options):
    """Content of a folder, with text as objects."""
    data = xr.open_zarr(folder, chunks=None, **options).load()
    text = {name: v.astype(object) for name, v in data.variables.items() if v.dtype.kind in "TU"}
    return data.assign({k: v for k, v in text.items() if k in data.data_vars}).assign_coords(
        {k: v for k, v in text.items() if k in data.coords}
    )


@pytest.mark.parametrize("chunk", [1 << 24, 64, 1])
@pytest.mark.parametrize("step", [1, 2, 5])
def test_parts_come_back_as_a_whole(tmp_path, monkeypatch, chunk, step):
    monkeypatch.setattr(zarr_folder, "LARGEST_CHUNK", chunk)
    data = dataset()
    parts = (data.isel(time=slice(i, i + step)) for i in range(0, 5, step))
    zarr_folder.write(parts, tmp_path / "own", "time")
    data.to_zarr(tmp_path / "zarrs", zarr_format=2, consolidated=True)
    theirs = read(tmp_path / "zarrs")
    for consolidated in (True, False):
        xr.testing.assert_identical(read(tmp_path / "own", consolidated=consolidated), theirs)


@pytest.mark.parametrize("chunk", [1 << 24, 64, 1])
@pytest.mark.parametrize("known", [[0, 2, 5], [3], [], [6, 1, 0, 2, 3, 4, 5]])
def test_labels_that_a_part_lacks_are_nan(tmp_path, monkeypatch, chunk, known):
    monkeypatch.setattr(zarr_folder, "LARGEST_CHUNK", chunk)
    data = dataset()[["L", "sun"]].drop_vars("wide")
    first, last = data.isel(time=slice(0, 4)), data.isel(time=slice(4, 5), bin=known)
    zarr_folder.write([first, last], tmp_path / "own", "time")
    last = last.reindex(bin=data["bin"])
    xr.concat([first, last], "time").to_zarr(tmp_path / "zarrs", zarr_format=2, consolidated=True)
    xr.testing.assert_identical(read(tmp_path / "own"), read(tmp_path / "zarrs"))


def test_a_part_has_no_labels_that_the_first_one_lacks(tmp_path):
    first, last = dataset(4).isel(bin=slice(0, 5)), dataset(4)
    with pytest.raises(KeyError, match="b5"):
        zarr_folder.write([first, last], tmp_path / "own", "time")


@pytest.mark.parametrize("dim", ["bin", "channel"])
def test_a_part_that_lacks_places_without_labels_is_refused(tmp_path, dim):
    first, last = dataset(4).drop_vars(["bin", "wide"]), dataset(4).drop_vars(["bin", "wide"])
    with pytest.raises(ValueError, match="L has 1 values for"):
        zarr_folder.write([first, last.isel({dim: [0]})], tmp_path / "own", "time")


def test_a_large_array_is_cut_into_chunks(tmp_path, monkeypatch):
    monkeypatch.setattr(zarr_folder, "LARGEST_CHUNK", 100)
    zarr_folder.write([dataset()], tmp_path / "z", "time")
    array = json.loads((tmp_path / "z" / "L" / ".zarray").read_text())
    assert (array["shape"], array["chunks"]) == ([2, 5, 7], [1, 5, 5])
    names = {file.name for file in (tmp_path / "z" / "L").iterdir()}
    assert names == {".zarray", ".zattrs", "0.0.0", "0.0.1", "1.0.0", "1.0.1"}
