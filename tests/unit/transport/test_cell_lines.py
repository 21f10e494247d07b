"""Cells end where furniture stands, and no light crosses a thin screen within a cell."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.transport.cells.lines import STEPS, cuts, planes, standing


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


def screened(thickness, turned):
    """A room of two halves that a screen to the ceiling parts; the sensors are in the dark half."""
    screen = {"corner": [2.33, 0.0, 0.0], "size": [thickness, 4.0, 2.8], "reflectance": 0.5}
    side = "south" if turned else "west"
    if turned:
        screen = {"corner": [0.0, 2.33, 0.0], "size": [4.0, thickness, 2.8], "reflectance": 0.5}
    case = Case.model_validate(
        {
            "room": {"size": [4.0, 4.0, 2.8], "floor": 0.5, "walls": 0.5, "ceiling": 0.5},
            "facade": {side: {"strips": [{"bottom": 0.8, "top": 2.4, "material": "glass"}]}},
            "materials": {"glass": {"type": "glazing", "transmittance": 0.7}},
            "furniture": [screen],
            "sensors": {"corner": [2.5, 2.5, 0.8], "count": [3, 3], "spacing": 0.4},
        }
    )
    return scene.load(case, effects=EnabledEffects(solved_cells=True, beyond=False))


@pytest.mark.parametrize("thickness", [0.001, 0.04])
@pytest.mark.parametrize("turned", [False, True])
def test_no_light_crosses_a_screen_within_a_cell(thickness, turned):
    from drcmitsuba.sky.sun_models import Suns
    from drcmitsuba.transport.coefficients import compute

    backend.select()
    across = np.array([1.0, 2.0, 2.6, 3.2])
    points = np.array([[x, y, z] for x in across for y in (2.6, 3.4) for z in (0.1, 1.4)])
    points = points[:, [1, 0, 2]] if turned else points
    dark = points[:, 1 if turned else 0] > 2.4
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    accuracy = Accuracy(paths=64, replicates=2)
    C = compute(screened(thickness, turned), points, normals, Suns.none(), accuracy)
    E = C["replicates"].sum("bin").values
    assert (E[:, dark] == 0).all()
    assert (E[:, ~dark] > 0.1).all()
