"""Surfaces that are looked up, beside those that Mitsuba computes."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.scene.materials import loaded
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.met_faces import MetFaces
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene

COUNT = 4096
FLAGS = mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame


def askew(rng, count):
    """Quads of any direction around the origin, every third of them a triangle."""
    u, v = (rng.standard_normal((2, count, 3)) * 0.3).astype(float)
    corner = rng.uniform(-1, 1, (count, 3))
    quads = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
    quads[::3, 3] = quads[::3, 2]
    return quads


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def scenes(variant, rng):
    """Two scenes of several materials, in the one level and upright faces, too."""
    level = np.array([[[-1, -1, -1.5], [1, -1, -1.5], [1, 1, -1.5], [-1, 1, -1.5]]], float)
    upright = np.roll(level, 1, axis=2)
    every = {"askew": askew(rng, 9), "level": level, "upright": upright, "more": askew(rng, 5)}
    meshes = {
        name: quad_mesh(name, quads, loaded(Lambertian(0.1 * k), -1))
        for k, (name, quads) in enumerate(every.items())
    }
    white = quad_mesh("white", askew(rng, 12), loaded(Lambertian(0.9), -1))
    return mitsuba_scene(meshes), mitsuba_scene({"white": white})


def rays(rng):
    p, d = rng.uniform(-2, 2, (3, COUNT)), rng.standard_normal((3, COUNT))
    return mi.Ray3f(mi.Point3f(p), mi.Vector3f(d / np.linalg.norm(d, axis=0)))


@pytest.mark.parametrize("which", [0, 1])
def test_a_look_up_gives_what_mitsuba_computes(variant, rng, scenes, which):
    scene, ray = scenes[which], rays(rng)
    computed = scene.ray_intersect(ray, FLAGS, coherent=False)
    looked_up = MetFaces.of(*scenes).intersect(scene, ray, mi.Bool(True))
    there = computed.is_valid().numpy()
    assert 50 < there.sum() < COUNT - 50
    np.testing.assert_array_equal(looked_up.is_valid().numpy(), there)
    for name in ("p", "n"):
        values = (np.array(getattr(si, name))[:, there] for si in (looked_up, computed))
        np.testing.assert_allclose(*values, atol=2e-6)
    frame, n = looked_up.sh_frame, np.array(looked_up.n)[:, there]
    np.testing.assert_array_equal(np.array(frame.n)[:, there], n)
    turned = np.cross(*(np.array(axis)[:, there].T for axis in (frame.s, frame.t)))
    np.testing.assert_allclose(turned, n.T, atol=2e-6)
    back = np.array(looked_up.to_world(looked_up.wi))[:, there]
    np.testing.assert_allclose(back, -np.array(ray.d)[:, there], atol=2e-6)
    for number in (lambda si: si.prim_index, lambda si: dr.reinterpret_array(mi.UInt32, si.bsdf())):
        same = (number(si).numpy()[there] for si in (looked_up, computed))
        np.testing.assert_array_equal(*same)


def test_rays_that_do_not_count_meet_nothing(variant, rng, scenes):
    si = MetFaces.of(*scenes).intersect(scenes[0], rays(rng), mi.Bool(False))
    assert not si.is_valid().numpy().any()
    assert (np.array(si.p) == 0).all()
    assert (si.prim_index.numpy() == 0).all()


def test_a_scene_without_meshes_has_no_faces(variant):
    empty = mitsuba_scene({})
    ray = mi.Ray3f([0.0, 0, 0], [0.0, 0, 1])
    assert not MetFaces.of(empty).intersect(empty, ray, mi.Bool(True)).is_valid()[0]
