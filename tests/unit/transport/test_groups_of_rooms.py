"""Sensors of rooms that share light on cells: which they are, and that nothing gets lost."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drcmitsuba.blocks.block_folder import NOTHING_KEPT, BlockFolder, BlockSeries
from drcmitsuba.blocks.part import BlockPart
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.coefficients import compute, groups_of
from tests.model_rooms import house, layer


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


@given(st.lists(st.integers(-1, 6), min_size=1, max_size=60), st.integers(1, 20))
def test_groups_hold_all_sensors_once_and_cut_no_room(rooms, most):
    rooms = np.array(rooms)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coefficients, "TOGETHER", most)
        groups = groups_of(rooms, len(rooms))
    assert groups[0].start == 0
    assert groups[-1].stop == len(rooms)
    for before, after in pairwise(groups):
        assert before.stop == after.start
        assert not set(rooms[: before.stop]) & set(rooms[after.start :])
    for group in groups:  # a larger one has a room, or a chain of rooms, that cannot be cut
        if group.stop - group.start > most and len(rooms) > most:
            inner = range(group.start + 1, group.stop)
            cuts = [i for i in inner if not set(rooms[:i]) & set(rooms[i:])]
            assert not [i for i in cuts if i - group.start <= most]


def test_few_sensors_and_unknown_rooms_share_everything():
    assert groups_of(None, 10**6) == [slice(0, 10**6)]
    assert groups_of(np.arange(5), 5) == [slice(0, 5)]


def three_rooms(*more):
    """House of three rooms: its scene, sensors, suns, accuracy, and the room of every sensor."""
    case = house(
        *more, accuracy={"replicates": 8, "paths": 64, "cell_size": 0.8}, sensors={
            "floors": ["floor"], "spacing": 1.0,
        },
    )  # fmt: skip
    points, normals = sensor_points(case)
    up = np.array([[0, -0.8, 0.6], [0.3, -0.5, 0.8124], [0, 0, 1.0]])
    suns = Suns(("a", "b", "c"), up / np.linalg.norm(up, axis=1, keepdims=True), 0.53)
    rooms = prepared(case).rooms_of(points)
    assert sorted(set(rooms.tolist())) == [0, 1, 2]
    return (load(case), points, normals, suns, case.accuracy), rooms


def test_groups_agree_with_all_sensors_together(monkeypatch, same):
    arguments, rooms = three_rooms()
    monkeypatch.setattr(coefficients, "TOGETHER", 20)
    assert len(groups_of(rooms, len(rooms))) == 3
    parted, whole = compute(*arguments, rooms=rooms), compute(*arguments)
    same(parted["replicates"].values, other=whole["replicates"].values, within=0.02)


def test_groups_have_their_own_random_numbers(monkeypatch):
    """Rooms that look alike would have the same noise, which no mean of many rooms would lower."""
    arguments, rooms = three_rooms()
    monkeypatch.setattr(coefficients, "TOGETHER", 20)
    C = compute(*arguments, rooms=rooms)["interreflected"].values
    west, east = C[rooms == 0], C[rooms == 1]
    assert west.shape == east.shape
    assert not np.allclose(west, east, rtol=1e-3)


def test_stored_blocks_of_groups_are_read_again(monkeypatch, tmp_path):
    arguments, rooms = three_rooms()
    monkeypatch.setattr(coefficients, "TOGETHER", 20)
    for number in (2, 1, 3):  # jobs of an array, in any order
        compute(*arguments, rooms=rooms, kept=BlockSeries(tmp_path, part=BlockPart(number, 3)))
    assert len(list(tmp_path.glob("*.zip"))) == 3
    monkeypatch.setattr(coefficients, "_of_block", None)  # nothing is left to be made
    stored = compute(*arguments, rooms=rooms, kept=BlockSeries(tmp_path))
    monkeypatch.undo()
    monkeypatch.setattr(coefficients, "TOGETHER", 20)
    np.testing.assert_array_equal(
        stored["replicates"], compute(*arguments, rooms=rooms)["replicates"]
    )


def board(reflectance, width=1.0):
    """Board on the wall of the upper room."""
    z, w = 3.5, width
    return layer(
        "board", Lambertian(reflectance), [(2, 4.9, z), (2 + w, 4.9, z), (2 + w, 4.9, 4.5)]
    )


@pytest.mark.parametrize("solved", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_change_in_one_room_leaves_the_blocks_of_others(solved, monkeypatch, tmp_path):
    """Light of a room that no path leaves depends on its own surfaces and on what shades it."""
    monkeypatch.setattr(coefficients, "TOGETHER", 20)
    cache, made, of_block = BlockFolder.cache(tmp_path), [], coefficients._of_block

    def counted(*arguments):
        made.append(len(arguments[3]))
        return of_block(*arguments)

    def found(reflectance, width=1.0, add=0.0, stored=True):
        (world, points, normals, suns, accuracy), rooms = three_rooms(board(reflectance, width))
        world = replace(world, effects=replace(world.effects, solved_cells=solved))
        suns = replace(suns, diameter=suns.diameter + add)
        kept = cache.series("house", world.content, suns) if stored else NOTHING_KEPT
        made.clear()
        C = compute(world, points, normals, suns, accuracy, rooms=rooms, kept=kept)
        return C["replicates"].values, rooms

    monkeypatch.setattr(coefficients, "_of_block", counted)
    before, rooms = found(0.2)
    assert len(made) == 3
    after, _ = found(0.8)
    assert len(made) == 1  # that of the upper room
    np.testing.assert_array_equal(after[:, rooms < 2], before[:, rooms < 2])
    assert after[:, rooms == 2].mean() > 1.001 * before[:, rooms == 2].mean()
    np.testing.assert_array_equal(found(0.8, stored=False)[0], after)
    for change in ({"width": 1.5}, {"add": 0.1}):  # it might shade; suns light every room
        found(0.8, **change)
        assert len(made) == 3
