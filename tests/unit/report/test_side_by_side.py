"""Plans of several façades side by side, in the same colours."""

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.text import Text

from drcmitsuba.report.side_by_side import MOST, FacadeOfPicture, side_by_side
from tests.unit.report.test_figures import case_of, year_of


def shares(name, factor=1.0):
    case = case_of()
    E, numbers = year_of(case)
    E["total"] = factor * E["total"]
    return FacadeOfPicture.of(name, case, E, numbers)


def meshes(figure):
    return [m for ax in figure.axes for m in ax.findobj(QuadMesh) if m.get_array().size == 60]


def test_every_facade_has_both_plans_with_its_name_and_numbers():
    one, half = shares("clear"), shares("film", 0.4)
    (figure,) = side_by_side([one, half]).values()
    words = [text.get_text() for text in figure.findobj(Text)]
    assert {"2 façades", "clear", "film", "sDA 60 %", "ASE 30 %"} <= set(words)
    enough, in_sun, less, as_much_sun = [m.get_array().ravel() for m in meshes(figure)]
    near = one.enough.values.reshape(10, 6)  # rows from the glazing on
    np.testing.assert_allclose(np.sort(enough), np.sort(near.ravel()))
    assert less.max() == 0  # 240 lx are too little
    np.testing.assert_array_equal(in_sun, as_much_sun)
    assert in_sun.max() == 320


def test_scales_are_those_of_all_facades():
    every = [shares("a"), shares("b", 0.4)]
    (figure,) = side_by_side(every).values()
    limits = {(m.norm.vmin, m.norm.vmax) for m in meshes(figure)}
    highest = max(float(each.in_sun.max()) for each in every)
    assert limits == {(0, 100), (0, highest)}


def test_many_facades_fill_several_pictures():
    one = shares("a")
    drawn = side_by_side([one] * (MOST + 1))
    assert list(drawn) == ["variants_1.png", "variants_2.png"]
    assert [len(meshes(figure)) for figure in drawn.values()] == [2 * MOST, 2]


@pytest.mark.parametrize("count", [1, 5])
def test_plans_do_not_overlap(count):
    (figure,) = side_by_side([shares("a")] * count).values()
    boxes = [ax.get_position() for ax in figure.axes]
    for i, box in enumerate(boxes):
        assert 0 <= box.x0 < box.x1 <= 1
        assert 0 <= box.y0 < box.y1 <= 1
        for other in boxes[:i]:
            apart = box.x1 <= other.x0 or other.x1 <= box.x0
            assert apart or box.y1 <= other.y0 or other.y1 <= box.y0
