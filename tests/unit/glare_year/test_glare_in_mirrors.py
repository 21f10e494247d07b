"""Images of the sun in flat mirrors, from the law of reflection."""

import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.glare_year.chains import Chains
from drcmitsuba.glare_year.pixels import rays
from drcmitsuba.glare_year.suns import images
from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build

SUN = np.array([np.sin(0.3) * np.cos(0.7), np.cos(0.3) * np.cos(0.7), np.sin(0.7)])
DIAMETER = 0.53


def seen_in(*mirrors, specular=1.0):
    backend.select()
    material = MirrorMaterial(type="mirror", reflectance=0.8, specular=specular)
    scene = build([Surface("mirrors", material, np.array(mirrors), "mirrors")])
    chains, place = Chains(scene), np.array([0.0, 0.0, 1.0])
    sent = rays(np.array([[0, 1.0, 0], [0, -1.0, 0]])).directions
    outside, _, _ = chains.ends(np.broadcast_to(place, sent.shape), sent)
    return images(chains, place, outside, sent, SUN[None], DIAMETER, 1)


FLOOR = quad([-50, -50, 0], [100, 0, 0], [0, 100, 0])
WALL = quad([-50, -2, 0], [100, 0, 0], [0, 0, 50])


def test_a_mirror_on_the_floor_shows_the_sun_below_the_horizon():
    found = seen_in(FLOOR, specular=0.9)
    assert len(found.sun) == 2
    np.testing.assert_allclose(found.direction[0], SUN, atol=1e-6)
    np.testing.assert_allclose(found.direction[1], SUN * [1, 1, -1], atol=1e-6)
    np.testing.assert_allclose(found.solid_angle, disk_solid_angle(DIAMETER), rtol=1e-6)
    np.testing.assert_allclose(found.transmittance, [1, 0.9 * 0.8], rtol=1e-4)


def test_two_mirrors_show_it_three_times():
    found = seen_in(FLOOR, WALL)
    assert len(found.sun) == 4
    expected = {(1, 1, 1): 1, (1, 1, -1): 0.8, (1, -1, 1): 0.8, (1, -1, -1): 0.64}
    for direction, share in zip(found.direction, found.transmittance, strict=True):
        signs = tuple(int(s) for s in np.sign(direction / SUN))
        assert expected.pop(signs) == pytest.approx(share, rel=1e-3)
        np.testing.assert_allclose(np.abs(direction), SUN, atol=1e-5)
    assert not expected
