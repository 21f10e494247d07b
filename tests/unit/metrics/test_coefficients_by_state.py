"""States lie along one dim on disk, whether they are joined in memory or written one by one."""

import itertools

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.metrics import stored_arrays
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.runtime import storage, zarr_folder
from drcmitsuba.runtime.aligned_arrays import is_aligned
from drcmitsuba.runtime.errors import InputError

BINS = ["ground", "sky_1", "sun_a", "sun_b", "sun_c"]
KINDS = [*itertools.product([False, True], repeat=3)]


def state(bins, rng, *, is_coloured, suns, has_groups):
    """C of a state for some bins and, with an adaptive sun, for some suns of the time stamps."""
    dims, sizes = ("channel",) * is_coloured, (3,) * is_coloured
    data = {
        "straight": ((*dims, "sensor", "bin"), rng.random((*sizes, 4, len(bins)), np.float32)),
        "replicates": (
            (*dims, "replicate", "sensor", "bin"),
            rng.random((*sizes, 2, 4, len(bins)), np.float32),
        ),
    }
    coords = {"bin": np.array(bins, object), "x": ("sensor", np.arange(4.0))}
    if is_coloured:
        coords["channel"] = np.array(["red", "green", "blue"], object)
    if suns is not None:
        values = rng.random((*sizes, 4, len(suns)), np.float32)
        data["sun_straight"] = ((*dims, "sensor", "sun"), values)
        coords["sun"] = np.array(suns, object)
    if has_groups:
        data["pane_group"] = (("sensor", "bin"), rng.random((4, len(bins)), np.float32))
    return xr.Dataset(data, coords)


def text_as_objects(data):
    """Dataset whose text has one type."""
    text = {k: v.astype(object) for k, v in data.variables.items() if v.dtype.kind in "TUO"}
    return data.assign_coords(text)


@pytest.mark.parametrize("chunk", [1 << 24, 40])
@pytest.mark.parametrize(("is_coloured", "is_adaptive", "has_groups"), KINDS)
def test_states_written_one_by_one_are_those_joined(
    tmp_path, monkeypatch, is_coloured, is_adaptive, has_groups, chunk
):
    monkeypatch.setattr(zarr_folder, "LARGEST_CHUNK", chunk)
    rng, kind = np.random.default_rng(4), {"is_coloured": is_coloured}
    suns = (["t1", "t2", "t3"], ["t2"]) if is_adaptive else (None, None)
    of_open = state(BINS, rng, suns=suns[0], has_groups=has_groups, **kind)
    of_shaded = state([*BINS[:2], "sun_b"], rng, suns=suns[1], has_groups=False, **kind)
    C = Coefficients(of_open.assign_attrs(has_shade=1), {"shaded": of_shaded})
    storage.save_zarr(C.parts(), tmp_path / "C.zarr", along="state")
    stored = xr.open_zarr(tmp_path / "C.zarr", chunks=None).load()
    joined = C.joined()
    xr.testing.assert_equal(text_as_objects(stored), text_as_objects(joined))
    assert np.isnan(joined["straight"].sel(state="shaded", bin="sun_a")).all()
    assert {k: v.dims for k, v in stored.items()} == {k: v.dims for k, v in joined.items()}
    again = Coefficients.of(
        stored_arrays.open_dataset(tmp_path / "C.zarr", "replicates", "straight", "state").load()
    )
    for name, own in C.states.items():
        for variable in ("straight", "replicates"):
            np.testing.assert_array_equal(again.states[name][variable], own[variable])
        assert is_aligned(again.states[name]["replicates"].values)


def test_what_is_no_coefficients_is_refused():
    for given in (xr.Dataset({"total": ("time", [100.0])}), "coefficients.zarr"):
        with pytest.raises(InputError, match="coefficients: state, replicate: what has no state"):
            Coefficients.of(given)
