"""Images of the sun in flat mirrors, from the law of reflection; lamellae against photons."""

import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.annual.run import Run
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.pixels import rays
from drcmitsuba.glare_year.seen_ends import eye_paths, seen_ends
from drcmitsuba.glare_year.state import at_eyes, places
from drcmitsuba.glare_year.suns import images, shows_by_chance
from drcmitsuba.model.materials import GlazingMaterial, Lambertian, MirrorMaterial
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build
from drcmitsuba.sky.daylight import daylight
from tests import ROOT
from tests.unit.glare_year.glare_room import by_suns, case_in, sum_over

SUN = np.array([np.sin(0.3) * np.cos(0.7), np.cos(0.3) * np.cos(0.7), np.sin(0.7)])
DIAMETER = 0.53


def seen_in(*mirrors, **changes):
    backend.select()
    material = MirrorMaterial(type="mirror", reflectance=0.8, **changes)
    scene = build([Surface("mirrors", material, np.array(mirrors), "mirrors")])
    paths, place = eye_paths(scene, DIAMETER), np.array([0.0, 0.0, 1.0])
    sent = rays(np.array([[0, 1.0, 0], [0, -1.0, 0]]))
    outside = seen_ends(paths, place, sent.directions, seed=1).outside
    tiles = np.unique(sent.tile[outside.ray[shows_by_chance(outside)]])
    return images(paths, place, tiles, SUN[None], DIAMETER, 1)


FLOOR = quad([0, -2, 0], [0.8, 0, 0], [0, 4, 0])
WALL = quad([0, -2, 0], [1.2, 0, 0], [0, 0, 4])


def together(found):
    """Images by the signs of their direction: mean direction, solid angle, transmittance."""
    signs = np.sign(found.direction / SUN).astype(int)
    out = {}
    for key in {tuple(row) for row in signs.tolist()}:
        mine = (signs == key).all(axis=1)
        weight = found.solid_angle[mine]
        direction = weight @ found.direction[mine] / weight.sum()
        out[key] = direction, weight.sum(), weight @ found.transmittance[mine] / weight.sum()
    return out


def test_a_mirror_on_the_floor_shows_the_sun_below_the_horizon():
    found = together(seen_in(FLOOR, specular=0.9))
    assert set(found) == {(1, 1, 1), (1, 1, -1)}
    omega = disk_solid_angle(DIAMETER)
    direction, solid_angle, share = found[1, 1, 1]
    np.testing.assert_allclose(direction, SUN, atol=1e-6)
    assert solid_angle == pytest.approx(omega, rel=1e-6)
    assert share == pytest.approx(1, rel=1e-6)
    direction, solid_angle, share = found[1, 1, -1]
    np.testing.assert_allclose(direction, SUN * [1, 1, -1], atol=5e-4)
    assert solid_angle == pytest.approx(omega, rel=0.1)  # fifty rays
    assert share == pytest.approx(0.9 * 0.8, rel=1e-4)


def test_a_polished_floor_shows_it_with_the_share_of_its_angle():
    _, _, share = together(seen_in(FLOOR, specular=0.1, polished=True))[1, 1, -1]
    more = np.exp(-5.85 * SUN[2]) - np.exp(-5.85)
    assert share == pytest.approx(0.08 + 0.92 * more, rel=0.01)


def test_a_polished_floor_is_matt_where_it_mirrors_nothing():
    backend.select()
    floor = MirrorMaterial(type="mirror", reflectance=0.5, specular=0.1, polished=True)
    scene = build([Surface("floor", floor, np.array([quad([-9, -9, 0], [18, 0, 0], [0, 18, 0])]))])
    cosine = np.array([1.0, 0.5, 0.2])
    down = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, -cosine], axis=1)
    seen = seen_ends(eye_paths(scene, DIAMETER), np.array([0, 0, 1.0]), down, seed=1)
    more = np.exp(-5.85 * cosine) - np.exp(-5.85)
    np.testing.assert_allclose(seen.outside.weight, 0.05 + 0.95 * more, rtol=1e-5)
    np.testing.assert_allclose(seen.surfaces.weight[:, 0], 0.45 * (1 - more), rtol=1e-5)


def test_two_mirrors_show_it_three_times():
    found = together(seen_in(FLOOR, WALL))
    expected = {(1, 1, 1): 1, (1, 1, -1): 0.8, (1, -1, 1): 0.8, (1, -1, -1): 0.64}
    assert set(found) == set(expected)
    for signs, (direction, solid_angle, share) in found.items():
        assert share == pytest.approx(expected[signs], rel=1e-3)
        assert solid_angle == pytest.approx(disk_solid_angle(DIAMETER), rel=0.1)
        np.testing.assert_allclose(direction, SUN * signs, atol=5e-4)


LAMELLAE = f"""
[components.lamellae]
type = "structure"
recipe = "{ROOT / "scenes" / "lamella" / "recipe.toml"}"
tilt = 30
"""


@pytest.mark.slow
def test_lamellae_are_seen_as_bright_as_they_light_the_eye(tmp_path):
    case = case_in(tmp_path, material="lamellae", more=LAMELLAE)
    backend.select()
    light, looking = daylight(case), eyes(case)
    run = Run.of(case, plan(case, light).scope)
    E = at_eyes(case, "open", light, looking, run)
    (place,) = places(case, "open", light, looking, run)
    known = place.known
    assert (known.seen.images.transmittance < 0.95).any()
    L = known.at(np.arange(E.shape[1]))
    for view, forward in enumerate(looking.forward):
        by_rays = sum_over(known.seen, L, forward) + by_suns(known, forward)
        of_view = E[:, :, view].mean(axis=0)
        error = E[:, :, view].std(axis=0, ddof=1) / 2
        assert abs(by_rays.sum() - of_view.sum()) < 0.03 * of_view.sum() + 4 * np.hypot.reduce(
            error
        )


def test_a_pane_shows_the_sun_with_its_reflectance_and_only_within_its_outline():
    """The image of a sun in glass before a black wall, whole and where an edge halves it."""
    backend.select()
    pane = GlazingMaterial(type="glazing", transmittance=0.8, ior=1.52)
    sun = np.array([0.0, -0.8, 0.6])
    rises = 1 + 0.6 / 0.8 * 5  # height at which the eye sees the middle of the image
    for low, share in ((-9.0, 1.0), (rises, 0.5)):
        glass = quad([-9, 5, low], [0, 0, 30], [18, 0, 0])  # its back faces the eye
        behind = quad([-30, 5.01, -30], [60, 0, 0], [0, 0, 90])
        scene = build(
            [
                Surface("glass", pane, np.array([glass])),
                Surface("wall", Lambertian(0.0), np.array([behind])),
            ]
        )
        found = images(
            eye_paths(scene, DIAMETER), np.array([0.0, 0.0, 1.0]), np.zeros(0, int), sun[None],
            DIAMETER, 1,
        )  # fmt: skip
        mirrored = found.direction[:, 1] > 0
        assert mirrored.sum() == 1
        np.testing.assert_allclose(found.direction[mirrored][0], sun * [1, -1, 1], atol=1e-6)
        omega = share * disk_solid_angle(DIAMETER)
        assert found.solid_angle[mirrored][0] == pytest.approx(omega, rel=0.03)
        rho = np.interp(0.8, np.linspace(0, 1, 1025), pane.tables(1025)[1])
        assert found.transmittance[mirrored][0] == pytest.approx(rho, rel=0.01)
