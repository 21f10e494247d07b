"""Light that the outside of clear panes mirrors, against Fresnel's formulas."""

import numpy as np
import pytest

from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build
from drcmitsuba.transport.outside_glass import OutsideGlass
from tests.radiance import glass

TAU = 0.9
PANE = GlazingMaterial(type="glazing", transmittance=TAU, ior=1.52)
NORTH, UP, EAST = np.eye(3)[[1, 2, 0]]
SOUTH_GLASS = quad(-100 * EAST - 100 * UP, 200 * UP, 200 * EAST)
"""A large pane at y = 0 whose front, the room's side, faces north."""
POINT = np.array([[0.0, -0.5, 0.0]])
DIAMETER = 0.5


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def glass_of(*more, material=PANE):
    made = build([Surface("pane", material, SOUTH_GLASS[None]), *more])
    return OutsideGlass.of(made)


def by_suns(outside, point, normal, suns):
    D = outside.suns(
        flat(point), flat(np.array([normal])), suns=suns, diameter=DIAMETER, samples=64, seed=0
    )
    return D.numpy()[0]


SUNS = np.array([[0.3, -0.7, 0.5], [0.6, -0.2, 0.9], [0.0, 0.8, 0.6], [-0.9, -0.1, 0.2]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)


def test_mirrored_suns_have_fresnels_reflectance():
    d = 2 * np.pi * (1 - np.cos(np.radians(DIAMETER / 2)))
    t = radiance_transmissivity(TAU)
    rho = np.where(SUNS[:, 1] < 0, glass(-SUNS[:, 1], t)[1], 0)
    # The mirrored suns stand north of the point, as high as the suns.
    for normal, cosine in ((NORTH, -SUNS[:, 1]), (UP, SUNS[:, 2])):
        np.testing.assert_allclose(
            by_suns(glass_of(), POINT, normal, SUNS), d * rho * cosine, rtol=5e-3, atol=1e-9
        )


def radiance_transmissivity(tau):
    """Share of light left after one pass of a pane of transmittance tau, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if glass(np.ones(1), middle)[0][0] < tau else (low, middle)
    return low


def test_the_mirrored_sky_is_that_of_its_reflectance():
    D = (
        glass_of()
        .sky(flat(POINT), flat(NORTH[None]), subdivision=1, rays=1 << 16, seed=0)
        .numpy()[0]
    )
    c = (np.arange(4000) + 0.5) / 4000
    rho = glass(c, radiance_transmissivity(TAU))[1]
    assert D.sum() == pytest.approx(2 * np.pi * (rho * c).mean(), rel=2e-3)
    assert D[0] == pytest.approx(D[1:].sum(), rel=0.02)  # ground and sky share the view


def test_what_stands_before_the_pane_or_the_source_hides_it():
    screen = Surface(
        "screen", Lambertian(0.5), quad(-9 * EAST - 0.2 * NORTH, 9 * UP, 18 * EAST)[None]
    )
    wall = Surface("wall", Lambertian(0.5), quad(-9 * EAST - 5 * NORTH, 9 * UP, 18 * EAST)[None])
    for shape in (screen, wall):
        D = by_suns(glass_of(shape), POINT, NORTH, SUNS[:1])
        assert (D == 0).all()


def test_points_behind_the_pane_and_panes_without_an_index_mirror_nothing():
    inside = POINT * [1, -1, 1]
    assert (by_suns(glass_of(), inside, -NORTH, SUNS) == 0).all()
    plain = GlazingMaterial(type="glazing", transmittance=0.6, reflectance=0.2)
    assert glass_of(material=plain) is None
