"""Cells end where furniture stands, and no light crosses a thin screen within a cell."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import DiffuserMaterial, Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import heading, origin, turn
from drcmitsuba.scene.geometry import rotation as rotation_of
from drcmitsuba.scene.surfaces import bounds_of_rooms
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.cells.cells import CellGrid, Cells
from drcmitsuba.transport.cells.lines import STEPS, cuts, planes, standing
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.coefficients import compute
from tests.model_rooms import GLASS, case_of, layer, prism


def cells_of(cut, size):
    """Ends of the cells [m]."""
    return cut.ends * size


def test_cuts_lie_in_plates_and_at_sheets_and_cells_between_them_are_no_larger():
    plane = np.array([[2.0, 1.0], [2.04, 1.0], [4.4, 0.5]])
    cut = cuts(plane, 0.0, 12, 0.5)
    ends = cells_of(cut, 0.5)
    first, second, third = 2.02 * np.arange(1, 5), 2.38 * np.arange(1, 6), 1.6 * np.arange(1, 5)
    expected = np.concatenate([first / 4, 2.02 + second / 5, 4.4 + third / 4])
    assert ends == pytest.approx(expected, abs=1e-6)
    assert cut.cells == len(ends)
    begins = np.arange(12 * STEPS) * 0.5 / STEPS
    assert (cut.of_step == (begins[:, None] >= ends - 1e-9).sum(axis=1)).all()


def test_the_largest_of_planes_that_are_near_to_each_other_is_cut():
    plane = np.array([[2.0, 1.0], [2.11, 3.0]])  # further apart than a plate is thick
    ends = cells_of(cuts(plane, 0.0, 8, 0.5), 0.5)
    assert ends[:5] == pytest.approx(2.11 * np.arange(1, 6) / 5)


def test_a_cut_lies_exactly_at_a_bound_whatever_stands_beside_it():
    plane, bound = np.array([[2.04, 1.0], [2.08, 9.0]]), np.array([[2.0, 12.0]])
    ends = cells_of(cuts(plane, 0.0, 8, 0.5, 12.0, bound), 0.5)
    assert 2.0 in ends.round(6).tolist()
    assert not ((ends > 2.001) & (ends < 2.2)).any()


def test_axes_without_planes_and_scenes_of_many_cells_stay_regular():
    assert cuts(np.zeros((0, 2)), 0.0, 10, 0.5) is None
    assert cuts(np.array([[2.0, 1.0]]), 0.0, 10_000, 0.5) is None


def test_only_what_stands_apart_from_the_bounds_counts():
    def upright(x):
        return np.array([[x, 1, 0], [x, 2, 0], [x, 2, 1], [x, 1, 1]], float)

    quads = np.stack([upright(0.0), upright(1.5), upright(4.0), upright(5.0)])
    inside = standing(quads, np.zeros(3), np.array([4.0, 3.0, 2.5]))
    assert len(inside) == 1
    x, y, z = planes(inside)
    assert x == pytest.approx(np.array([[1.5, 1.0]]))
    assert not len(y)
    assert not len(z)


def balcony(corner, size, rotation=0.0):
    """A room with a body before its open southern side."""
    return Case.model_validate({
        "room": {"size": [4.0, 4.0, 2.8], "rotation": rotation},
        "facade": {"south": {"strips": [{"bottom": 0.3, "top": 2.7, "material": "open"}]}},
        "furniture": [{"corner": corner, "size": size}],
        "sensors": {"points": [[2, 2, 1]]},
    })  # fmt: skip


SOFFIT = ([0.0, -0.9, 2.8], [4.0, 0.9, 0.1])


def model_of_balcony(corner, size, rotation=0.0):
    """The same room as a model, the body in its surroundings."""
    low, high, walls = prism([(0, 0), (4, 0), (4, 4), (0, 4)], 2.8)
    (x, y, z), (dx, dy, dz) = corner, size
    under, top, sides = prism([(x, y), (x + dx, y), (x + dx, y + dy), (x, y + dy)], dz)
    body = [np.add(face[::-1], [0, 0, z]) for face in map(np.array, (under, top, *sides))]
    return case_of(
        layer("floor", Lambertian(0.3), low),
        layer("ceiling", Lambertian(0.8), high),
        layer("walls", Lambertian(0.5), *walls[1:]),
        layer("glass", GLASS, walls[0]),
        layer("body", Lambertian(0.4), *body, role="context"),
        north=-rotation,
        sensors={"points": [[2, 2, 1]]},
    )


@pytest.mark.parametrize("drawn", [balcony, model_of_balcony])
@pytest.mark.parametrize("rotation", [0, 30])
@pytest.mark.parametrize(
    ("corner", "size", "z", "n"),
    [(*SOFFIT, 2.8, -1), ([0.0, -0.9, -0.1], [4.0, 0.9, 0.1], 0.0, 1)],
    ids=["soffit", "floor"],
)
def test_no_cell_lies_within_a_room_and_outside(drawn, rotation, corner, size, z, n):
    backend.select()
    case = drawn(corner, size, rotation)
    grid = CellGrid.of(scene.load(case), 0.45)
    at = (np.array([[2, -0.01, z], [2, 0.01, z]]) - origin(case)) @ rotation_of(case).T
    key, one = grid.key(mi.Point3f(at.T), mi.Normal3f([0, 0, n])), dr.ones(mi.Float, 2)
    assert len(np.unique(key.numpy())) == 2
    none, place = dr.zeros(mi.UInt32, 2), flat(at)
    cells = Cells.none(grid).extended(Vertices(none, one, key, none, place, place))
    assert cells.flat_blocks(9)[1] == 2


def test_cells_stay_where_nothing_outside_adjoins_the_room():
    backend.select()
    near, far, none = (
        CellGrid.of(scene.load(balcony(corner, size)), 0.45).cuts
        for corner, size in (SOFFIT, ([0, -9, 0], [4, 1, 5]), ([1, 1, 1], [1, 1, 1e-3]))
    )
    assert near[1] is not None
    assert near[0] is None
    assert far == (None, None, None)
    assert none[1] is not None  # furniture


def screened(thickness, turned, rotation=0.0):
    """A room of two halves that a screen to the ceiling parts; the sensors are in the dark half."""
    screen = {"corner": [2.33, 0.0, 0.0], "size": [thickness, 4.0, 2.8], "reflectance": 0.5}
    side = "south" if turned else "west"
    if turned:
        screen = {"corner": [0.0, 2.33, 0.0], "size": [4.0, thickness, 2.8], "reflectance": 0.5}
    return Case.model_validate(
        {
            "room": {
                "size": [4.0, 4.0, 2.8],
                "floor": 0.5,
                "walls": 0.5,
                "ceiling": 0.5,
                "rotation": rotation,
            },
            "facade": {side: {"strips": [{"bottom": 0.8, "top": 2.4, "material": "glass"}]}},
            "materials": {"glass": {"type": "glazing", "transmittance": 0.7}},
            "furniture": [screen],
            "sensors": {"corner": [2.5, 2.5, 0.8], "count": [3, 3], "spacing": 0.4},
        }
    )


def parted(north, askew, screen_of):
    """A model of two rooms on one floor, drawn `askew` in plan [deg], the eastern one dark."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 4), (0, 4)], 2.8)
    window = [[0, 1, 0.8], [0, 1, 2.4], [0, 3, 2.4], [0, 3, 0.8]]
    screen = [[2.33, 0, 0], [2.33, 4, 0], [2.33, 4, 2.8], [2.33, 0, 2.8]]
    turned = turn(askew).T

    def drawn(*polygons):
        return [np.array(polygon, float) @ turned for polygon in polygons]

    return case_of(
        layer("floor", Lambertian(0.5), *drawn(floor)),
        layer("ceiling", Lambertian(0.5), *drawn(ceiling)),
        layer("walls", Lambertian(0.5), *drawn(walls[3]), holes=drawn(window)),
        layer("others", Lambertian(0.5), *drawn(*walls[:3])),
        layer("screen", screen_of, *drawn(screen)),
        layer("glass", GLASS, *drawn(window)),
        north=north,
        sensors={"floors": ["floor"], "spacing": 1.0},
    )


ACROSS = np.array([1.0, 2.0, 2.6, 3.2])
POINTS = np.array([[x, y, z] for x in ACROSS for y in (2.6, 3.4) for z in (0.1, 1.4)])
"""Points before a screen, and behind it, where it is dark [m]."""


def light_of_halves(case, points):
    """Light of points of the case on both sides of a screen, (side, replicate, point) [sr]."""
    backend.select()
    world = scene.load(case, effects=EnabledEffects(solved_cells=True, beyond=False))
    points = (points - origin(case)) @ rotation_of(case).T
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    C = compute(world, points, normals, Suns.none(), Accuracy(paths=64, replicates=2))
    return C["replicates"].sum("bin").values.reshape(2, 2, -1).swapaxes(0, 1)


@pytest.mark.parametrize("thickness", [0.001, 0.04])
@pytest.mark.parametrize(("turned", "rotation"), [(False, 0), (True, 0), (False, 30), (True, -50)])
def test_no_light_crosses_a_screen_within_a_cell(thickness, turned, rotation):
    points = POINTS[:, [1, 0, 2]] if turned else POINTS
    bright, dark = light_of_halves(screened(thickness, turned, rotation), points)
    assert (dark == 0).all()
    assert (bright > 0.1).all()


@pytest.mark.parametrize(
    ("north", "askew", "screen"),
    [
        (0, 0, Lambertian(0.5)),
        (35, 0, Lambertian(0.5)),
        (0, 20, Lambertian(0.5)),
        (20, -20, Lambertian(0.5)),
        (35, 0, GLASS.model_copy(update={"transmittance": 0.0})),
        (0, 0, DiffuserMaterial(type="diffuser", transmittance=0.0, reflectance=0.5)),
    ],
)
def test_cells_lie_along_the_walls_and_panes_of_a_model(north, askew, screen):
    case = parted(north, askew, screen)
    assert heading(case) == pytest.approx(askew - north)
    assert np.ptp(bounds_of_rooms(case), axis=0) == pytest.approx([4.0, 4.0, 2.8])
    bright, dark = light_of_halves(case, POINTS @ turn(askew).T)
    assert (dark == 0).all()
    assert (bright > 0.08).all()
