"""Luminance of rough mirrors under suns, against the BSDF, and in what an eye sees."""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.glare_year.films import glow
from drcmitsuba.glare_year.seen_ends import eye_paths, seen_ends
from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import build

EAST, NORTH, UP = np.eye(3)
WALL = quad(np.array([-3.0, 8.0, 0.0]), 4 * UP, 6 * EAST)
METAL = MirrorMaterial(
    type="mirror", reflectance=0.7, roughness=0.15, specular=0.4, distribution="beckmann"
)
DIAMETER = 0.533
SUNS = np.array([[0.0, -0.9, 0.25], [0.4, -0.7, 0.3], [0.1, 0.8, 0.4]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)
RAYS = np.array([[0.0, 1.0, 0.1], [0.2, 1.0, 0.05], [-0.3, 1.0, 0.2]])
RAYS /= np.linalg.norm(RAYS, axis=1, keepdims=True)
EYE = np.array([0.0, 0.0, 1.2])


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def seen(*more):
    scene = build([Surface("wall", METAL, WALL[None], "wall"), *more])
    films = seen_ends(eye_paths(scene, DIAMETER), EYE, RAYS, seed=1).glowing
    return films, glow(scene, films, SUNS, DIAMETER, 1, 0)


def test_a_rough_mirror_glows_as_its_bsdf_tells():
    films, shining = seen()
    assert films.ray.tolist() == [0, 1, 2]
    plugin = mi.load_dict(bsdf(METAL.model_copy(update={"specular": 1.0})))
    for d, row in zip(RAYS, shining.suns, strict=True):
        for s, L in zip(SUNS, row, strict=True):
            si = mi.SurfaceInteraction3f()
            si.n = mi.Normal3f(0, -1, 0)
            si.sh_frame = mi.Frame3f(si.n)
            si.wi = si.to_local(mi.Vector3f(*map(float, -d)))
            f = plugin.eval(mi.BSDFContext(), si, si.to_local(mi.Vector3f(*map(float, s))))[0]
            # The disk is a seventeenth as wide as the lobe.
            want = 0.4 * float(f[0]) * disk_solid_angle(DIAMETER)
            assert pytest.approx(want, rel=0.05, abs=1e-9) == L
    assert (shining.suns[:, :2] > 0).all()
    assert (shining.suns[:, 2] == 0).all()  # behind the wall
    assert not shining.sharpness.any()
    assert not shining.sky.any()  # rays turn at the mirror to the sky


def test_what_hides_the_sun_from_the_mirror_darkens_it():
    screen = quad(-500 * EAST - 4 * NORTH - 500 * UP, 1000 * UP, 1000 * EAST)
    assert not seen(Surface("screen", Lambertian(0.5), screen[None]))[1].suns.any()
