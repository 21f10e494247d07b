"""Shadow rays that miss all exits of a model are spared: no coefficient changes."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, Lambertian
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.exits import MARGIN, MOST, exits_of
from drcmitsuba.scene.geometry import normals as facing
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.interreflection.interior import RoomPaths
from drcmitsuba.transport.own_exits import Passages
from drcmitsuba.transport.rays import openings
from drcmitsuba.transport.rays.openings import in_rooms
from drcmitsuba.transport.rays.straight_suns import straight_suns
from tests.fast import slowly
from tests.model_rooms import GLASS, case_of, house, l_room, layer, prism

SUNS = np.random.default_rng(3).normal(size=(200, 3))
SUNS[:, 2] = abs(SUNS[:, 2])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)
YEAR = Suns(tuple(f"sun_{i}" for i in range(len(SUNS))), SUNS, 0.53)
TABLES = {
    "sensors": {"floors": ["floor*"], "spacing": 1.5},
    "accuracy": {
        "replicates": 2, "paths": 64, "cell_size": 0.6, "cell_sky_rays": 64,
        "sensor_sky_rays": 512, "sensor_sun_samples": 2,
    },
}  # fmt: skip
PRISM = str(shipped_folder() / "films" / "prism.xml")
FILM = BsdfMaterial(type="bsdf", file=PRISM, straight_through="on")
OPAL = DiffuserMaterial(type="diffuser", transmittance=0.4, reflectance=0.3)


def town():
    """Bright ground, and a wall before the southern windows: paths meet both through the glass."""
    ground = [(-20, -20, -0.1), (20, -20, -0.1), (20, 20, -0.1), (-20, 20, -0.1)]
    wall = [(-9, -4, 0), (9, -4, 0), (9, -4, 5), (-9, -4, 5)]
    return layer("town", Lambertian(0.6), ground, wall, role="context")


def two_rooms(pane=GLASS, partition=GLASS):
    """Two rooms with a pane between them; only the southern one has a window."""
    _, _, south = prism([(0, 0), (4, 0), (4, 4), (0, 4)], 3.0)
    _, _, north = prism([(0, 4), (4, 4), (4, 8), (0, 8)], 3.0)
    floor, ceiling, _ = prism([(0, 0), (4, 0), (4, 8), (0, 8)], 3.0)
    window = np.array([[0.5, 0, 0.8], [3.5, 0, 0.8], [3.5, 0, 2.6], [0.5, 0, 2.6]])
    between = np.array([[0.5, 4, 0.5], [3.5, 4, 0.5], [3.5, 4, 2.5], [0.5, 4, 2.5]])
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("south", Lambertian(0.6), south[0], holes=[window]),
        layer("middle", Lambertian(0.6), south[2], holes=[between]),
        layer("walls", Lambertian(0.5), south[1], south[3], *north[1:]),
        layer("window", pane, window[::-1]),
        *([] if partition is None else [layer("partition", partition, between)]),
        town(),
        **TABLES,
    )


def attic():
    """Room under a roof of one slope with a roof light, and a triangle of opal glass."""
    floor, _, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 2.0)
    high = [(0, 0, 2), (4, 0, 2), (4, 5, 4), (0, 5, 4)]
    light = np.array([[1, 1, 2.4], [3, 1, 2.4], [3, 4, 3.6], [1, 4, 3.6]])
    gable = np.array([[4, 0, 2], [4, 5, 2], [4, 5, 4]], float)
    back = [(0, 5, 2), (4, 5, 2), (4, 5, 4), (0, 5, 4)]
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("walls", Lambertian(0.5), *walls, back, [(0, 5, 2), (0, 0, 2), (0, 5, 4)]),
        layer("roof", Lambertian(0.7), high[::-1], holes=[light]),
        layer("light", GLASS, light),
        layer("gable", OPAL, gable),
        town(),
        north=25.0,
        **TABLES,
    )


def light_well():
    """Room whose window looks into a deep well: hardly a ray that leaves it there sees the sky."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 4), (0, 4)], 3.0)
    window = np.array([[1, 0, 0.8], [3, 0, 0.8], [3, 0, 2.6], [1, 0, 2.6]])
    base, _, well = prism([(0, -1), (4, -1), (4, 0), (0, 0)], 14.0)
    above = [(0, 0, 3), (4, 0, 3), (4, 0, 14), (0, 0, 14)]
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("south", Lambertian(0.6), walls[0], holes=[window]),
        layer("walls", Lambertian(0.5), *walls[1:]),
        layer("well", Lambertian(0.9), base, *well[:2], well[3], above),
        layer("glass", GLASS, window),
        **TABLES,
    )


ROOMS = {
    "an L with glass in many planes": lambda: l_room(**TABLES),
    "two rooms with glass between": two_rooms,
    "two rooms with opal glass between": lambda: two_rooms(partition=OPAL),
    "two rooms behind a film that is seen through": lambda: two_rooms(pane=FILM),
    "a sloped roof light": attic,
    "a window to a deep well": light_well,
}

SLOW = (
    "two rooms behind a film that is seen through",  # whose own rays, most of all, are not spared
    "two rooms with opal glass between",
    "a window to a deep well",
)


@pytest.mark.parametrize(
    "room", [pytest.param(n, marks=[pytest.mark.slow] * (n in SLOW)) for n in ROOMS]
)
def test_sparing_rays_changes_no_coefficient(room):
    case, C, straight, rays = ROOMS[room](), [], [], []
    for enclosed in (True, False):
        world = load(case, effects=EnabledEffects(enclosed=enclosed))
        points, normals = sensor_points(case)
        assert world.enclosure.spares == enclosed
        C.append(compute(world, points, normals, YEAR, case.accuracy)["replicates"].values)
        rays.append(world.ray_counter.counted()["shadow"])
        straight.append(straight_suns(world, points, normals, YEAR, case.accuracy))
    assert C[0].max() > 0
    np.testing.assert_allclose(C[0], C[1], rtol=0, atol=1e-6 * C[1].max())
    for with_exits, without in zip(*straight, strict=True):
        np.testing.assert_array_equal(with_exits, without)
    # The fine patches of a pane that a frame may shade send rays of their own.
    most = 0.98 if room in SLOW else 0.85 if room == "a sloped roof light" else 0.7
    assert rays[0] < most * rays[1]


def by_side(points):
    """Number of the room of two: 0 south of y = 4 m, 1 north of it."""
    return (points[:, 1] > 4).astype(int)


def by_house(points):
    """Number of the room of a house."""
    return np.where(points[:, 2] > 3, 2, points[:, 0] > 4)


def black_house():
    """House in which the roof alone reflects light: lower rooms have no cells."""
    case = house(**TABLES)
    dark = [
        replace(one, material=Lambertian(0.0)) if one.name in ("floor", "walls") else one
        for one in case.building.layers
    ]
    case._building = replace(case.building, layers=tuple(dark))
    return case


SEVERAL = {
    "black rooms below one with a white roof": (black_house, by_house),
    "glass between": (two_rooms, by_side),
    "opal glass between": (lambda: two_rooms(partition=OPAL), by_side),
    "a hole between": (lambda: two_rooms(partition=None), by_side),
    "one above two": (lambda: house(**TABLES), by_house),
    "rooms that are none": (lambda: l_room(**TABLES), lambda p: (p[:, 0] > 2).astype(int)),
}


@pytest.mark.parametrize("name", slowly(SEVERAL, "opal glass between", "rooms that are none"))
def test_exits_of_its_own_room_are_all_that_a_point_needs(name):
    """Light through two panes in turn, and beyond a hole, is there; rays through others are not."""
    make, room_of = SEVERAL[name]
    case, C, rays = make(), [], []
    points, normals = sensor_points(case)
    for rooms in (None, room_of(points)):
        world = load(case)
        found = compute(world, points, normals, YEAR, case.accuracy, rooms=rooms)
        C.append(found["replicates"].values)
        rays.append(world.ray_counter.counted()["shadow"])
    for room in np.unique(room_of(points)):
        assert C[0][:, room_of(points) == room].max() > 0
    np.testing.assert_allclose(C[1], C[0], rtol=0, atol=1e-6 * C[0].max())
    assert rays[1] <= 1.001 * rays[0]  # rectangles of a room lie within those of all
    if name == "one above two":
        assert rays[1] < 0.8 * rays[0]


def test_exits_of_a_room_are_on_its_side():
    case = two_rooms()
    world, (points, normals) = load(case), sensor_points(case)
    rooms = by_side(points) + 1
    paths = RoomPaths.of(world, points, normals, case.accuracy, rooms).gathered
    told = Passages.of(world, case.accuracy.cell_size).told(world, paths, points)
    south, north = (
        {(round(float(q[0, 1])), round(float(n[1]))) for q, n in zip(own, facing(own), strict=True)}
        for own in told.enclosure.exits_by_room
    )
    window, partition, behind = (0, 1), (4, -1), (4, 1)  # y of the pane, and where its front faces
    assert south >= {window, partition}
    assert behind not in south
    assert behind in north
    assert not north & {window, partition}


def test_exits_of_another_room_lose_light(monkeypatch):
    case, C, told = two_rooms(), [], Passages.told
    points, normals = sensor_points(case)
    for step in (1, -1):

        def with_exits(passages, *about, step=step):
            scene = told(passages, *about)
            room = scene.enclosure
            return replace(scene, enclosure=replace(room, exits_by_room=room.exits_by_room[::step]))

        monkeypatch.setattr(Passages, "told", with_exits)
        found = compute(load(case), points, normals, YEAR, case.accuracy, rooms=by_side(points))
        C.append(found["direct"].values[by_side(points) == 0])
    assert C[1].sum() < 0.7 * C[0].sum()


def test_a_room_with_too_many_exits_traces_all_rays():
    window = np.array([[0, 0, 1], [1, 0, 1], [1, 0, 2], [0, 0, 2]], float)
    many = np.array([window + [0, i, 0] for i in range(openings.MOST + 1)])
    of_two = openings.Openings._of_rooms((many, window[None]), mi.UInt32([0, 1, 2]))
    assert len(of_two.quads) == 1
    assert of_two.are_elsewhere(mi.UInt32([0, 1, 2])).numpy().tolist() == [True, True, False]


def test_points_under_the_sky_are_not_in_a_room():
    world = load(two_rooms())
    points = np.array([[2, 2, 1], [2, 6, 1], [2, -2, 1], [2, 2, 9], [2, -1e-3, 1.5]])
    assert in_rooms(world, points).tolist() == [True, True, False, False, False]
    assert in_rooms(load(two_rooms(), effects=EnabledEffects(enclosed=False)), points) is None


def test_panes_in_one_plane_share_a_rectangle_for_each_side():
    window = np.array([[0, 0, 1], [1, 0, 1], [1, 0, 2], [0, 0, 2]], float)
    exits = exits_of(np.array([window, window + [3, 0, 1], window[::-1] + [6, 0, 0]]))
    assert exits.shape == (2, 4, 3)
    for rectangle in exits:
        low, high = rectangle.min(axis=0), rectangle.max(axis=0)
        np.testing.assert_allclose(low, [-MARGIN, 0, 1 - MARGIN], atol=1e-12)
        np.testing.assert_allclose(high, [7 + MARGIN, 0, 3 + MARGIN], atol=1e-12)


def test_glass_in_too_many_planes_has_no_common_exits():
    window = np.array([[0, 0, 1], [1, 0, 1], [1, 0, 2], [0, 0, 2]], float)
    many = np.array([window + [0, i, 0] for i in range(MOST + 1)])
    assert exits_of(many) is None
    assert len(exits_of(many[:-1])) == 2 * MOST
    assert exits_of(np.zeros((0, 4, 3))).shape == (0, 4, 3)


def test_the_light_on_cells_keeps_none_of_its_parts(monkeypatch):
    """A pending sum kept straight and scattered light of every replicate: twice the memory."""
    states, last = [], coefficients.Replicates.interreflected

    def watched(self, met, sensors):
        states.extend(part.array.state for part in self.cells)
        return last(self, met, sensors)

    monkeypatch.setattr(coefficients.Replicates, "interreflected", watched)
    case = attic()
    compute(load(case), *sensor_points(case), YEAR, case.accuracy)
    assert len(states) >= 2
    assert set(states) == {dr.VarState.Evaluated}
