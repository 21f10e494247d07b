"""C and L as files: their product, also by Radiance's own programs, is the illuminance."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.sparse import csr_matrix

from drcmitsuba.export import mtx
from drcmitsuba.export.matrices import matrices, save_matrices
from drcmitsuba.export.mtx import write_mtx
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.illuminance import illuminance
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from tests import radiance, skips
from tests.unit.export.radiance_text import matrix
from tests.unit.metrics.test_accumulate import BINS, coefficients, sky

SHADE = {"has_shade": 1, "shade_threshold": 1500.0, "shade_area": 0.02}


def with_shade(factor=0.1):
    """Open façade, and one that lets a share of the light in; the shade closes at 11 h."""
    straight = np.array([[0.0, 0.0, 1e-5, 1e-5]], np.float32)
    made = coefficients(straight=straight).assign_attrs(SHADE)
    return Coefficients(made, {"shaded": made.map(lambda v: v * factor)})


@pytest.mark.parametrize("block", [1, 3, 1 << 22])
@pytest.mark.parametrize("kind", ["grey", "colour", "sparse"])
def test_a_matrix_comes_back_exactly(tmp_path, monkeypatch, kind, block):
    monkeypatch.setattr(mtx, "BLOCK", block)
    shape = (5, 4, 3) if kind == "colour" else (5, 4)
    values = np.random.default_rng(0).random(shape).astype(np.float32)
    values[values < 0.5] = 0
    write_mtx(tmp_path / "m.mtx", csr_matrix(values) if kind == "sparse" else values)
    expected = values if kind == "colour" else np.repeat(values[..., None], 3, axis=-1)
    np.testing.assert_array_equal(matrix(tmp_path / "m.mtx"), expected)


def test_the_product_is_the_illuminance_with_the_shade_applied():
    states = with_shade()
    E = illuminance(states, sky())
    assert E["shade_closed"].values.tolist() == [False, True, False]
    made = matrices(states, sky())
    assert made.bins == (*(f"open {b}" for b in BINS), *(f"shaded {b}" for b in BINS))
    np.testing.assert_allclose(made.C @ made.L.toarray(), E["total"].values.T, rtol=1e-6)
    assert made.L.toarray()[:4, 1].tolist() == [0] * 4


def test_without_a_shade_that_closes_there_are_the_open_bins_alone():
    states = Coefficients(coefficients())
    made = matrices(states, sky())
    assert made.bins == tuple(f"open {b}" for b in BINS)
    E = illuminance(states, sky())["total"].values.T
    np.testing.assert_allclose(made.C @ made.L.toarray(), E, rtol=1e-6)


def test_colours_keep_their_channels(tmp_path):
    share = xr.DataArray([1.0, 0.5, 0.25], {"channel": ["red", "green", "blue"]}, dims="channel")
    made = coefficients()
    coloured = (made * share).transpose("channel", ...)
    states = Coefficients(coloured.assign_attrs(made.attrs))
    save_matrices(states, sky(), tmp_path / "m")
    C, L = matrix(tmp_path / "m" / "C.mtx"), matrix(tmp_path / "m" / "L.mtx")
    E = illuminance(states, sky())["total"].transpose("sensor", "time", "channel").values
    np.testing.assert_allclose(np.einsum("sbc,btc->stc", C, L), E, rtol=1e-6)


@skips.RADIANCE.mark
@pytest.mark.parametrize(
    "command", [["dctimestep", "-oa", "C.mtx", "L.mtx"], ["rmtxop", "-fa", "C.mtx", ".", "L.mtx"]]
)
def test_radiance_multiplies_to_the_same(tmp_path, command):
    states = with_shade()
    save_matrices(states, sky(), tmp_path / "m")
    text = radiance.run(command, tmp_path / "m").decode().split("\n\n", 1)[1]
    E = np.array(text.split(), float).reshape(1, 3, 3)
    expected = illuminance(states, sky())["total"].values.T[..., None]
    np.testing.assert_allclose(E, np.repeat(expected, 3, axis=-1), rtol=1e-4)


def test_rows_and_columns_are_named(tmp_path):
    save_matrices(with_shade(), sky(), tmp_path / "m")
    files = {file.name for file in (tmp_path / "m").iterdir()}
    assert files == {"C.mtx", "L.mtx", "bins.txt", "times.txt", "sensors.txt"}
    assert (tmp_path / "m" / "bins.txt").read_text().splitlines()[0] == "open ground"
    assert (tmp_path / "m" / "times.txt").read_text().splitlines()[1] == "2015-03-21T11:00"
    assert np.loadtxt(tmp_path / "m" / "sensors.txt").tolist() == [0, 1, 2]


def test_missing_numbers_and_states_are_refused(tmp_path):
    states = with_shade()
    broken = states.open["replicates"].where(states.open["bin"] != "ground")
    with pytest.raises(InputError, match="some numbers are missing"):
        matrices(Coefficients(states.open.assign(replicates=broken), states.others), sky())
    with pytest.raises(InputError, match="no state shaded; 1 time stamps take it"):
        save_matrices(Coefficients(states.open), sky(), tmp_path / "m")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    def fail(files):
        (files / "half").write_text("half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), storage.new_folder(tmp_path / "a" / "m") as files:
        fail(files)
    assert list((tmp_path / "a").iterdir()) == []
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with storage.new_folder(Path()) as files:  # the current folder
        (files / "whole").write_text("whole")
    assert [file.name for file in tmp_path.joinpath("here").iterdir()] == ["whole"]
    assert [file.name for file in Path().iterdir()] == ["whole"]
    with (
        pytest.raises(InputError, match="it holds files already"),
        storage.new_folder(tmp_path / "here"),
    ):
        pass
