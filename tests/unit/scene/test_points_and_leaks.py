"""Points on surfaces and outside of rooms; cracks and holes of models."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.model import SensorGrid
from drcmitsuba.model.space import Space, SpaceFloor
from drcmitsuba.plan import notes, plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import given_points, normals
from drcmitsuba.scene.leaks import crack_notes, refuse_leaks
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.sensors import placed_sensors, sensor_coordinates, sensor_points
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.luminances import at_rows
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests.model_rooms import GLASS, case_of, layer, prism

WINDOW = np.array([[0.5, 0, 0.9], [3.5, 0, 0.9], [3.5, 0, 2.5], [0.5, 0, 2.5]])


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def grid(name, *points, normal=(0, 0, 1)):
    return SensorGrid(
        name, np.array(points, float), np.tile(np.array(normal, float), (len(points), 1))
    )


def room(*grids, more=(), hole=None, model=None):
    """Room of 4 m by 5 m by 3 m with a southern window, and a hole (4, 3) in its ceiling."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    case = case_of(
        layer("floor", Lambertian(0.2), floor),
        layer("ceiling", Lambertian(0.8), ceiling, holes=[] if hole is None else [hole]),
        layer("walls", Lambertian(0.5), *walls, holes=[WINDOW]),
        layer("glass", GLASS, WINDOW[::-1]),
        *more,
        sensors={"grids": ["*"]},
        model=model or {},
    )
    case._building = replace(case.building, grids=grids or (grid("desk", [2, 2, 0.8]),))
    return case


def slit(width):
    return np.array([[1, 2, 3], [3, 2, 3], [3, 2 + width, 3], [1, 2 + width, 3]])


@pytest.mark.parametrize(
    "outside", [[2, 2, 4.0], [2, 2, 3.05], [2, -0.1, 1.5], [-3, 2, 1], [2, 2, -0.5]]
)
def test_a_point_outside_of_the_rooms_is_named_and_left_out(outside):
    """It was told as a leak of 1 % of the rays, at a place that said nothing about the point."""
    case = room(grid("desk", [2, 2, 0.8], outside, [3, 4, 0.8]))
    placed = placed_sensors(case)
    np.testing.assert_array_equal(placed.points, [[2, 2, 0.8], [3, 4, 0.8]])
    place = ", ".join(f"{v:g}" for v in outside)
    [note] = placed.notes
    assert note == (
        f"sensors: 1 of 3 points of grid 'desk' lies outside of the rooms, at ({place}): left out"
    )
    refuse_leaks(case)
    assert note in notes(case)
    assert sensor_coordinates(case).sizes["sensor"] == 2


def test_points_beside_windows_and_in_corners_are_in_the_room():
    inner = [[2, 0.02, 1.5], [0.01, 0.01, 0.01], [3.99, 4.99, 2.99], [2, 0.3, 2.0]]
    placed = placed_sensors(room(grid("desk", *inner)))
    assert placed.notes == ()
    assert len(placed.points) == 4


def test_a_grid_before_the_facade_is_left_out_beside_others_and_counts_alone():
    """Alone, it is what the user asks for: half of a sky without interreflection, π/2 + ground."""
    facade = grid("façade", *([x, -0.1, 1.0] for x in (0.5, 1.5)), normal=(0, -1, 0))
    placed = placed_sensors(room(grid("desk", [2, 2, 0.8]), facade))
    assert [each.name for each in placed.grids] == ["desk"]
    assert "2 of 2 points of grid 'façade'" in placed.notes[0]
    case = room(facade)
    alone = placed_sensors(case)
    assert len(alone.points) == 2
    assert "all 2 points, the first at (0.5, -0.1, 1), lie outside of rooms" in alone.notes[0]
    refuse_leaks(case)
    none = Suns((), np.zeros((0, 3)), 0.53)
    C = compute(load(case), *sensor_points(case), none, case.accuracy)["replicates"].values
    sums = C.mean(axis=0)
    np.testing.assert_allclose(sums[:, 0], np.pi / 2, rtol=0.01)
    np.testing.assert_allclose(sums[:, 1:].sum(axis=1), np.pi / 2, rtol=0.01)
    meant = placed_sensors(room(facade, model={"leaks": "allow"}))
    assert len(meant.points) == 2
    assert meant.notes == ()


def test_sensors_outside_get_suns_that_reach_no_opening():
    """The window faces south: in an evening of summer the sun stands before no pane."""
    west = grid("west", [-1.0, 2.0, 1.0], normal=(-1, 0, 0))
    for case, is_lit in ((room(), False), (room(west), True)):
        light = daylight(case)
        x, y, _ = light.sky["sun_direction"].values.T
        shines = light.sky["sun"].values > 0
        light = at_rows(light, np.flatnonzero((x < -0.5) & (y > 0.1) & shines)[:1])
        scope = plan(case, light).scope
        assert scope.enabled_suns(light.suns).tolist() == [is_lit]
        C = compute(load(case, effects=scope), *sensor_points(case), light.suns, case.accuracy)
        assert bool(C["straight"].isel(bin=-1).sum() > 0) == is_lit


def test_a_room_without_a_roof_leaks_and_its_points_are_not_outside():
    floor, _, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    case = case_of(
        layer("floor", Lambertian(0.2), floor), layer("walls", Lambertian(0.5), *walls),
        sensors={"floors": ["floor"]},
    )  # fmt: skip
    assert placed_sensors(case).notes == ()
    with pytest.raises(InputError, match="% of the rays in its rooms leave it"):
        refuse_leaks(case)


def test_points_on_the_floor_are_lifted():
    """Radiance lifts them, too; they were refused."""
    placed = placed_sensors(room(grid("floor", [1, 1, 0], [2, 2, 0], [2, 3, 0.8])))
    assert placed.points[:, 2] == pytest.approx([1e-3, 1e-3, 0.8], abs=2e-5)
    [note] = placed.notes
    assert "2 of 3 points lie on a surface, the first at (1, 1, 0): lifted by 1 mm" in note
    with pytest.raises(InputError, match="on a surface of the model"):  # the wall stays as near
        placed_sensors(room(grid("floor", [1, 0, 0.5])))


def test_a_crack_is_noted_and_a_hole_refused():
    """A crack of some millimetres refused three of ten sample models."""
    crack = room(hole=slit(0.006))
    refuse_leaks(crack)
    [note] = crack_notes(crack)
    assert "by cracks below 30 mm" in note
    assert note in notes(crack)
    share = float(note.split()[1])
    assert 0.01 < share < 0.3
    assert crack_notes(room()) == []
    corner = np.array([[0.001, 1, 3], [0.1, 1, 3], [0.1, 1.6, 3], [0.001, 1.6, 3]])  # by a wall
    for hole in (slit(0.2), corner, np.array([[1, 2, 3], [1.3, 2, 3], [1.3, 2.3, 3], [1, 2.3, 3]])):
        with pytest.raises(InputError, match="leave it near"):
            refuse_leaks(room(hole=hole))


def test_a_leak_names_its_space():
    case = room(hole=slit(0.2))
    spaces = tuple(
        Space(name, (SpaceFloor(0.0, shapely.box(x, 0, x + 4, 6)),), 3.0)
        for name, x in (("east", 4.0), ("west", 0.0))
    )
    case._building = replace(case.building, spaces=spaces)
    with pytest.raises(InputError, match=r'leave it near .* most from "west"'):
        refuse_leaks(case)


def test_two_panes_with_a_gap_are_a_window():
    """Rays that leave between the panes of a double glazing were a leak of 0.1 %."""
    outer = layer("glass", GLASS, WINDOW[::-1] - [0, 0.02, 0])
    case = room(grid("desk", *([x, 1, 0.8] for x in (1, 2, 3))), more=(outer,))
    refuse_leaks(case)
    assert len(crack_notes(case)) <= 1


@pytest.mark.parametrize("winding", [1, -1])
def test_a_film_behind_another_pane_faces_the_room(winding):
    """Box window: glass a little before the film, closed around; the corners do not matter."""
    outer = WINDOW - [0, 0.12, 0]
    collar = [[WINDOW[i], outer[i], outer[i - 1], WINDOW[i - 1]] for i in range(4)]
    case = room(more=(layer("collar", Lambertian(0.5), *collar), layer("storm", GLASS, outer)))
    layers = [
        replace(each, quads=each.quads[:, ::winding]) if each.name == "glass" else each
        for each in case.building.layers
    ]
    panes = panes_of_model(replace(case.building, layers=tuple(layers)))
    names = [layers[i].name for i in panes.layer]
    np.testing.assert_allclose(panes.front[names.index("glass")], [0, 1, 0], atol=1e-9)
    turned = panes.quads[[each.name for each in layers].index("glass")]
    np.testing.assert_allclose(normals(turned), [[0, 1, 0]] * len(turned), atol=1e-9)
    assert panes.outside.tolist() == [name == "storm" for name in names]


@pytest.mark.parametrize("points", [["hole"], [(1, 2)], [], [(1, 2, np.nan)], [(1, 2, 3), (1, 2)]])
def test_points_that_are_none_are_refused(points):
    with pytest.raises(InputError, match="x, y and z of each"):
        given_points(points, "case.toml")


def test_one_point_is_a_row():
    assert given_points((1, 2, 3), "case.toml").tolist() == [[1, 2, 3]]
