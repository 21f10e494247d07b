"""Luminances of a picture and of glare alike, region by region, by every kind of material.

Both follow rays by one engine; all else is apart. A picture draws one way of each ray, and has the
light of surfaces from their own rays to cells, sky and panes; its films glow by patches. Glare
goes all ways of a ray in the middle of each tile, has the light of surfaces from coefficients of
sensors, and films glow at every ray's end.
"""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import patch_index

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.glare_year.films import glow
from drcmitsuba.glare_year.seen_ends import eye_paths, seen_ends
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.hour import replicates
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build
from drcmitsuba.sky.sun_models import Suns
from tests.unit.eye.test_eye_paths import block
from tests.unit.glare_year.test_glare_of_films import klems
from tests.unit.rendering.path_traced import LUMINANCES, Patchwise
from tests.unit.transport.exact_scenes import run

EAST, NORTH, UP = np.eye(3)
EYE = np.array([0.0, 0.0, 1.2])
VIEW = PictureView("equidistant", (0, 1, -0.1), (0, 0, 1), (80, 80), tuple(EYE))
SIZE, REGIONS, LIFT = 12, 3, 1e-3
SUN, DIAMETER = np.array([0.0, -0.8, 0.6]), 0.5


def before(y, low, high, material, name=""):
    """Sheet of 4 m width to the north that faces the eye."""
    corners = quad(-2 * EAST + y * NORTH + low * UP, (high - low) * UP, 4 * EAST)
    return Surface("sheet", material, corners[None], name)


def floor(material, name=""):
    return Surface("floor", material, quad(-4 * EAST, 8 * EAST, 6 * NORTH)[None], name)


def mirror(**more):
    return MirrorMaterial(**({"type": "mirror", "reflectance": 0.6} | more))


def scenes(folder):
    """Surfaces by name, and luminance of the sun."""
    film = BsdfMaterial(type="bsdf", file=klems(folder, through=0.2))
    glass = GlazingMaterial(type="glazing", transmittance=0.8, ior=1.52)
    solid = DielectricMaterial(type="dielectric", ior=1.5, absorption=2.0)
    matt, dark = Lambertian(0.5), Lambertian(0.05)  # what mirrors send on to surfaces is left out
    return {
        "clear pane that mirrors": ([before(4, 0, 3, glass), before(6, 0, 1.5, matt)], 1e8),
        "film": ([before(4, 0.5, 2.5, film), floor(dark)], 1e8),
        "rough mirror": ([before(4, -3, 5, mirror(roughness=0.3, specular=0.6), "m")], 1e8),
        "polished floor": (
            [floor(mirror(reflectance=0.4, specular=0.1, polished=True), "f"),
             before(5, 0, 2, dark)], 1e8),
        "clear solid": ([block(solid), floor(matt), before(5, 0, 2, matt)], 0.0),
    }  # fmt: skip


def of_glare(world, directions, sun):
    """Luminance of rays (ray,) without the disk of the sun; LUMINANCES are those of the sky."""
    paths = eye_paths(world, DIAMETER)
    found = seen_ends(paths, EYE, directions, seed=3, samples=16)
    out = np.zeros(len(directions))
    d = mi.Vector3f(*found.outside.direction.T.astype(np.float32))
    np.add.at(out, found.outside.ray, found.outside.weight * LUMINANCES[patch_index(d, 1).numpy()])
    if len(found.glowing.ray):
        shining = glow(world, found.glowing, SUN[None], DIAMETER, 1, 3)
        L = shining.sky @ LUMINANCES + shining.suns[:, 0] * sun
        np.add.at(out, found.glowing.ray, found.glowing.weight * L)
    lit = found.surfaces
    if len(lit.ray):
        C = run(
            world, lit.point + LIFT * lit.normal, lit.normal, Suns(("sun",), SUN[None]),
            replicates=2, paths=64, sensor_sky_rays=256, cell_size=0.2,
        ).mean(axis=0)  # fmt: skip
        E = C[:, :146] @ LUMINANCES + C[:, 146] * sun
        np.add.at(out, lit.ray, lit.weight[:, 0] / np.pi * E)
    return out


@pytest.mark.parametrize(
    "name",
    [
        "clear pane that mirrors", pytest.param("film", marks=pytest.mark.slow), "rough mirror",
        pytest.param("polished floor", marks=pytest.mark.slow), "clear solid",
    ],
)  # fmt: skip
def test_a_picture_is_as_bright_as_glare_has_it(name, tmp_path):
    surfaces, sun = scenes(tmp_path)[name]
    world = build(surfaces)
    outside = Patchwise(np.zeros((2, 2)), 0.0, sun, SUN, DIAMETER)
    traced = trace(
        FacadeScenes.alone(world), VIEW, SIZE, SIZE, sampling=Sampling(256, paths=4, sky=8),
        subdivision=1, diameter=DIAMETER, accuracy=Accuracy(replicates=8, cell_size=0.2),
    ).in_state()  # fmt: skip
    shown = replicates(traced, outside, LUMINANCES)
    finer = 7
    x, y = np.meshgrid(*2 * [(np.arange(SIZE * finer) + 0.5) / (SIZE * finer)])
    there = of_glare(world, VIEW.directions(x, 1 - y).reshape(-1, 3), sun)
    there = there.reshape(REGIONS, SIZE * finer // REGIONS, REGIONS, -1).mean(axis=(1, 3))
    step = SIZE // REGIONS
    here = shown.reshape(8, REGIONS, step, REGIONS, step).mean(axis=(2, 4))
    mean, error = here.mean(axis=0), here.std(axis=0, ddof=1) / np.sqrt(8)
    print(name, (mean / there).round(3).tolist(), (error / there).round(3).max())
    assert (abs(mean - there) < 4 * error + 0.015 * there).all()
    assert (error < 0.02 * there).all()
