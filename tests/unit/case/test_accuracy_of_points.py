"""Few points take more samples, and small rooms finer cells, unless the case states them."""

import pytest

from drcmitsuba.case.accuracy import POINTS, Accuracy
from drcmitsuba.case.reading import load_case
from tests.unit.model import box_room as box


def test_as_many_points_as_the_defaults_are_made_for_take_the_defaults():
    for count in (POINTS, 5 * POINTS):
        assert Accuracy().of_points(count) == Accuracy()


def test_few_points_take_more_paths():
    usual, half, few = Accuracy(), Accuracy().of_points(POINTS // 2), Accuracy().of_points(1)
    assert half.paths == 2 * usual.paths
    assert few.paths == 64 * usual.paths
    assert few.cell_paths == 2 * usual.cell_paths
    assert (few.replicates, few.cell_size) == (usual.replicates, usual.cell_size)


def test_what_a_case_states_stays():
    stated = Accuracy(paths=128).of_points(2)
    assert stated.paths == 128
    assert stated.cell_paths > Accuracy().cell_paths


@pytest.mark.parametrize(
    ("extent", "size"),
    [
        ((6.0, 5.0, 3.0), 0.45), ((0.9, 1.0, 0.9), 0.45), ((0.4, 0.5, 0.3), 0.06),
        ((0.8, 20.0, 2.5), 0.16), ((0.2, 60.0, 60.0), 0.45), ((5.0, 5.0, 0.0), 0.45),
    ],
)  # fmt: skip
def test_cells_fit_small_rooms(extent, size):
    """A slit beside a hall, or a plane, is no small room."""
    assert Accuracy().of_rooms(extent).cell_size == pytest.approx(size)
    assert Accuracy(cell_size=1.0).of_rooms(extent).cell_size == 1.0


def test_many_components_share_photons():
    """A hall of 36 light pipes took 36 times as long as one pipe."""
    usual = Accuracy()
    assert usual.of_components(4) == usual
    assert usual.of_components(36).photons == round(usual.photons / 3)
    for count in (16, 1):
        assert usual.of_components(36).of_components(count) == usual.of_components(count)
    assert usual.of_components(1 << 30).photons == 1
    assert Accuracy(photons=1024).of_components(36).photons == 1024


def test_a_scale_model_has_cells_of_its_size(tmp_path):
    """A room of 4 by 5 by 3 m, a tenth as large."""
    room = box.room()
    for face in (*room["faces"], *room["faces"][1]["apertures"]):
        corners = face["geometry"]["boundary"]
        face["geometry"]["boundary"] = [[v / 10 for v in corner] for corner in corners]
    box.written(tmp_path, box.model(room))
    sensors = '[sensors]\nspaces = ["*"]\nspacing = 0.1\nheight = 0.08\n'
    (tmp_path / "case.toml").write_text(f'[model]\nfiles = ["box.hbjson"]\n{sensors}')
    case = load_case(tmp_path / "case.toml")
    assert case.accuracy.cell_size == pytest.approx(0.06)
    assert "cell_size" not in case.accuracy.stated
