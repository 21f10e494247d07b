"""A block comes back as it was, is read by zarr too, and its damage is found."""

import numpy as np
import pytest
import xarray as xr
import zarr

from drcmitsuba.blocks import block_file
from drcmitsuba.blocks.block_file import attributes_of, read_block, write_block
from drcmitsuba.runtime import zarr_folder


def dataset(sensors=5):
    values = np.random.default_rng(1).random((2, sensors, 7), np.float32)
    values[1, 2] = np.nan
    return xr.Dataset(
        {"replicates": (("replicate", "sensor", "bin"), values, {"units": "sr"})},
        coords={
            "x": ("sensor", np.arange(sensors) / 3),
            "bin": np.array([f"sun_{i} é" for i in range(7)], object),
        },
        attrs={"photons": '{"a": 1}', "photons_smear": 0.5},
    )


@pytest.mark.parametrize("chunk", [1 << 24, 64])
def test_a_block_comes_back_bit_by_bit(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr(zarr_folder, "LARGEST_CHUNK", chunk)
    data = dataset()
    write_block(data, tmp_path / "b.zip")
    again = read_block(tmp_path / "b.zip", {"sensor": 5})
    xr.testing.assert_identical(again, data)
    assert again["replicates"].dtype == np.float32
    assert attributes_of(tmp_path / "b.zip") == data.attrs


def test_zarr_reads_a_block(tmp_path):
    write_block(dataset(), tmp_path / "b.zip")
    with zarr.storage.ZipStore(tmp_path / "b.zip", mode="r") as archive:
        theirs = xr.open_zarr(archive, consolidated=True, chunks=None).load()
    np.testing.assert_array_equal(theirs["replicates"], dataset()["replicates"])


def test_any_changed_byte_of_the_arrays_is_found(tmp_path):
    write_block(dataset(), tmp_path / "b.zip")
    content = (tmp_path / "b.zip").read_bytes()
    rng = np.random.default_rng(2)
    ends = range(len(content) - 30, len(content))  # where the archive's table of contents is found
    for at in (*rng.integers(0, len(content), 100), *ends):
        damaged = bytearray(content)
        damaged[at] ^= 1 << int(rng.integers(8))
        (tmp_path / "d.zip").write_bytes(damaged)
        again = read_block(tmp_path / "d.zip", {"sensor": 5})
        if again is not None:  # some bytes of an archive mean nothing, such as its dates
            xr.testing.assert_identical(again, dataset())


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_half_a_block_is_damaged(tmp_path, share):
    write_block(dataset(), tmp_path / "b.zip")
    content = (tmp_path / "b.zip").read_bytes()
    (tmp_path / "b.zip").write_bytes(content[: int(share * len(content))])
    assert read_block(tmp_path / "b.zip", {"sensor": 5}) is None
    assert attributes_of(tmp_path / "b.zip") == {}


def test_a_block_of_other_sensors_or_a_hollow_one_is_damaged(tmp_path, monkeypatch):
    write_block(dataset(), tmp_path / "b.zip")
    assert read_block(tmp_path / "b.zip", {"sensor": 6}) is None
    monkeypatch.setattr(block_file, "SMALL", 0)
    monkeypatch.setattr(block_file, "HOLLOW", 0)
    assert read_block(tmp_path / "b.zip", {"sensor": 5}) is None
