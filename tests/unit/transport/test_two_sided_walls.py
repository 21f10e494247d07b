"""A wall between two rooms reflects to each as if that stood alone, and lets nothing through."""

import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian, two_sided
from drcmitsuba.runtime import backend
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.materials import albedo, bsdf
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests.model_rooms import GLASS, case_of, layer, prism

WHITE, BLACK = Lambertian(0.9), Lambertian(0.1)
NONE = Suns((), np.zeros((0, 3)), 0.53)
TABLES = {
    "sensors": {"floors": ["floor"], "spacing": 1.0, "margin": 0.5},
    "accuracy": {"replicates": 6, "paths": 1024, "cell_size": 0.3},
}


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def room(*surfaces, floor):
    """Room of 4 m by 5 m by 3 m with a southern window; its eastern wall is one of the surfaces."""
    _, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    window = np.array([[0.5, 0, 0.9], [3.5, 0, 0.9], [3.5, 0, 2.5], [0.5, 0, 2.5]])
    return (
        layer("floor", Lambertian(0.2), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("walls", Lambertian(0.5), walls[0], walls[2], walls[3], holes=[window]),
        layer("glass", GLASS, window[::-1]),
        *surfaces,
    )


FLOOR = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)[0]
EAST = [[4, 5, 0], [4, 0, 0], [4, 0, 3], [4, 5, 3]]
"""Eastern wall; its front faces the room."""
BEYOND = prism([(4, 0), (6, 0), (6, 5), (4, 5)], 3.0)


def light(*layers):
    """Sum of C over the sky and the mean over the sensors [sr], and its standard error."""
    case = case_of(*layers, **TABLES)
    C = compute(load(case), *sensor_points(case), NONE, case.accuracy)["replicates"].values
    each = C[..., 1:].sum(axis=-1).mean(axis=-1)
    return each.mean(), each.std(ddof=1) / np.sqrt(len(each))


@pytest.mark.parametrize("mine", [WHITE, BLACK])
def test_a_room_has_the_light_that_it_has_alone(mine):
    other = BLACK if mine is WHITE else WHITE
    alone, error = light(*room(layer("east", mine, EAST), floor=FLOOR))
    shared = layer("east", two_sided(mine, other), EAST)
    dark = layer("beyond", Lambertian(0.5), *BEYOND[:2], *BEYOND[2][:3])
    beside, other_error = light(*room(shared, floor=FLOOR), dark)
    assert abs(beside - alone) < 3 * np.hypot(error, other_error)
    assert error < 0.01 * alone


def test_black_and_white_walls_differ_by_more_than_the_errors_above():
    (white, first), (black, second) = (
        light(*room(layer("east", own, EAST), floor=FLOOR)) for own in (WHITE, BLACK)
    )
    assert white - black > 10 * np.hypot(first, second)


def test_each_side_has_its_own_reflectance():
    import mitsuba as mi

    made = mi.load_dict(bsdf(two_sided(WHITE, BLACK)))
    si = mi.SurfaceInteraction3f()
    for z, rho in ((1.0, 0.9), (-1.0, 0.1)):
        si.wi = mi.Vector3f(0, 0, z)
        value = made.eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, z))[0]
        assert value[0] == pytest.approx(rho / np.pi)
        value = made.eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, -z))[0]
        assert value[0] == 0
    assert albedo(two_sided(BLACK, WHITE)) == 0.9
    assert two_sided(WHITE, WHITE) == WHITE


def test_no_light_leaks_between():
    """A room without a window stays dark beside a lit one."""
    shared = layer("east", two_sided(WHITE, BLACK), EAST)
    closed = layer("beyond", Lambertian(0.5), BEYOND[1], *BEYOND[2][:3])
    floor = layer("dark floor", Lambertian(0.5), BEYOND[0])
    case = case_of(
        *room(shared, floor=FLOOR), closed, floor,
        **{**TABLES, "sensors": {"floors": ["dark floor"], "spacing": 1.0, "margin": 0.2}},
    )  # fmt: skip
    world = load(case, effects=EnabledEffects())
    C = compute(world, *sensor_points(case), NONE, case.accuracy)["replicates"].values
    assert C.max() == 0
