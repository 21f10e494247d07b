"""Polygons, closed solids, and blocks of whole periods of a structure."""

import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.structures.block import block
from drcmitsuba.scene.structures.polygon import triangles
from drcmitsuba.scene.structures.solid import check_solid, volume, winding
from tests.unit.scene.component_cases import PRISM, recipe, surface_of


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


@pytest.mark.parametrize("seed", range(5))
def test_triangles_of_a_polygon_have_its_area_and_all_turn_the_same_way(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 40))
    radius = rng.uniform(0.2, 1, 40)  # star-shaped, with many corners that bend inward
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    faces = triangles(points)
    a, b, c = (points[faces[:, i]] for i in range(3))
    u, v = b - a, c - a
    areas = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    x, y = points.T
    whole = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    assert len(faces) == 38
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(whole, rel=1e-12)


def tetrahedron():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def test_a_solid_is_known_by_its_volume_and_what_it_surrounds():
    vertices, faces = tetrahedron()
    check_solid("file", vertices, faces)
    assert volume(vertices, faces) == pytest.approx(1 / 6)
    points = np.array([[0.2, 0.2, 0.2], [0.5, 0.5, 0.5], [-0.1, 0.2, 0.2]])
    np.testing.assert_allclose(winding(vertices, faces, points), [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f[:, ::-1], "normals point inward"),
        (lambda f: f[1:], "not closed: 3 open edges"),
        (lambda f: np.concatenate([f[:1, ::-1], f[1:]]), "disagree on which side is out"),
    ],
)
def test_what_is_no_solid_is_refused(change, message):
    vertices, faces = tetrahedron()
    with pytest.raises(InputError, match=message):
        check_solid("file", vertices, change(faces))


def test_a_block_of_prisms_is_a_closed_solid_of_whole_periods(tmp_path):
    made = block(recipe(tmp_path, PRISM), 0.7, 0.333)
    np.testing.assert_allclose(made.size, [0.7, 0.32, 0.014], atol=1e-6)
    vertices, faces = surface_of(made.quads)
    check_solid("block", vertices, faces)
    # the polygon's area, its arc's segment of 10° included, times all periods and the width
    chord, turn = np.hypot(10, 16), np.radians(10)
    radius = chord / 2 / np.sin(turn / 2)
    period = 4 * 20 + 20 * 10 / 2 + radius**2 * (turn - np.sin(turn)) / 2
    assert volume(vertices, faces) == pytest.approx(period * 1e-6 * 16 * 0.7, rel=1e-4)
    np.testing.assert_allclose(made.quads.min(axis=(0, 1))[:2], [-0.35, -0.16], atol=1e-9)
    assert made.quads[..., 2].max() == 0


def test_a_panel_cut_through_becomes_closed_pieces(tmp_path):
    text = """[structure]
kind = "slots"
n = 1.49
period = 20
thickness = 12
slot = 2
depth = 12
"""
    made = block(recipe(tmp_path, text), 0.5, 0.2)
    vertices, faces = surface_of(made.quads)
    check_solid("block", vertices, faces)
    assert volume(vertices, faces) == pytest.approx(10 * 0.018 * 0.012 * 0.5, rel=1e-6)
