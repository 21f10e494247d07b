"""Pictures of rooms with films, and of the classroom, against path tracing and Radiance.

Rationale: a picture sums tables and records of paths that other modules made for sensors. What it
shows of a film, straight on the film and by it on the ceiling, is the reason to render at all.

Method: per pixel (Šidák) and in sum against the plugin `coefficient` behind the plugin `fisheye`;
the cosine integral of a fisheye against a sensor at the eye; the mean luminance of regions of the
classroom against `rpict` with the same sky and sun in its own scene files.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.primitives import GLAZING, GLAZING_FILE
from drcmitsuba.export.scene_files import scene_files
from drcmitsuba.export.sources import SKY, SUN_RADIANCE, sun_text
from drcmitsuba.picture import hdr
from drcmitsuba.picture.picture import EFFICACY, Picture
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.hour import luminance, replicates
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests import radiance, skips
from tests.unit.rendering import path_traced
from tests.unit.rendering.path_traced import LUMINANCES, Patchwise
from tests.validation import lamella_room
from tests.validation.test_films import PRISM, room, towards

SUN, LUMINANCE = np.array(towards(50, 180)), 1e8
GLOW = 50.0
"""Radiance of sky and ground in Radiance [W/(m² sr)]."""
RPICT = "-u+ -ab 8 -ad 256 -as 0 -aa 0 -lw 1e-9 -dt 0 -dc 1 -st 0 -ps 1 -dj 1"
RUNS = 4
"""Number of pictures of `rpict` that are averaged, with one ray a pixel each."""
EYE = PictureView("equidistant", (0.1, -1, 0.35), (0, 0, 1), (120, 120), (2.1, 3.9, 1.2))


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def outside(sun=LUMINANCE):
    return Patchwise(np.zeros((2, 2)), 0.0, sun, SUN, 0.5)


def prepared(world, view, size, samples, *, solved, **accuracy):
    world = replace(world, effects=replace(world.effects, solved_cells=solved))
    return trace(
        FacadeScenes.alone(world), view, size, size, sampling=Sampling(samples),
        subdivision=1, diameter=0.5,
        accuracy=Accuracy(replicates=16, **accuracy),
    ).in_state()  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("reflectance", [0.0])
def test_a_film_is_seen_and_lights_the_room_as_by_path_tracing(reflectance, same):
    case = room(PRISM, reflectance)
    view = prepared(scene.load(case), EYE, 12, 1024, solved=False, cell_size=0.15,
                    cell_sky_rays=256)  # fmt: skip
    there = path_traced.pictures(surfaces_of(case), EYE, 12, SUN, spp=1024)
    by_sky, by_sun = there[..., :146] @ LUMINANCES, there[..., 146] * LUMINANCE
    same(replicates(view, outside(0.0), LUMINANCES), other=by_sky, within=0.01)
    same(replicates(view, outside(), LUMINANCES), other=by_sky + by_sun, within=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("source", ["sky", "sun"])
def test_the_fisheye_before_a_film_is_a_sensor_at_the_eye(source):
    case = room(PRISM, 0.0)
    world = scene.load(case)
    view = replace(EYE, kind="hemispherical", direction=(0, -1, 0), angles=(180, 180))
    sky = LUMINANCES * (source == "sky")
    shown = replicates(
        prepared(world, view, 128, 64, solved=True, pane_points=256, cell_size=0.3),
        replace(outside(LUMINANCE * (source == "sun")), sky_scale=sky), sky,
    )  # fmt: skip
    picture = Picture(np.zeros((128, 128, 3), np.float32), view)
    share = picture.solid_angles() * np.maximum(picture.directions() @ view.frame[2], 0)
    each = (shown * np.nan_to_num(share)).sum(axis=(1, 2))
    E, error = each.mean(), each.std(ddof=1) / 4
    accuracy = Accuracy(replicates=16, paths=8192, sensor_sky_rays=1 << 15, pane_points=4096)
    C = compute(
        world, np.array([view.position]), np.array([[0.0, -1.0, 0.0]]),
        Suns(("sun",), SUN[None]), accuracy,
    )["replicates"].values[:, 0]  # fmt: skip
    there = C[:, :146] @ sky + C[:, 146] * LUMINANCE * (source == "sun")
    of_sensor = there.std(ddof=1) / 4
    print(f"{source}: {E:.1f} ± {error:.1f} lx, a sensor {there.mean():.1f} ± {of_sensor:.1f}")
    assert error < 0.01 * E
    error = np.hypot(error, of_sensor)
    assert abs(E - there.mean()) < 0.01 * there.mean() + 3 * error


def by_rpict(surfaces, view, size, folder, options):
    """Luminance of a view by `rpict` [cd/m²], under a sky of 50 W/(m² sr) and the sun."""
    made = scene_files(surfaces)
    (folder / GLAZING_FILE).write_text(GLAZING)
    sky = SKY.replace("4 1 1 1 0", f"4 {' '.join(3 * [f'{GLOW:g}'])} 0")
    sun = sun_text(Suns(("sun",), SUN[None]))
    (folder / "room.rad").write_text(made.materials + made.polygons + sky + sun)
    (folder / "room.oct").write_bytes(radiance.run(["oconv", "room.rad"], folder))
    command = ["rpict", "-x", str(size), "-y", str(size), "-pj", "1", *options.split()]
    shown = radiance.run([*command, *view.options().split(), "room.oct"], folder)
    (folder / "room.hdr").write_bytes(shown)
    return hdr.read(folder / "room.hdr").luminance


@pytest.mark.slow
@skips.RADIANCE.mark
def test_the_classroom_is_that_of_rpict_in_mean_and_by_region(tmp_path):
    case = load_case("classroom/existing")
    view = PictureView("equidistant", (-0.3, -1, 0), (0, 0, 1), (170, 170), (4.4, 6.0, 1.2))
    size, regions = 96, 6
    runs = [by_rpict(surfaces_of(case), view, size, tmp_path, RPICT) for _ in range(RUNS)]
    there = np.mean(runs, axis=0)
    world = scene.load(case, channel=-1)
    sky, sun = np.full(146, GLOW * EFFICACY), SUN_RADIANCE * EFFICACY
    shown = luminance(
        prepared(world, view, size, 128, solved=True), replace(outside(sun), sky_scale=sky), sky
    )

    def by_region(values):
        step = size // regions
        return values.reshape(regions, step, regions, step).mean(axis=(1, 3))

    ratio = by_region(shown.mean) / by_region(there) - 1
    print(np.round(100 * ratio, 1).tolist())
    print(f"mean {shown.mean.mean():.1f}, rpict {there.mean():.1f} cd/m²")
    lit = by_region(there) > 0
    # Rays of rpict miss or meet small sunlit spots, in regions by 8 % from run to run; cells of
    # 0.45 m are off by 0.4 %.
    assert abs(shown.mean.mean() / there.mean() - 1) < 0.02
    assert np.sqrt((ratio[lit] ** 2).mean()) < 0.03
    assert abs(ratio[lit]).max() < 0.1


@pytest.mark.slow
def test_caustics_of_lamellae_reach_the_eye_as_a_sensor(same):
    surfaces = [
        *lamella_room.shell(), lamella_room.casing(), lamella_room.lamellae(), lamella_room.pane(),
    ]  # fmt: skip
    world = scene.build(surfaces, ports=(lamella_room.port(),))
    up = PictureView("hemispherical", (0, 0, 1), (0, 1, 0), (180, 180), (2.0, 2.0, 1.0))
    sun, dark = np.array(towards(15, 180)), 0 * LUMINANCES
    light = replace(outside(), direction=sun, sky_scale=dark)
    shown = replicates(prepared(world, up, 64, 64, solved=True), light, dark)
    picture = Picture(np.zeros((64, 64, 3), np.float32), up)
    share = np.nan_to_num(picture.solid_angles() * np.maximum(picture.directions()[..., 2], 0))
    here = (shown * share).sum(axis=(1, 2), keepdims=True)[:, 0]
    C = compute(
        world, np.array([up.position]), np.array([[0.0, 0.0, 1.0]]), Suns(("sun",), sun[None]),
        Accuracy(replicates=16, paths=1 << 15, photons=1 << 17, cell_size=0.2), subdivision=None,
    )  # fmt: skip
    same(here, other=C["replicates"].values[:, :, 0] * LUMINANCE, within=0.05)
