"""Grids of a model's sensors: one for each room, with names and normals, made once."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.sensors import MOST_GRIDS, FloorSensors
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.model import SensorGrid
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import leaks, sensors
from drcmitsuba.scene.floors_of_model import floor_below, rooms_of, section
from drcmitsuba.scene.sensors import sensor_coordinates, sensor_points
from tests.model_rooms import case_of, house, l_room, layer, prism

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def with_grids(*grids, **tables):
    case = house(sensors={"grids": ["*"]}, **tables)
    case._building = replace(case.building, grids=grids)
    return case


def grid(name, *points, normal=UP):
    return SensorGrid(
        name, np.array(points, float), np.tile(np.array(normal, float), (len(points), 1))
    )


def office(*walls):
    """Floor of 8 m by 5 m with walls of 3 m above lines in plan."""
    outline = [(0, 0), (8, 0), (8, 5), (0, 5)]
    low, high, outer = prism(outline, 3.0)
    inner = [[[*a, 0], [*b, 0], [*b, 3], [*a, 3]] for a, b in walls]
    return case_of(
        layer("floor", Lambertian(0.3), low), layer("ceiling", Lambertian(0.8), high),
        layer("walls", Lambertian(0.5), *outer, *inner), sensors={"floors": ["floor"]},
    )  # fmt: skip


def rooms(case, height=0.8):
    return rooms_of(case.building, ("floor",), height, "case")


def test_every_room_of_every_floor_is_a_grid():
    at = sensor_coordinates(house())
    names, counts = np.unique(at["grid"].values, return_counts=True)
    assert names.tolist() == ["floor 1", "floor 2", "floor 3"]
    assert counts.tolist() == [63, 63, 135]
    for name, (x, z) in {"floor 1": (2, 0.8), "floor 2": (6, 0.8), "floor 3": (4, 3.8)}.items():
        mine = at.isel(sensor=np.flatnonzero(at["grid"].values == name))
        assert mine["x"].mean() == pytest.approx(x)
        assert mine["z"].values == pytest.approx(z)


@pytest.mark.parametrize(
    ("walls", "areas"),
    [
        ([], [40]),
        ([((3, 0), (3, 5))], [15, 25]),
        ([((3, 0), (3, 4))], [40]),  # an opening joins two rooms
        ([((3, 0), (3, 2.497)), ((3, 2.503), (3, 5))], [15, 25]),  # walls drawn with a gap of 6 mm
        ([((0, 2), (8, 2)), ((4, 2), (4, 5))], [16, 12, 12]),
        ([((3, 2), (3.4, 2)), ((3.4, 2), (3.4, 2.4)), ((3.4, 2.4), (3, 2.4)),
          ((3, 2.4), (3, 2))], [40]),
    ],
)  # fmt: skip
def test_walls_cut_a_floor_into_rooms_and_columns_do_not(walls, areas):
    parts = rooms(office(*walls))
    assert [room.outline.area for room in parts] == pytest.approx(areas, abs=0.2)
    assert [room.name for room in parts] == (
        ["floor"] if len(areas) == 1 else [f"floor {i + 1}" for i in range(len(areas))]
    )


def test_a_low_partition_cuts_no_room_above_it():
    case = office(((3, 0), (3, 5)))
    assert len(rooms(case, 0.8)) == 2
    assert len(rooms(case, 3.5)) == 1


def test_a_room_is_named_by_the_material_of_most_of_its_floor():
    case = office(((4, 0), (4, 5)))
    carpet = [[1, 1, 0], [4, 1, 0], [4, 5, 0], [1, 5, 0]]
    layers = (*case.building.layers, layer("carpet", Lambertian(0.1), carpet))
    case._building = replace(case.building, layers=layers)
    parts = rooms_of(case.building, ("floor", "carpet"), 0.8, "case")
    assert [room.name for room in parts] == ["floor 1", "floor 2"]


def test_a_section_cuts_surfaces_where_they_cross_a_height():
    lines = section(office(((3, 0), (3, 5))).building, 0.8)
    lengths = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    assert sorted(lengths) == pytest.approx([5, 5, 5, 8, 8])
    assert len(section(office().building, 3.0)) == 4  # walls that end there
    assert len(section(office().building, 3.1)) == 0


def test_the_floor_of_a_storey_is_its_largest_level():
    model = house().building
    assert floor_below(model, 0.8)[1] == pytest.approx(0)
    assert floor_below(model, 3.8, 0.8)[1] == pytest.approx(3)
    assert floor_below(model, -1.0)[0].is_empty


def test_one_grid_needs_no_name_and_points_that_face_up_no_normals():
    at = sensor_coordinates(with_grids(grid("desk", [1, 1, 0.8], [2, 1, 0.8])))
    assert set(at.coords) == {"x", "y", "z"}


def test_normals_are_told_where_points_do_not_face_up():
    case = with_grids(
        grid("desk", [1, 1, 0.8]), grid("eye", [2, 1, 1.2], normal=[0, 1, 0]), north=90.0
    )
    at = sensor_coordinates(case)
    assert at["grid"].values.tolist() == ["desk", "eye"]
    normals = np.column_stack([at[name].values for name in ("nx", "ny", "nz")])
    np.testing.assert_allclose(normals, [[0, 0, 1], [-1, 0, 0]], atol=1e-9)


def test_grids_are_chosen_by_name_and_empty_ones_passed_over():
    empty = SensorGrid("void", np.empty((0, 3)), np.empty((0, 3)))
    case = with_grids(grid("a1", [1, 1, 0.8]), empty, grid("b1", [5, 1, 0.8]))
    assert sensor_coordinates(case)["grid"].values.tolist() == ["a1", "b1"]
    chosen = case.with_tables(sensors=case.sensors.model_copy(update={"grids": ("b*",)}))
    assert len(sensor_points(chosen)[0]) == 1
    none = case.with_tables(sensors=case.sensors.model_copy(update={"grids": ("v*",)}))
    with pytest.raises(InputError, match="the grids have no points"):
        sensor_points(none)


def test_too_many_grids_are_refused():
    points = np.random.default_rng(1).uniform([0.5, 0.5, 0.5], [3, 4, 2], (MOST_GRIDS + 1, 3))
    case = with_grids(*(grid(f"g{i}", p) for i, p in enumerate(points)))
    with pytest.raises(InputError, match="2001 grids; at most 2000"):
        sensor_points(case)


def test_the_margin_of_a_standard_is_chosen_by_its_name():
    by_name, by_number = (
        sensor_points(house(sensors={"floors": ["floor"], "margin": margin}))[0]
        for margin in ("EN 17037", 0.5)
    )
    np.testing.assert_array_equal(by_name, by_number)
    assert FloorSensors(floors=("floor",), margin="EN 17037").edge == 0.5


def test_sensors_and_leaks_are_looked_for_once(monkeypatch):
    counts = {"grids": 0, "leaks": 0}

    def counted(module, name, key):
        original = getattr(module, name)

        def call(*arguments):
            counts[key] += 1
            return original(*arguments)

        monkeypatch.setattr(module, name, call)

    counted(sensors, "above_floors", "grids")
    counted(leaks, "_lost", "leaks")
    for known in (sensors._sensors_of, leaks.leak_of):  # other tests have the same room
        known.cache_clear()
    case = l_room()
    for _ in range(3):
        sensor_points(case)
        leaks.refuse_leaks(case)
    assert counts == {"grids": 1, "leaks": 1}
    finer = case.with_tables(sensors=case.sensors.model_copy(update={"spacing": 0.5}))
    assert len(sensor_points(finer)[0]) > len(sensor_points(case)[0])
    assert counts["grids"] == 2
