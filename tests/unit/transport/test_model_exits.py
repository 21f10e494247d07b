"""Shadow rays that miss all exits of a model are spared: no coefficient changes."""

import drjit as dr
import numpy as np
import pytest

from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, Lambertian
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.exits import MARGIN, MOST, exits_of
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.rays.openings import in_rooms
from drcmitsuba.transport.rays.straight_suns import straight_suns
from tests.model_rooms import GLASS, case_of, l_room, layer, prism

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
        layer("partition", partition, between),
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

SLOW = ("two rooms behind a film that is seen through",)
"""The film's own rays, most of all, are not spared."""


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
    assert rays[0] < (0.98 if room in SLOW else 0.7) * rays[1]


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


def test_a_model_with_glass_in_too_many_planes_traces_all_rays():
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
