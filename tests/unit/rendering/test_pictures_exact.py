"""Pictures from light paths against independent path tracing, and against sensors at the eye.

The reference is the plugin `coefficient` behind the plugin `fisheye`: it traces every picture anew
and knows no cells, no tables and no openings. It is rendered for every bin and summed with the same
luminances.
"""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.coefficient_pictures import coefficient_pictures
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.hour import luminance, replicates
from drcmitsuba.rendering.light_paths import trace
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.view_rays import directions
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.surfaces import surfaces_of
from tests.unit.rendering.path_traced import LUMINANCES, Patchwise, pictures
from tests.unit.transport.exact_scenes import DIRECTIONS, PATCHES, SUNS, run
from tests.unit.transport.test_coefficients_small_room import ROOMS

SUN = 3e8
EYE = PictureView("equidistant", (0.2, -1, -0.1), (0, 0, 1), (170, 170), (1.5, 3.2, 1.3))
SIZE = 12


def outside(sun=SUN):
    return Patchwise(np.zeros((2, 2)), 0.0, sun, DIRECTIONS[0], 0.5)


def traced(world, *, solved, view=EYE, size=SIZE, samples=512, **accuracy):
    world = replace(world, effects=replace(world.effects, solved_cells=solved))
    return trace(
        FacadeScenes.alone(world), view, size, size,
        sampling=Sampling(samples, paths=8, sky=8, panes=4),
        accuracy=Accuracy(replicates=16, **accuracy), subdivision=1, diameter=0.5,
    ).in_state()  # fmt: skip


@pytest.mark.parametrize("kind", ["perspective", "hemispherical", "equidistant", "equisolid"])
def test_rays_look_where_the_pixels_of_the_view_do(kind):
    view = PictureView(kind, (0.3, 1, -0.2), (0.1, 0, 1), (120, 80), shift=0.1, lift=-0.2)
    x, y = np.random.default_rng(0).random((2, 200))
    d, exists = directions(view, mi.Float(x), mi.Float(y))
    expected = view.directions(x, y)
    assert np.array_equal(exists.numpy(), np.isfinite(expected[:, 0]))
    assert np.allclose(d.numpy().T[exists.numpy()], expected[exists.numpy()], atol=2e-6)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name != "glazing with inner reflectance"))
        for name in ROOMS
    ],
)
def test_a_superposed_picture_is_that_of_a_path_tracer(name, same):
    case, state = ROOMS[name]()
    world = scenes.load(case, state)
    here = replicates(
        traced(world, solved=False, cell_size=0.1, cell_sky_rays=256, pane_points=64), outside(),
        LUMINANCES,
    )  # fmt: skip
    there = pictures(surfaces_of(case, state), EYE, SIZE, DIRECTIONS[0])
    by_sky, by_sun = there[..., :146] @ LUMINANCES, there[..., 146] * SUN
    dark = replicates(traced(world, solved=False, cell_size=0.1), outside(0.0), LUMINANCES)
    same(dark, other=by_sky, within=0.01)
    same(here, other=by_sky + by_sun, within=0.02)


@pytest.mark.slow
def test_solved_cells_and_paths_give_one_picture(same):
    case, state = ROOMS["house opposite and bench"]()
    world = scenes.load(case, state)
    both = [
        replicates(traced(world, solved=solved, cell_size=0.15), outside(), LUMINANCES)
        for solved in (True, False)
    ]
    same(both[0], other=both[1], within=0.01)


@pytest.mark.parametrize("sun", [pytest.param(0.0, marks=pytest.mark.slow), SUN])
def test_a_fisheye_weighted_by_the_cosine_is_a_sensor_at_the_eye(sun):
    case, state = ROOMS["opal above clear"]()
    world = scenes.load(case, state)
    view = replace(EYE, kind="hemispherical", angles=(180, 180), direction=(0, -1, 0))
    shown = luminance(
        traced(world, solved=True, view=view, size=96, samples=16), outside(sun), LUMINANCES
    )
    picture = Picture(np.repeat(shown.mean[..., None], 3, axis=2), view)
    share = picture.solid_angles() * np.maximum(picture.directions() @ view.frame[2], 0)
    share = np.nan_to_num(share)
    E, error = (shown.mean * share).sum(), np.sqrt(((shown.error * share) ** 2).sum())
    sensor = np.array([view.position]), np.array([[0.0, -1.0, 0.0]])
    C = run(world, *sensor, SUNS, replicates=16, paths=4096, sensor_sky_rays=1 << 15)
    expected = C[:, 0, :146] @ LUMINANCES + C[:, 0, 146] * sun
    error = np.hypot(error, expected.std(ddof=1) / 4)
    print(f"{E:.1f} lx, expected {expected.mean():.1f} ± {error:.1f}")
    assert abs(E - expected.mean()) < 0.01 * expected.mean() + 3 * error
    assert error < 0.01 * E
    assert len(PATCHES) == 146


def under_a_pipe(**more):
    """A windowless room under a mirrored pipe, whose light photons bring."""
    pipe = {"type": "lightpipe", "centre": [2, 2], "width": 0.8, "sides": 4, "height": 1.5}
    opal = {"type": "diffuser", "transmittance": 0.5, "reflectance": 0.3}
    tables = {
        "room": {"size": [4, 4, 3]},
        "materials": {"silver": {"type": "mirror", "reflectance": 0.95}, "opal": opal},
        "components": {"pipe": {**pipe, "mirror": "silver", **more}},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [1, 1]},
    }
    return Case.model_validate(tables), "open"


@pytest.mark.parametrize(
    ("room", "solved"),
    [
        (ROOMS["opal above clear"], True), (ROOMS["opal above clear"], False), (under_a_pipe, True),
        (lambda: under_a_pipe(bottom="opal"), True),
    ],
)  # fmt: skip
def test_coefficient_pictures_sum_up_to_the_sky_of_an_hour(room, solved):
    case, state = room()
    view = traced(scenes.load(case, state), solved=solved, samples=16, photons=16)
    (whole,) = coefficient_pictures(view)
    shown = luminance(view, outside(0.0), LUMINANCES).mean
    assert whole["coefficient"].dims == ("row", "column", "bin")
    assert np.allclose(whole["coefficient"].values @ LUMINANCES, shown, rtol=1e-4)
    assert (whole["coefficient_se"] > 0).any()
    assert (shown > 0).mean() > 0.5


@pytest.mark.slow
def test_the_diffuser_of_a_pipe_lights_an_eye_below_it():
    """A sensor at the eye gets all of its light by photons, the picture by its glow."""
    case, state = under_a_pipe(bottom="opal")
    world = scenes.load(case, state)
    view = PictureView("hemispherical", (0, 0, 1), (0, 1, 0), (180, 180), (1.6, 1.8, 1.2))
    both = traced(world, solved=True, view=view, size=64, samples=16, photons=512)
    sensor = np.array([view.position]), np.array([[0.0, 0.0, 1.0]])
    C = run(world, *sensor, SUNS, replicates=16, paths=256, photons=4096)
    for sun in (0.0, SUN):
        shown = luminance(both, outside(sun), LUMINANCES)
        picture = Picture(np.repeat(shown.mean[..., None], 3, axis=2), view)
        share = np.nan_to_num(picture.solid_angles() * picture.directions()[..., 2])
        E = (shown.mean * share).sum()
        expected = C[:, 0, :146] @ LUMINANCES + C[:, 0, 146] * sun
        error = expected.std(ddof=1) / 4
        print(f"{E:.1f} lx, expected {expected.mean():.1f} ± {error:.1f}")
        assert abs(E - expected.mean()) < 0.02 * expected.mean() + 3 * error


def test_light_between_many_cells_reaches_the_picture():
    case, state = ROOMS["glazing with inner reflectance"]()
    world = scenes.load(case, state)
    both = [traced(world, solved=solved, samples=16, cell_size=0.2) for solved in (True, False)]
    assert both[0].light.cells > 1000
    by_cells, by_paths = (luminance(one, outside(0.0), LUMINANCES).mean.mean() for one in both)
    assert abs(by_cells / by_paths - 1) < 0.03
