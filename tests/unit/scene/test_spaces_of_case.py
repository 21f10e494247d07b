"""Spaces of a case: of a box, a model, a table; grids in them, and sensors in none."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import case_from
from drcmitsuba.case.spaces import with_tables
from drcmitsuba.model.model import SensorGrid
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.sensors import placed_sensors, sensor_coordinates
from drcmitsuba.scene.spaces import spaces_of
from tests import model_rooms
from tests.system.test_several_grids import ROOMS


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


WEST = {"outline": [[0, 0], [4, 0], [4, 5], [0, 5]], "height": 3.0, "use": "office"}
EAST = {"outline": [[4, 0], [8, 0], [8, 5], [4, 5]], "height": 3.0, "storey": "ground"}


def two_rooms(folder, sensors, **spaces):
    (folder / "rooms.rad").write_text(ROOMS)
    tables = {"model": {"files": ["rooms.rad"]}, "sensors": sensors, "spaces": spaces}
    return case_from(tables, folder / "case.toml")


def with_grid(case, *points):
    """Case of a model with a grid of points that face up."""
    grid = SensorGrid("desks", np.array(points, float), np.tile([0.0, 0, 1], (len(points), 1)))
    case._building = replace(case.building, grids=(grid,))
    return case


def test_a_box_is_one_space():
    case = Case.model_validate(
        {
            "name": "room",
            "room": {"size": [4, 6, 3]},
            "sensors": {"corner": [0, 0, 0.8], "count": [2, 2], "spacing": 1.0},
        }
    )
    [space] = spaces_of(case)
    assert (space.name, space.floor_area, space.height, space.volume) == ("room", 24, 3, 72)
    assert set(sensor_coordinates(case).coords) == {"x", "y", "z"}


def test_rooms_above_floors_are_spaces():
    case = model_rooms.house()
    assert [space.name for space in spaces_of(case)] == ["floor 1", "floor 2", "floor 3"]
    assert [space.floor_area for space in spaces_of(case)] == pytest.approx([20, 20, 40], rel=0.02)
    at = sensor_coordinates(case)
    np.testing.assert_array_equal(at["space"], at["grid"])
    lower = at["z"].values < 3
    np.testing.assert_array_equal(at["space"] == "floor 3", ~lower)


def test_tables_name_rooms_and_lay_grids(tmp_path):
    case = two_rooms(tmp_path, {"spaces": ["*"], "spacing": 1.0}, west=WEST, east=EAST)
    west, east = spaces_of(case)
    assert (west.name, west.use, west.floor_area) == ("west", "office", 20)
    assert (east.storey, east.volume) == ("ground", 60)
    at = sensor_coordinates(case)
    assert sorted(set(at["grid"].values)) == ["east", "west"]
    np.testing.assert_array_equal(at["space"] == "west", at["x"] < 4)
    one = two_rooms(tmp_path, {"spaces": ["we*"], "spacing": 1.0}, west=WEST, east=EAST)
    assert set(sensor_coordinates(one)["space"].values) == {"west"}


def test_a_grid_across_two_rooms_counts_in_each(tmp_path):
    case = two_rooms(tmp_path, {"grids": ["*"]}, west=WEST, east=EAST)
    case = with_grid(case, [1, 1, 0.8], [6, 1, 0.8], [2, 1, 0.8])
    at = sensor_coordinates(case)
    assert at["x"].values.tolist() == [1, 6, 2]  # the order stays
    assert at["space"].values.tolist() == ["west", "east", "west"]
    assert at["grid"].values.tolist() == ["west (desks)", "east (desks)", "west (desks)"]


def test_sensors_in_no_space_are_left_out_and_counted(tmp_path):
    case = two_rooms(tmp_path, {"grids": ["*"]}, west=WEST)
    case = with_grid(case, [1, 1, 0.8], [6, 1, 0.8], [7, 1, 0.8])
    placed = placed_sensors(case)
    assert placed.points.tolist() == [[1, 1, 0.8]]
    [note] = placed.notes
    assert "2 of 3 points of grid 'desks' lie in no space, the first at (6, 1, 0.8)" in note
    nowhere = with_grid(two_rooms(tmp_path, {"grids": ["*"]}, west=WEST), [6, 1, 0.8])
    assert len(placed_sensors(nowhere).points) == 1


def test_some_spaces_are_evaluated(tmp_path):
    case = two_rooms(tmp_path, {"grids": ["*"]}, west=WEST, east=EAST)
    case = with_grid(case, [1, 1, 0.8], [6, 1, 0.8], [2, 1, 0.8])
    at = sensor_coordinates(case.with_spaces(["ea*"]))
    assert at["x"].values.tolist() == [6]
    assert at["space"].values.tolist() == ["east"]
    assert sensor_coordinates(case.with_spaces([])).sizes["sensor"] == 3
    with pytest.raises(InputError, match='no space with sensors is called "north"'):
        placed_sensors(case.with_spaces(["north"]))


def test_a_space_without_sensors_is_named(tmp_path):
    case = two_rooms(tmp_path, {"grids": ["*"]}, west=WEST, east=EAST)
    [note] = placed_sensors(with_grid(case, [1, 1, 0.8])).notes
    assert note == "sensors: there are none in the spaces: east."


@pytest.mark.parametrize(
    ("tables", "field", "got"),
    [
        ({"a": {}}, "spaces.a.outline", "the model has no space of this name"),
        ({"a": {"outline": [[0, 0], [2, 2], [2, 0], [0, 1]]}}, "spaces.a.outline", "Self-inters"),
        ({"a": {"outline": [[0, 0], [1, 1], [2, 2]]}}, "spaces.a.outline", "no area"),
        ({"a": WEST, "b": WEST}, "spaces.a.outline", 'it overlaps "b" at (2.00, 2.50)'),
        ({"a": {**WEST, "use": 3}}, "spaces.a.use", "3"),
    ],
)
def test_unfit_tables_are_named(tmp_path, tables, field, got):
    with pytest.raises(InputError) as error:
        two_rooms(tmp_path, {"floors": ["floor"]}, **tables)
    assert error.value.field == field
    assert got in error.value.got


def test_spaces_need_names_that_are_there(tmp_path):
    with pytest.raises(InputError, match='there is no space "north'):
        placed_sensors(two_rooms(tmp_path, {"spaces": ["north"]}, west=WEST))


def test_spaces_above_one_another_do_not_overlap(tmp_path):
    upper = {**WEST, "floor": 3.0}
    case = two_rooms(tmp_path, {"floors": ["floor"]}, low=WEST, high=upper)
    assert [space.floors[0].height for space in case.building.spaces] == [0, 3]


def test_a_table_renames_the_use_of_a_known_space(tmp_path):
    case = two_rooms(tmp_path, {"floors": ["floor"]}, west=WEST)
    known = case.building.spaces
    table = Case.model_fields["spaces"].annotation.__args__[1](use="lab", storey="3")
    [space] = with_tables(known, {"west": table}, "case")
    assert (space.use, space.storey, space.floor_area) == ("lab", "3", 20)
