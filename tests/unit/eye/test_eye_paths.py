"""Rays of an eye: all ways and drawn ones, energy that is kept, and ends that must not be lost."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.eye.ends import OnWay
from drcmitsuba.eye.paths import DRAWN, EyePaths
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
)
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build
from tests import ROOT
from tests.fast import slowly

EAST, NORTH, UP = np.eye(3)
EYE = np.array([0.0, 0.0, 1.0])
PRISM = ROOT / "scenes" / "films" / "prism.xml"
RAYS, REPLICATES = 1 << 14, 8


def wall(y, material, low=-3.0, high=5.0):
    """Wall to the north that faces the eye."""
    corners = quad(-4 * EAST + y * NORTH + low * UP, (high - low) * UP, 8 * EAST)
    return Surface("wall", material, corners[None])


def block(material, near=2.0, far=2.5):
    """Closed body before the eye, its fronts outward."""
    a, (x, y, z) = np.array([-1.0, near, 0]), np.diag([2.0, far - near, 2.0])
    b = a + x + y + z
    faces = [quad(a, x, z), quad(a, y, x), quad(a, z, y), quad(b, -z, -x), quad(b, -x, -y),
             quad(b, -y, -z)]  # fmt: skip
    return Surface("block", material, np.array(faces), "block", True)


def mirror(**more):
    return MirrorMaterial(**({"type": "mirror", "reflectance": 0.7} | more))


def glass(**more):
    return GlazingMaterial(**({"type": "glazing", "transmittance": 0.8, "ior": 1.52} | more))


def northward(rays=RAYS):
    """Directions to a field of 60°, even in its plane."""
    x, z = np.random.default_rng(1).uniform(-0.6, 0.6, (2, rays))
    d = np.stack([x, np.ones(rays), z])
    return mi.Vector3f(*(d / np.linalg.norm(d, axis=0)).astype(np.float32))


def ends(paths, seed=0, d=None, first=0):
    d = northward() if d is None else d
    lane = dr.arange(mi.UInt32, dr.width(d)) + first
    return paths.ends(mi.Point3f(*map(float, EYE)), d, lane, 16, seed)


def through(surfaces, all_ways=DRAWN):
    return EyePaths.of(build(surfaces), 0.5, all_ways=all_ways)


def luminance(paths, found):
    """Mean luminance where outside and surfaces send light by place and direction."""
    out, lit = found.outside, found.surfaces
    total = 0.0
    if dr.width(out.ray):
        total += float(dr.sum(out.weight * (1 + 0.5 * out.d.x + 0.3 * out.d.z))[0])
    if dr.width(lit.ray):
        E = 1 + dr.sin(3 * lit.p.x) * dr.cos(2 * lit.p.z) * 0.5
        total += float(dr.sum(lit.weight * paths.reflected(lit) * E)[0])
    return total / RAYS


BEHIND = Surface("behind", Lambertian(0.4), quad(-9 * EAST - 2 * NORTH, 9 * EAST, 9 * UP)[None])
SCENES = {
    "two panes that mirror": [wall(2, glass()), wall(3, glass()), wall(5, Lambertian(0.5)), BEHIND],
    "leaves before a wall": [
        *(wall(y, PorousMaterial(type="porous", porosity=0.5, reflectance=0.6)) for y in (2, 3, 4)),
        wall(5, Lambertian(0.3), high=1.5),
    ],
    "polished": [wall(2, mirror(reflectance=0.3, specular=0.2, polished=True)), BEHIND],
    "rough": [wall(2, mirror(roughness=0.2, specular=0.6)), BEHIND],
    "clear solid": [block(DielectricMaterial(type="dielectric", ior=1.5, absorption=1.0)), BEHIND,
                    wall(5, Lambertian(0.5))],
    "film": [wall(2, BsdfMaterial(type="bsdf", file=PRISM)), BEHIND, wall(5, Lambertian(0.5))],
}  # fmt: skip


@pytest.mark.parametrize("name", slowly([*SCENES], "two panes that mirror"))
def test_all_ways_and_drawn_ones_show_the_same(name):
    both = [through(SCENES[name], ways) for ways in (0.0, DRAWN)]
    each = np.array([
        [luminance(paths, ends(paths, seed)) for paths in both] for seed in range(REPLICATES)
    ])  # fmt: skip
    all_ways, drawn = each.mean(axis=0)
    error = np.hypot(*each.std(axis=0, ddof=1)) / np.sqrt(REPLICATES)
    print(f"{name}: {all_ways:.5f}, drawn {drawn:.5f} ± {error:.5f}")
    assert abs(all_ways - drawn) < 4 * error + 1e-6
    assert error < 0.01 * all_ways


@pytest.mark.parametrize("roughness", [0.0, 0.03])
def test_a_clear_solid_keeps_all_light_and_absorbs_by_its_thickness(roughness):
    """White furnace; then a slab, whose straight way is e^(−a d) times what its two faces pass."""
    solid = DielectricMaterial(type="dielectric", ior=1.5, roughness=roughness)
    found = ends(through([block(solid)], 0.0))
    lost = 0.02 if roughness else 1e-3  # rough faces lose what masking hides
    assert float(dr.sum(found.outside.weight)[0]) / RAYS == pytest.approx(1, abs=lost)
    if not roughness:
        ahead = mi.Vector3f(*np.repeat(NORTH[:, None], RAYS, axis=1))
        dark = solid.model_copy(update={"absorption": 2.0})
        found = ends(through([block(dark)], 0.0), d=ahead)
        there = found.outside.d.y > 0
        passed = float(dr.sum(dr.select(there, found.outside.weight, 0))[0]) / RAYS
        r, a = 0.04, np.exp(-2 * 0.5)
        assert passed == pytest.approx((1 - r) ** 2 * a / (1 - (r * a) ** 2), rel=0.01)


def test_films_in_line_glow_both():
    film = BsdfMaterial(type="bsdf", file=PRISM, straight_through="on")
    found = ends(through([wall(2, film), wall(3, film)]))
    y = found.panes.p.y.numpy()
    straight = (found.panes.met.numpy() & OnWay.SCATTERING_PANE) == 0
    assert straight.all()
    near, far = (np.isclose(y, at, atol=1e-3) for at in (2, 3))
    assert near.sum() == RAYS
    assert RAYS / 2 < far.sum() <= RAYS  # few cells of the file let none straight through
    weight = found.panes.weight.numpy()
    assert (weight[near] == 1).all()
    assert (weight[far] < 1).all()


def test_a_pane_is_passed_with_its_transmittance_whatever_is_drawn():
    found = ends(through([wall(2, glass()), wall(3, glass())]))
    straight = (found.outside.met.numpy() & OnWay.TURN) == 0
    ray, weight = found.outside.ray.numpy()[straight], found.outside.weight.numpy()[straight]
    assert (np.sort(ray) == np.arange(RAYS)).all()
    cosine = northward().y.numpy()[ray]
    tau = np.interp(cosine, np.linspace(0, 1, 1025), glass().tables(1025)[0])
    np.testing.assert_allclose(weight, tau**2, rtol=1e-4)


def test_ends_follow_from_the_numbers_of_rays_alone():
    d, half = northward(256), dr.arange(mi.UInt32, 128) + 128
    paths = through(SCENES["two panes that mirror"], 0.1)
    every, some = ends(paths, d=d), ends(paths, d=dr.gather(mi.Vector3f, d, half), first=128)
    whole, part = every.surfaces.rows(), some.surfaces.rows()
    there = whole.take(whole.ray >= 128)
    assert np.array_equal(there.ray - 128, part.ray)
    np.testing.assert_array_equal(there.weight, part.weight)
    np.testing.assert_allclose(there.point, part.point, atol=1e-5)
