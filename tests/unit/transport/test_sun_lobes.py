"""Lobes of suns in rough mirrors, against quadrature over the mirror and against photons."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import build
from drcmitsuba.transport.mirrors.planar_mirrors import MOST_LOBES, imaged_components
from drcmitsuba.transport.mirrors.sun_lobes import SunLobes

EAST, NORTH, UP = np.eye(3)
DIAMETER, AGAIN = 0.533, 4096
CORNER, WIDTH, HEIGHT = np.array([-3.0, 8.0, 0.0]), 6.0, 4.0
POINTS = np.array([[0.0, 0.3, 1.6], [1.5, 2.0, 0.8], [-4.0, 1.0, 1.0]])
NORMALS = np.array([NORTH, UP, (NORTH + EAST) / np.sqrt(2)])
SUNS = np.array([[0.0, -0.9, 0.25], [0.4, -0.7, 0.3], [-0.8, -0.2, 0.5], [0.1, 0.8, 0.4]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def wall(material, *more):
    corners = quad(CORNER, HEIGHT * UP, WIDTH * EAST)
    return build([Surface("wall", material, corners[None], "wall"), *more])


def by_lobes(scene):
    """D of the points by suns in rough mirrors [sr], mean over `AGAIN` receivers, and its error."""
    p, n = (flat(np.repeat(x, AGAIN, axis=0)) for x in (POINTS, NORMALS))
    (lobes,) = SunLobes.of(scene)
    D = lobes.suns(p, n, suns=SUNS, diameter=DIAMETER, samples=8, seed=0).numpy()
    D = D.reshape(len(POINTS), AGAIN, len(SUNS))
    return D.mean(axis=1), D.std(axis=1) / np.sqrt(AGAIN)


def by_quadrature(material, steps=400):
    """D of the points: sum over the mirror of f cos θ_s Ω cos θ dω, the sun taken as a point."""
    x, z = np.meshgrid(*((np.arange(steps) + 0.5) / steps,) * 2)
    at = CORNER + x.reshape(-1, 1) * WIDTH * EAST + z.reshape(-1, 1) * HEIGHT * UP
    plugin, omega = mi.load_dict(bsdf(material)), 2 * np.pi * (1 - np.cos(np.radians(DIAMETER / 2)))
    D = np.zeros((len(POINTS), len(SUNS)))
    for i, (p, n) in enumerate(zip(POINTS, NORMALS, strict=True)):
        d = at - p
        r = np.linalg.norm(d, axis=1)
        d /= r[:, None]
        dw = WIDTH * HEIGHT / steps**2 * (d @ NORTH) / r**2
        for j, s in enumerate(SUNS):
            si = mi.SurfaceInteraction3f()
            si.n = mi.Normal3f(0, -1, 0)
            si.sh_frame = mi.Frame3f(si.n)
            si.wi = si.to_local(mi.Vector3f(*(-d.T).astype(np.float32)))
            value = plugin.eval(mi.BSDFContext(), si, si.to_local(mi.Vector3f(*map(float, s))))[0]
            D[i, j] = omega * (value.numpy() * np.maximum(d @ n, 0) * dw).sum()
    return D


@pytest.mark.parametrize("roughness", [0.05, 0.2, 0.5])
def test_lobes_are_those_of_the_bsdf_over_the_mirror(roughness):
    material = MirrorMaterial(type="mirror", reflectance=0.7, roughness=roughness)
    D, error = by_lobes(wall(material))
    want = by_quadrature(material)
    assert (want[:, :3] > 0).all()
    # The disk widens the narrowest lobe of 3° by a hundredth of its light.
    assert (abs(D - want) < 4 * error + 0.01 * want.max()).all()
    assert D.sum() == pytest.approx(want.sum(), rel=0.02)


def test_a_part_of_the_light_is_mirrored():
    material = MirrorMaterial(type="mirror", reflectance=0.7, roughness=0.1)
    some = material.model_copy(update={"specular": 0.3})
    whole, _ = by_lobes(wall(material))
    np.testing.assert_allclose(by_lobes(wall(some))[0], 0.3 * whole, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("y", [4.0, -4.0])
def test_what_stands_before_the_mirror_or_the_sun_hides_it(y):
    screen = quad(-500 * EAST + y * NORTH - 500 * UP, 1000 * UP, 1000 * EAST)
    material = MirrorMaterial(type="mirror", reflectance=0.7, roughness=0.1)
    D, _ = by_lobes(wall(material, Surface("screen", Lambertian(0.5), screen[None])))
    assert (D == 0).all()


def test_many_lobes_are_bounded_and_the_largest_remain():
    every = []
    for i in range(20):
        material = MirrorMaterial(type="mirror", reflectance=0.7, roughness=0.1 + 0.01 * i)
        size = 0.1 * (i + 1)
        strip = quad(CORNER + 3 * i * NORTH, size * UP, WIDTH * EAST)
        every.append(Surface(f"wall{i}", material, strip[None], f"wall{i}"))
    lobes = SunLobes.of(build(every))
    assert len(lobes) == MOST_LOBES
    assert min(one.mirror.roughness for one in lobes) == pytest.approx(0.1 + 0.01 * 12)


def test_photons_leave_mirrors_alone_whose_light_has_exact_directions():
    material = MirrorMaterial(type="mirror", reflectance=0.7, roughness=0.1)
    for each in (material, material.model_copy(update={"roughness": 0.0})):
        assert imaged_components(wall(each)) == {"wall"}


def test_light_of_a_point_does_not_depend_on_the_others():
    material = MirrorMaterial(type="mirror", reflectance=0.7, roughness=0.1)
    (lobes,) = SunLobes.of(wall(material))
    kinds = [(lobes.sky, {"subdivision": 1, "rays": 64}),
             (lobes.suns, {"suns": SUNS, "diameter": DIAMETER, "samples": 8})]  # fmt: skip
    for of, kind in kinds:
        whole = of(flat(POINTS), flat(NORMALS), seed=0, numbers=mi.UInt32([0, 1, 2]), **kind)
        alone = of(flat(POINTS[1:2]), flat(NORMALS[1:2]), seed=0, numbers=mi.UInt32([1]), **kind)
        assert alone.numpy().any()
        np.testing.assert_allclose(alone.numpy()[0], whole.numpy()[1], rtol=1e-5)
