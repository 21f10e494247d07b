"""Polygons as parallelograms and triangles: areas, fronts and refusals are exact."""

import numpy as np
import pytest

from drcmitsuba.model.polygon import area_vector, quads_of

SQUARE = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], float)
HOLE = np.array([[0.5, 0.5, 0], [1.5, 0.5, 0], [1.5, 1.5, 0], [0.5, 1.5, 0]])
L_SHAPE = np.array([[0, 0, 0], [3, 0, 0], [3, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]], float)
SAME_WAY = np.concatenate([SQUARE, SQUARE[:1], HOLE, HOLE[:1]])
SEAM = np.concatenate([SQUARE, SQUARE[:1], HOLE[[0, 3, 2, 1]], HOLE[:1]])


def turned(corners):
    """Corners in a plane of any direction."""
    axis, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    axis *= np.sign(np.linalg.det(axis))
    return corners @ axis.T + [7, -5, 11], axis[:, 2]


def vector(quads):
    """Sum of normal times area of quads whose triangles repeat their last corner."""
    return sum(area_vector(quad) for quad in quads)


@pytest.mark.parametrize(
    ("corners", "holes", "area", "most"),
    [
        (SQUARE, (), 4, 1),
        (SQUARE[:3], (), 2, 1),
        (L_SHAPE, (), 4, 4),
        (SQUARE, (HOLE,), 3, 8),
        (SQUARE, (HOLE[::-1],), 3, 8),
        (SEAM, (), 3, 8),
        (SAME_WAY, (), 3, 8),  # by an odd number of crossings, as Radiance counts
    ],
)
def test_area_and_front_are_those_of_the_polygon(corners, holes, area, most):
    at, normal = turned(corners)
    quads = quads_of(at, [turned(hole)[0] for hole in holes])
    assert len(quads) <= most
    np.testing.assert_allclose(vector(quads), area * normal, atol=1e-9)
    for quad in quads:
        assert area_vector(quad) @ normal > 0


def test_corners_that_repeat_do_not_count():
    assert len(quads_of(SQUARE[[0, 0, 1, 2, 3, 3]])) == 1


@pytest.mark.parametrize(
    ("corners", "complaint"),
    [
        (SQUARE[:2], "fewer than three"),
        (SQUARE[[0, 1, 0, 1]], "no area"),
        (SQUARE + [[0, 0, 0], [0, 0, 0], [0, 0, 0.4], [0, 0, 0]], "not planar"),
        (SQUARE[[0, 1, 3, 2]] * [[1, 1, 1], [1, 1, 1], [1, 1, 1], [3, 1, 1]], "crosses itself"),
        (np.full((3, 3), np.nan), "fewer than three"),
    ],
)
def test_what_is_no_polygon_is_refused(corners, complaint):
    with pytest.raises(ValueError, match=complaint):
        quads_of(corners)
