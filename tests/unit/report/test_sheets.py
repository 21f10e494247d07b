"""Plans of several grids: sheets by storey and direction, one text in each grid, lines of rooms."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.quiver import Quiver

from drcmitsuba.model.model import SensorGrid
from drcmitsuba.report import figures, plots, tiles
from drcmitsuba.report.sheets import sheets
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.sensors import sensor_coordinates
from tests.model_rooms import house
from tests.unit.report.test_figures import line, numbers, said, texts


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def at(*grids):
    """E of grids: name, points (sensor, 3), and their normal."""
    names = np.repeat(np.array([g[0] for g in grids], object), [len(g[1]) for g in grids])
    points = np.concatenate([np.array(g[1], float) for g in grids])
    normals = [np.tile(g[2] if len(g) > 2 else [0, 0, 1], (len(g[1]), 1)) for g in grids]
    coords = dict(zip("xyz", points.T, strict=True))
    coords |= dict(zip(("nx", "ny", "nz"), np.concatenate(normals).T, strict=True))
    return xr.Dataset(coords={k: ("sensor", v) for k, v in {**coords, "grid": names}.items()})


def square(x, y, z, n=3):
    i = np.arange(n) * 0.5
    return [(x + a, y + b, z) for b in i for a in i]


def evaluated(case, stamps=200):
    """E and numbers of a case, brighter to the east."""
    coords = sensor_coordinates(case)
    x = coords["x"].values
    time = np.datetime64("2015-01-01T08:00", "ns") + np.arange(stamps) * np.timedelta64(40, "h")
    bright = (np.arange(stamps)[:, None] < stamps * x / 8) * 500.0 + 50
    arrays = {"total": (("time", "sensor"), bright), "direct_sun": (("time", "sensor"), 3 * bright)}
    E = xr.Dataset(arrays, {"time": time, **coords.coords})
    shares = {"sDA": 61.4, "ASE": 7.0}
    mine = {k: {"value": v, "low": v, "high": v} for k, v in shares.items()}
    names = dict.fromkeys(E["grid"].values) if "grid" in E.coords else {}
    return E, numbers() | ({"grids": dict.fromkeys(names, mine)} if names else {})


def test_rooms_of_one_storey_share_a_sheet():
    E = at(("a", square(0, 0, 0.8)), ("b", square(4, 0, 0.8)), ("c", square(0, 4, 0.3)))
    (one,) = sheets(E)
    assert one.sensors.tolist() == list(range(27))
    assert (one.low, one.high, one.below, one.above) == (0.3, 0.8, -np.inf, np.inf)
    assert one.faces_up


def test_storeys_and_grids_above_each_other_have_sheets_of_their_own():
    E = at(("desk", square(0, 0, 0.8)), ("floor", square(0, 0, 0)), ("up", square(0, 0, 3.8)))
    assert [s.sensors[0] for s in sheets(E)] == [0, 9, 18]
    assert [s.below for s in sheets(E)] == [-np.inf, -np.inf, 0.8]
    assert [s.above for s in sheets(E)] == [3.8, 3.8, np.inf]


def test_points_that_face_sideways_are_never_beside_those_that_face_up():
    E = at(("desk", square(0, 0, 0.8)), ("wall", square(4, 0, 1.2), [0.0, 1, 0]))
    up, sideways = sheets(E)
    assert (up.faces_up, sideways.faces_up) == (True, False)
    assert sideways.sensors.tolist() == list(range(9, 18))


def test_a_plan_has_tiles_and_a_text_for_each_grid():
    E = at(("a", square(0, 0, 0.8)), ("b", square(4, 0.2, 0.8)))
    values = xr.DataArray(np.arange(18.0), E.coords, ("sensor",))
    figure = plots.plan(values, texts={"a": "a\nsDA 5 %", "b": "b\nsDA 7 %"}, limit=9.0)
    meshes = [c for c in figure.axes[0].collections if isinstance(c, QuadMesh)]
    assert len(meshes) == 2
    assert meshes[0].norm.vmax == meshes[1].norm.vmax
    assert {"a\nsDA 5 %", "b\nsDA 7 %"} <= set(texts(figure))


def test_a_text_too_long_for_its_grid_is_shortened_or_left_out():
    E = at(("a", square(0, 0, 0.8)), ("b", square(100, 0, 0.8)), ("c", square(4, 0, 0.8)))
    values = xr.DataArray(np.arange(27.0), E.coords, ("sensor",))
    long = f"corridor of the{40 * ' northern'} wing\n5 %"
    assert "5 %" not in texts(plots.plan(values, texts={"a": long}))
    near = values.isel(sensor=[*range(9), *range(18, 27)])
    assert {"5 %"} <= set(texts(plots.plan(near, texts={"a": long})))


def test_points_that_face_sideways_are_arrows_with_a_word():
    case = house(sensors={"grids": ["*"]})
    angles = np.arange(8) * np.pi / 4
    around = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    eyes = SensorGrid("eyes", np.tile([2.0, 2, 1.2], (8, 1)), around)
    desk = SensorGrid("desk", np.array(square(5, 1, 0.8)), np.tile([0.0, 0, 1], (9, 1)))
    case._building = replace(case.building, grids=(eyes, desk))
    drawn = figures.pictures(case, *evaluated(case))
    up, sideways = drawn["sun_1_plan.png"], drawn["sun_2_plan.png"]
    assert "on planes across the arrows" in said(sideways)
    assert "arrows" not in said(up)
    (arrows,) = (c for c in sideways.axes[0].collections if isinstance(c, Quiver))
    assert np.hypot(arrows.U, arrows.V) == pytest.approx(np.hypot(arrows.U, arrows.V)[0])
    assert len(arrows.U) == 8


def test_each_storey_has_a_plan_of_its_rooms_with_their_shares():
    case = house()
    drawn = figures.pictures(case, *evaluated(case))
    assert set(drawn) == {
        f"{name}_{k}_plan.png" for name in ("illuminance", "autonomy", "sun") for k in (1, 2)
    } | {"monthly.png"}
    ground, upper = (drawn[f"autonomy_{k}_plan.png"] for k in (1, 2))
    assert {"floor 1\nsDA 61 %", "floor 2\nsDA 61 %"} <= set(texts(ground))
    assert "floor 3\nsDA 61 %" in texts(upper)
    assert "plan 1 of 2, points at 0.80 m" in said(ground)
    scales = {drawn[f"illuminance_{k}_plan.png"].axes[1].get_ylim() for k in (1, 2)}
    assert len(scales) == 1
    walls = line(ground, "room")
    assert np.nanmin(walls, axis=0) == pytest.approx([0, 0])
    assert np.nanmax(walls, axis=0) == pytest.approx([8, 5])
    assert (np.abs(walls[:, 0] - 4) < 1e-6).any()
    assert not (np.abs(line(upper, "room")[:, 0] - 4) < 1e-6).any()


def test_a_sloped_roof_light_shows_its_outline_on_its_storey_and_windows_on_theirs():
    case = house()
    drawn = figures.pictures(case, *evaluated(case))
    windows, light = (line(drawn[f"sun_{k}_plan.png"], "glazing") for k in (1, 2))
    assert np.nanmax(np.abs(windows[:, 1])) == pytest.approx(0)
    for end, edge in ((np.nanmin, [3, 2.5]), (np.nanmax, [5, 4])):
        assert end(light, axis=0) == pytest.approx(edge, abs=1e-3)


def test_rooms_without_sensors_are_surroundings_and_do_not_widen_the_view():
    case = house(sensors={"corner": [0.5, 0.5, 0.8], "count": [6, 8], "spacing": 0.5})
    figure = figures.pictures(case, *evaluated(case))["sun_plan.png"]
    assert figure.axes[0].get_xlim()[1] < 4.5
    assert np.nanmax(line(figure, "room")[:, 0]) == pytest.approx(4, abs=1e-6)
    assert "surroundings" in texts(figure)


def test_sheets_are_as_few_as_can_be_and_bounded():
    rng, n = np.random.default_rng(2), 300
    beside = [(f"b{i}", square(3 * (i % 40), 3 * (i // 40), 0.8)) for i in range(n)]
    piled = [(f"p{i}", square(*rng.random(2), 0.8)) for i in range(60)]
    assert len(sheets(at(*beside))) == 1
    assert len(sheets(at(*piled))) == 21
    tower = [("t", [(0.0, 0.0, 2.0 * k) for k in range(2000)])]
    assert len(sheets(at(*tower))) == 2000


@pytest.mark.parametrize("axis", ["x", "z"])
def test_sensors_without_a_place_are_refused(axis):
    E = at(("a", square(0, 0, 0.8)))
    with pytest.raises(InputError, match=f"plan: {axis}: a sensor without a place"):
        sheets(E.assign_coords({axis: ("sensor", np.full(9, np.nan))}))


@pytest.mark.parametrize("size", [(32, 32), (32, 33)])
def test_neighbours_of_few_and_of_many_sensors_are_as_far(size):
    """1,024 distances are compared each with each, 1,056 are looked up in a tree."""
    u, v = np.meshgrid(*(np.arange(n) for n in size))
    at = np.column_stack([u.ravel() * 0.5, v.ravel() * 0.7]) @ [[0.8, 0.6], [-0.6, 0.8]]
    assert tiles.neighbour_distance(np.concatenate([at, at[:40]])) == pytest.approx(0.5)
    at[0] += 1e-3  # the median does not know it
    assert tiles.neighbour_distance(at) == pytest.approx(0.5)
