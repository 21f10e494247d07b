"""The sun in mirrors of pictures: exact images, lobes, and each light path once."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.grazing import more_at_grazing
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import GlazingMaterial, Lambertian, MirrorMaterial
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.hour import luminance, replicates
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.outside import OutsideLuminances
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.stored_view import save_paths, with_tiles_of
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import build
from tests.unit.rendering.path_traced import pictures

EAST, NORTH, UP = np.eye(3)
SUN = np.array([0.1, -0.8, 0.6]) / np.linalg.norm([0.1, -0.8, 0.6])
IMAGE = SUN * [1, -1, 1]
DIAMETER, LUMINANCE, EYE = 0.5, 1e9, np.array([0.0, 0.0, 1.0])
OMEGA = disk_solid_angle(DIAMETER)
SIZE, DARK = 96, np.zeros(146)
OUTSIDE = OutsideLuminances(np.zeros((181, 721)), 0.0, LUMINANCE, SUN, DIAMETER)


def mirror(reflectance=0.8, **more):
    return MirrorMaterial(type="mirror", reflectance=reflectance, **more)


def wall(west=-9.0, low=-9.0):
    """Wall to the north of the eye, which faces it."""
    corner = west * EAST + 5 * NORTH + low * UP
    return quad(corner, (30 - low) * UP, (18 - 9 - west) * EAST)


def seen(*surfaces, towards=IMAGE, angle=20.0, samples=16, size=SIZE):
    """Light paths of a view by element, and the solid angles of its pixels [sr]."""
    view = PictureView("equidistant", tuple(towards), (0, 0, 1), (angle, angle), tuple(EYE))
    traced = trace(
        FacadeScenes.alone(build(list(surfaces))), view, size, size, sampling=Sampling(samples),
        accuracy=Accuracy(replicates=16), subdivision=1, diameter=DIAMETER,
    )  # fmt: skip
    return traced.in_state(), view.solid_angles(size, size)


def share(*surfaces, **view):
    """Light of the picture over that of the sun's disk, without what its corners show."""
    traced, omega = seen(*surfaces, **view)
    L = luminance(traced, OUTSIDE, DARK).mean
    return ((L - L[:8, :8].mean()) * omega).sum() / (LUMINANCE * OMEGA)


def fresnel(cosine, ior):
    inside = np.sqrt(1 - (1 - cosine**2) / ior**2)
    across = (cosine - ior * inside) / (cosine + ior * inside)
    along = (inside - ior * cosine) / (inside + ior * cosine)
    return (across**2 + along**2) / 2


def in_glass(cosine, ior=1.5):
    """Reflectance of a pane of two faces without absorption."""
    r = fresnel(cosine, ior)
    return 2 * r / (1 + r)


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (mirror(), 0.8),
        (mirror(specular=0.5), 0.4),
        (mirror(specular=0.1, polished=True), 0.08 + 0.92 * more_at_grazing(IMAGE[1])),
    ],
    ids=["mirror", "half", "polished"],
)
def test_a_picture_holds_all_light_of_the_image(material, expected):
    assert share(Surface("m", material, wall()[None], "m")) == pytest.approx(expected, rel=0.005)


def test_a_pane_shows_the_sun_on_both_sides_by_fresnel_and_its_edge_cuts_it():
    glass = GlazingMaterial(type="glazing", transmittance=0.85, ior=1.5)
    rises = 1 + IMAGE[2] / IMAGE[1] * 5  # height at which the eye sees the middle of the image
    rho = np.interp(IMAGE[1], np.linspace(0, 1, 1025), glass.tables(1025)[1])
    assert rho == pytest.approx(in_glass(IMAGE[1]), rel=0.2)  # the pane absorbs some light
    front = wall()[[0, 3, 2, 1]]
    assert share(Surface("glass", glass, front[None])) == pytest.approx(rho, rel=0.005)
    whole, half = (share(Surface("glass", glass, wall(low=low)[None])) for low in (-9.0, rises))
    assert whole == pytest.approx(rho, rel=0.005)
    assert half == pytest.approx(rho / 2, rel=0.03)


def test_two_mirrors_in_turn_show_the_sun_thrice():
    floor = quad(-9 * EAST - 9 * NORTH - 3 * UP, 30 * NORTH, 18 * EAST)
    both = [
        Surface("wall", mirror(0.8), wall(low=-3)[None], "wall"),
        Surface("floor", mirror(0.5), floor[None], "floor"),
    ]
    for signs, expected in (((1, -1, 1), 0.8), ((1, 1, -1), 0.5), ((1, -1, -1), 0.4)):
        found = share(*both, towards=SUN * signs)
        assert found == pytest.approx(expected, rel=0.005), signs


def test_rays_count_nothing_that_images_count():
    """Rays find darkness alone, so that the image has no noise, and nothing counts twice."""
    traced, _ = seen(Surface("m", mirror(), wall()[None], "m"), angle=2.0, samples=64)
    assert replicates(traced, OUTSIDE, DARK).max() == 0
    assert luminance(traced, OUTSIDE, DARK).mean.max() == pytest.approx(0.8 * LUMINANCE, rel=1e-4)


def test_a_mirror_of_many_planes_shows_the_sun_by_chance():
    """A body of more planes than have images: its light is found as often as it should be."""
    tiny = [quad(-8 * EAST + k * UP, 1e-3 * UP, 1e-3 * (EAST + k * NORTH)) for k in range(1, 9)]
    body = Surface("m", mirror(), np.array([wall(), *tiny]), "m")
    traced, omega = seen(body, angle=3.0, samples=256, size=24)
    assert traced.images is None
    found = (replicates(traced, OUTSIDE, DARK) * omega).sum(axis=(1, 2)) / (LUMINANCE * OMEGA)
    assert abs(found.mean() - 0.8) < 4 * found.std(ddof=1) / 4
    assert found.std(ddof=1) / 4 < 0.02


def lobe(material, view, size, places=4):
    """Luminance of pixels (row, column) over that of the sun, by the BSDF alone."""
    step = (np.arange(size * places) + 0.5) / (size * places)
    d = view.directions(step, 1 - step[:, None]).reshape(-1, 3)
    si = mi.SurfaceInteraction3f()
    si.n = mi.Normal3f(0, -1, 0)
    si.sh_frame = mi.Frame3f(si.n)
    si.wi = si.to_local(mi.Vector3f(*(-d).T))
    plugin, total = mi.load_dict(bsdf(material)), 0
    points = np.random.default_rng(0).random((64, 2))
    for uv in points:
        s = sample_disk(mi.Vector3f(*map(float, SUN)), DIAMETER, mi.Point2f(*map(float, uv)))
        total = total + plugin.eval(mi.BSDFContext(), si, si.to_local(s))[0].numpy()
    fine = total.reshape(size, places, size, places)
    return fine.mean(axis=(1, 3)) * OMEGA / len(points)


@pytest.mark.parametrize("roughness", [0.004, 0.03, 0.3])
def test_a_rough_mirror_shows_the_sun_as_its_bsdf_tells(roughness):
    """With little noise at any roughness: lobes narrower and wider than the disk."""
    material = mirror(roughness=roughness)
    traced, _ = seen(Surface("m", material, wall()[None], "m"), samples=64, size=24, angle=6.0)
    shows_the_lobe(traced, OUTSIDE, lobe(material, traced.view, 24))


def test_a_rough_mirror_shows_the_sun_of_another_mirror():
    """Light comes from the north to a mirror behind the eye, and from there to the rough one."""
    material = mirror(roughness=0.03)
    behind = quad(-9 * EAST - 20 * NORTH - 9 * UP, 18 * EAST, 70 * UP)
    surfaces = [
        Surface("m", material, wall()[None], "m"), Surface("b", mirror(0.5), behind[None], "b"),
    ]  # fmt: skip
    traced, _ = seen(*surfaces, samples=64, size=24, angle=6.0)
    outside = replace(OUTSIDE, direction=IMAGE)
    shows_the_lobe(traced, outside, 0.5 * lobe(material, traced.view, 24))


def shows_the_lobe(traced, outside, expected):
    """Compare a picture with the luminance of its pixels over that of the sun, (row, column)."""
    here = replicates(traced, outside, DARK) / LUMINANCE
    bright = expected > 0.05 * expected.max()
    error = here.std(axis=0, ddof=1) / 4
    z = (here.mean(axis=0) - expected)[bright] / np.hypot(error, 0.01 * expected)[bright]
    assert abs(z).max() < 5
    E, exact = here.mean(axis=(1, 2)), expected.mean()
    assert abs(E.mean() - exact) < 4 * E.std(ddof=1) / 4 + 0.003 * exact
    assert E.std(ddof=1) / 4 < 0.03 * exact
    if bright.mean() > 0.3:  # rays alone find the disk, with an error of 20 % here and more
        assert np.median(error[bright] / expected[bright]) < 0.02


def test_light_paths_on_disk_give_the_same_picture(tmp_path):
    surfaces = [
        Surface("m", mirror(roughness=0.1, specular=0.5), wall(low=1.0)[None], "m"),
        Surface("pool", mirror(), wall()[None] + 0.1 * NORTH, "pool"),
    ]
    traced, _ = seen(*surfaces, size=24, angle=60.0)
    for paths in traced.tiles():
        save_paths(paths, tmp_path)
    (kept,) = with_tiles_of([traced], [tmp_path])
    both = [replicates(one, OUTSIDE, DARK) for one in (traced, kept)]
    assert both[0].max() > 0
    assert np.allclose(*both, rtol=1e-6)


@pytest.mark.slow
def test_surfaces_in_a_picture_have_the_sun_by_rough_mirrors(same):
    """A floor before a rough mirror, and the mirror itself, against plain path tracing."""
    floor = quad(-3 * EAST + 0.0 * UP, 4 * EAST, 4 * NORTH)
    surfaces = [
        Surface("m", mirror(roughness=0.2, specular=0.6), wall(low=0.0)[None], "m"),
        Surface("floor", Lambertian(0.5), floor[None]),
    ]
    view = PictureView("equidistant", (0.0, 1, -0.3), (0, 0, 1), (100, 100), tuple(EYE))
    traced = trace(
        FacadeScenes.alone(build(surfaces)), view, 10, 10, sampling=Sampling(256, paths=8),
        subdivision=1, diameter=DIAMETER, accuracy=Accuracy(replicates=16, cell_size=0.3),
    ).in_state()  # fmt: skip
    here = replicates(traced, OUTSIDE, DARK)
    there = pictures(surfaces, view, 10, SUN)[..., 146] * LUMINANCE
    same(here, other=there, within=0.02)
