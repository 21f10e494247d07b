"""Files keep datasets exactly, whole or not at all, and leave nothing else behind."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.metrics import stored_arrays
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError

LABELS = ["ground", "sky_001", "sky_145", "sun_2015-03-21T10:00"]


def dataset():
    rng = np.random.default_rng(0)
    data = xr.Dataset(
        {
            "direct": (("state", "sensor", "bin"), rng.random((2, 3, 4), np.float32)),
            "direct_se": (("state", "sensor", "bin"), rng.random((2, 3, 4), np.float32)),
        },
        coords={
            "state": np.array(["open", "shaded"], object),
            "bin": np.array(LABELS, object),
            "sun_bin": ("time", np.array(["", LABELS[3]], object)),
            "time": np.array(["2015-03-21T09:00", "2015-03-21T10:00"], "datetime64[ns]"),
            "x": ("sensor", np.array([0.1, 0.2, 0.3])),
        },
        attrs={"case": "Café", "shade_area": 0.02, "has_shade": 1},
    )
    data["direct"][1, :, 3] = np.nan
    return schema.describe(data)


SAVERS = [(storage.save_zarr, "c.zarr"), (storage.save_netcdf, "c.nc")]


@pytest.mark.parametrize(("save", "name"), SAVERS)
def test_a_dataset_comes_back_as_it_was(tmp_path, save, name):
    save(dataset(), tmp_path / "new" / name)
    loaded = stored_arrays.open_dataset(tmp_path / "new" / name, "direct", "bin").load()
    xr.testing.assert_identical(loaded, dataset())
    assert list(loaded["bin"].values) == LABELS
    assert loaded["direct"].dtype == np.float32
    assert loaded["direct"].attrs["units"] == "sr"
    assert loaded["direct_se"].attrs["long_name"].startswith("standard error of: ")


@pytest.mark.parametrize(("save", "name"), SAVERS)
def test_xarray_alone_opens_it_without_a_warning(tmp_path, save, name):
    save(dataset(), tmp_path / name)
    with xr.open_dataset(tmp_path / name) as opened:
        assert opened["bin"].values.tolist() == LABELS
        value = opened["direct"].sel(state="open", bin=LABELS[3])
        np.testing.assert_array_equal(value, dataset()["direct"][0, :, 3])


@pytest.mark.parametrize(("save", "name"), SAVERS)
def test_saving_again_replaces_all_of_it(tmp_path, save, name):
    save(dataset(), tmp_path / name)
    smaller = dataset().isel(bin=[0, 1], sensor=[2]).drop_vars("direct_se")
    save(smaller, tmp_path / name)
    xr.testing.assert_identical(stored_arrays.open_dataset(tmp_path / name).load(), smaller)
    assert [p.name for p in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(("save", "name"), SAVERS)
@pytest.mark.parametrize("stage", ["write", "replace"])
@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError])
def test_an_interrupted_save_keeps_what_was_there(tmp_path, monkeypatch, save, name, stage, stop):
    save(dataset(), tmp_path / name)

    room, function = (xr.Dataset, "to_netcdf")
    if name.endswith("zarr"):
        room, function = (storage.zarr_folder, "write")
    writer = getattr(room, function)

    def write_half_and_stop(*arguments, **options):
        writer(*arguments, **options)
        raise stop

    def stop_at_once(*paths):
        raise stop

    with monkeypatch.context() as patch:
        if stage == "write":
            patch.setattr(room, function, write_half_and_stop)
        else:
            patch.setattr(storage, "_replace", stop_at_once)
        with pytest.raises(stop):
            save(2 * dataset(), tmp_path / name)
    xr.testing.assert_identical(stored_arrays.open_dataset(tmp_path / name).load(), dataset())
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_json_comes_back_as_it_was(tmp_path):
    data = {"sDA": {"value": 50.0}, "msDA": [None, {"value": 1e-9}], "name": "Café"}
    storage.save_json(data, tmp_path / "new" / "m.json")
    assert json.loads((tmp_path / "new" / "m.json").read_text(encoding="utf-8")) == data


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_json_has_no_place_for_nan(tmp_path, bad):
    storage.save_json({"value": 1.0}, tmp_path / "m.json")
    with pytest.raises(ValueError, match="not JSON compliant"):
        storage.save_json({"value": bad}, tmp_path / "m.json")
    assert json.loads((tmp_path / "m.json").read_text()) == {"value": 1.0}
    assert [p.name for p in tmp_path.iterdir()] == ["m.json"]


def test_an_interrupted_json_leaves_nothing(tmp_path, monkeypatch):
    def stop(*paths):
        raise KeyboardInterrupt

    monkeypatch.setattr(storage, "_replace", stop)
    with pytest.raises(KeyboardInterrupt):
        storage.save_json({"value": 1.0}, tmp_path / "m.json")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_result_gives_one_line(tmp_path):
    text = tmp_path / "case.toml"
    text.write_text("name = 1")
    storage.save_netcdf(dataset(), tmp_path / "c.nc")
    cut = tmp_path / "cut.nc"
    cut.write_bytes((tmp_path / "c.nc").read_bytes()[:1000])
    for path, message in (
        (tmp_path / "none.nc", "no such file or folder; run the step that writes it"),
        (tmp_path, r"a folder of several; name one of its files: c\.nc, cut\.nc"),
        (text, "give a file of this program"),
        (cut, "give a file of this program"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            stored_arrays.open_dataset(path)
        assert str(caught.value).isprintable()
        assert str(caught.value).startswith(f"{path}: results: ")
    with pytest.raises(InputError, match="results: has no 'total'; give a file of this program"):
        stored_arrays.open_dataset(tmp_path / "c.nc", "direct", "total")


def test_luminance_weighs_channels_and_leaves_grey_alone():
    grey = xr.DataArray(np.ones((2, 3), np.float32), dims=("time", "sensor"))
    assert schema.luminance(grey) is grey
    channels = grey.expand_dims(channel=["red", "green", "blue"])
    np.testing.assert_allclose(schema.luminance(channels), grey, rtol=1e-6)
    red = channels * xr.DataArray([1.0, 0.0, 0.0], dims="channel")
    np.testing.assert_allclose(schema.luminance(red), 0.2126, rtol=1e-6)


def test_the_error_of_a_mean_by_hand():
    mean, error = schema.mean_and_error(np.array([[1.0, 5.0], [3.0, 5.0]]))
    np.testing.assert_allclose(mean, [2, 5])
    np.testing.assert_allclose(error, [1, 0])


def test_positions_of_labels():
    known = np.array(LABELS, object)
    asked = [["sky_145", "ground"], ["sky_001", "sky_145"]]
    assert schema.positions(asked, known).tolist() == [[2, 0], [1, 2]]
    assert schema.positions([], known).shape == (0,)
    assert schema.positions(["sky_1", "ground"], known, missing=-1).tolist() == [-1, 0]
    with pytest.raises(schema.UnknownLabelsError, match="no 'sky_1' \\(2 missing\\)") as error:
        schema.positions(["sky_1", "ground", "sky_01"], known)
    assert error.value.labels == ("sky_1", "sky_01")


@pytest.mark.parametrize("fill", [np.nan, -999.0, None])
@pytest.mark.parametrize("scale", [None, 2.0])
def test_scales_and_fill_values_of_files_are_undone(tmp_path, fill, scale):
    values = np.array([1.5, np.nan, 3.0], np.float32)
    encoding = {"_FillValue": fill} | ({} if scale is None else {"scale_factor": scale})
    data = xr.Dataset({"values": ("sensor", values)})
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding={"values": encoding})
    opened = stored_arrays.open_dataset(tmp_path / "a.nc").load()
    np.testing.assert_array_equal(opened["values"], values)
    opened.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")  # no attribute stands in the way
