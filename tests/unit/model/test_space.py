"""Spaces: floors, volumes, names, and the one in which a point lies."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from drcmitsuba.model.space import (
    Space,
    SpaceFloor,
    floors_of,
    numbered,
    overlap_notes,
    space_at,
    volume_of,
)
from tests.model_rooms import prism


def room(name, x, y, z=0.0, height=3.0, size=4.0, **fields):
    floor = SpaceFloor(z, shapely.box(x, y, x + size, y + size))
    return Space(name, (floor,), z + height, **fields)


def test_a_prism_has_its_volume_and_floor():
    outline = [(0, 0), (6, 0), (6, 3), (3, 3), (3, 7), (0, 7)]
    low, high, walls = prism(outline, 3.0)
    faces = [[np.array(ring, float)[::-1]] for ring in (low, high, *walls)]  # fronts outward
    assert volume_of(faces) == pytest.approx(3 * 30)
    [floor] = floors_of([[np.array(low, float)]])
    assert floor.outline.area == pytest.approx(30)


def test_a_hole_counts_in_area_and_volume():
    def ring(a, b, z):
        return np.array([[a, a, z], [b, a, z], [b, b, z], [a, b, z]], float)

    faces = [[ring(0, 9, 3.0), ring(3, 6, 3.0)], [ring(0, 9, 0.0)[::-1], ring(3, 6, 0.0)]]
    for (a, b), outside in (((0, 9), True), ((3, 6), False)):
        _, _, walls = prism([(a, a), (b, a), (b, b), (a, b)], 3.0)
        faces += [[np.array(wall, float)[:: -1 if outside else 1]] for wall in walls]
    assert volume_of(faces) == pytest.approx(3 * 72)
    assert floors_of(faces[1:2])[0].outline.area == pytest.approx(72)


def test_a_gallery_is_a_floor_of_its_own():
    rings = [
        np.array([[0, 0, z], [w, 0, z], [w, 4, z], [0, 4, z]], float) for z, w in ((0, 6), (3, 2))
    ]
    space = Space("hall", floors_of([[ring] for ring in rings]), 6.0)
    assert [floor.height for floor in space.floors] == [0, 3]
    assert space.floor_area == pytest.approx(24 + 8)


def test_equal_names_are_told_apart():
    rooms = [
        room("Office", 0, 0, storey="L1"), room("Office", 5, 0, storey="L2"), room("Hall", 9, 0),
        room("Office", 9, 9, storey="L2"), room("WC", 0, 9), room("WC", 5, 9),
    ]  # fmt: skip
    names = [space.name for space in numbered(rooms)]
    assert names == ["Office (L1)", "Office (L2, 1)", "Hall", "Office (L2, 2)", "WC (1)", "WC (2)"]


def test_points_lie_in_the_space_of_the_highest_floor_below():
    spaces = (room("a", 0, 0), room("b", 4, 0), room("c", 0, 0, z=3.0, height=np.inf))
    points = [
        [1, 1, 0.8],
        [5, 1, 0.8],
        [1, 1, 3.8],
        [9, 9, 1],
        [1, 1, -1],
        [3.99, 1, 1],
        [4.01, 1, 1],
    ]
    at = space_at(spaces, np.array(points, float))
    np.testing.assert_array_equal(at, [0, 1, 2, -1, -1, 0, 1])
    assert space_at((), np.zeros((2, 3))).tolist() == [-1, -1]


@given(st.floats(0.001, 1000.0))
def test_lengths_scale(factor):
    space = room("a", 1, 2, z=0.5, volume=48.0).scaled(factor)
    assert space.floor_area == pytest.approx(16 * factor**2)
    assert space.volume == pytest.approx(48 * factor**3)
    assert space.height == pytest.approx(3 * factor)


def test_spaces_that_overlap_are_noted_with_the_place():
    one = Space("one", (SpaceFloor(0.0, shapely.box(0, 0, 4, 5)),), 3.0)
    beside = Space("beside", (SpaceFloor(0.0, shapely.box(4, 0, 8, 5)),), 3.0)
    across = Space("across", (SpaceFloor(0.1, shapely.box(6, 1, 9, 4)),), 3.0)
    above = Space("above", (SpaceFloor(3.0, shapely.box(0, 0, 8, 5)),), 6.0)
    assert overlap_notes([one, beside, above]) == ()
    (note,) = overlap_notes([one, beside, above, across])
    assert "beside and across at (7.00, 2.50)" in note
