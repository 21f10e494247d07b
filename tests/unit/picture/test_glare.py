"""Glare of pictures: sources whose merging is countable, and the formulas on single sources."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.picture import Picture, PictureView
from drcmitsuba.picture.glare import EVALGLARE, PAPER, glare
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from tests.unit.picture.made_pictures import disk, fisheye


def pixels_apart(gap, size=240, peaks=False):
    """Two bright pixels on the horizon, a number of pixels of 0.75° from each other."""

    def draw(luminance, directions):
        if peaks:
            luminance[size // 2 - 30 : size // 2 + 30] = 5000
        luminance[size // 2, [60, 60 + gap]] = 1e6

    return fisheye(draw, size=size)


@pytest.mark.parametrize(("opening", "farthest"), [(0.1, 3), (0.2, 7), (0.4, 15)])
def test_pixels_within_half_the_opening_angle_are_one_source(opening, farthest):
    counts = [len(glare(pixels_apart(farthest + more), opening=opening).sources) for more in (0, 1)]
    assert counts == [1, 2]


def test_peaks_of_a_source_are_sources_of_their_own():
    apart = glare(pixels_apart(20, peaks=True)).sources
    near = glare(pixels_apart(5, peaks=True)).sources
    whole = glare(pixels_apart(20, peaks=True), peak=np.inf).sources
    assert (len(apart), len(near), len(whole)) == (3, 2, 1)
    np.testing.assert_allclose(apart.luminance, [5000, 1e6, 1e6], rtol=1e-5)
    np.testing.assert_allclose(apart.solid_angle.sum(), whole.solid_angle.sum())


@pytest.mark.parametrize("count", [30, 150, 400])
def test_sources_are_the_components_of_pixels_near_each_other(count):
    places = np.random.default_rng(count).integers(30, 170, (count, 2))

    def draw(luminance, directions):
        luminance[tuple(places.T)] = 20_000

    made = fisheye(draw, size=200)
    label = glare(made).sources.label
    points, number = made.directions()[label >= 0], label[label >= 0]
    near = np.arccos(np.clip(points @ points.T, -1, 1)) <= 0.1
    component = np.arange(len(points))  # the least number in reach, again and again
    while (least := np.where(near, component, len(points)).min(axis=1)).tolist() != (
        component.tolist()
    ):
        component = least
    assert len(set(zip(component, number, strict=True))) == len(set(number)) == len(set(component))


def test_a_window_has_its_solid_angle_luminance_and_place():
    made = fisheye(disk(30, 20, 5, 8000), size=600)
    seen = glare(made)
    (omega,), (luminance,), (direction,) = (
        seen.sources.solid_angle, seen.sources.luminance, seen.sources.direction
    )  # fmt: skip
    exact = 2 * np.pi * (1 - np.cos(np.radians(5)))
    assert omega == pytest.approx(exact, rel=0.01)
    assert luminance == pytest.approx(8000)
    azimuth, elevation = np.radians([30, 20])
    towards = [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation)]
    np.testing.assert_allclose(direction[:2], towards, atol=2e-3)
    facing = np.cos(azimuth) * np.cos(elevation)
    assert seen.illuminance == pytest.approx(500 * np.pi + 7500 * exact * facing, rel=2e-3)
    assert seen.background == pytest.approx(500, rel=0.02)


def test_the_formulas_of_one_source_are_those_of_the_papers():
    seen = glare(fisheye(disk(10, 20, 3, 30_000)))
    L, w = seen.sources.luminance[0], seen.sources.solid_angle[0]
    P, E = seen.sources.position_index[0], seen.illuminance
    contrast = np.log10(1 + L**2 * w / (E**1.87 * P**2))
    assert seen.dgp(PAPER) == pytest.approx(5.87e-5 * E + 0.0918 * contrast + 0.16)
    assert seen.dgp(EVALGLARE) == pytest.approx(5.87e-5 * E + 0.092 * contrast + 0.159)
    assert seen.ugr == pytest.approx(8 * np.log10(0.25 / seen.background * L**2 * w / P**2))
    dgi = 0.478 * L**1.6 * (w / P**2) ** 0.8 / (seen.background + 0.07 * np.sqrt(w) * L)
    assert seen.dgi == pytest.approx(10 * np.log10(dgi))
    assert seen.dgp(age=60) == pytest.approx(seen.dgp() / 0.8)


def test_dim_scenes_may_be_corrected():
    dim = glare(fisheye(disk(10, 20, 3, 5000), base=40))
    x = 0.024 * dim.illuminance - 4
    assert dim.dgp(low_light=True) == pytest.approx(dim.dgp() * np.exp(x) / (1 + np.exp(x)))
    bright = glare(fisheye(disk(10, 20, 3, 5000), base=1000))
    assert bright.dgp(low_light=True) == pytest.approx(bright.dgp())


def test_without_sources_only_the_illuminance_counts():
    seen = glare(fisheye(base=1000))
    assert len(seen.sources) == 0
    assert seen.dgp() == pytest.approx(5.87e-5 * 1000 * np.pi + 0.159, rel=1e-4)
    assert np.isnan([seen.ugr, seen.dgi]).all()
    assert glare(fisheye(base=20_000)).dgp() == 1


def test_a_small_threshold_multiplies_the_mean_luminance():
    seen = glare(fisheye(disk(10, 20, 3, 30_000)), threshold=3)
    assert seen.threshold == pytest.approx(3 * seen.mean_luminance)
    assert seen.mean_luminance == pytest.approx(
        500 + 29_500 * (1 - np.cos(np.radians(3))), rel=0.03
    )


def test_the_position_index_of_the_device_is_that_of_numpy():
    backend.select()
    d = np.random.default_rng(2).normal(size=(500, 3))
    d = np.vstack([d / np.linalg.norm(d, axis=1, keepdims=True), [[0, 0, 1]], [[0, 1, 0]]])
    on_device = position_index(mi.Vector3f(*d.T.astype(np.float32))).numpy()
    np.testing.assert_allclose(on_device, position_index(d), rtol=1e-5)


def test_the_position_index_is_1_in_the_line_of_sight_and_16_far_from_it():
    angles = np.radians([0, 1e-9, 89])
    up = np.stack([0 * angles, np.sin(angles), np.cos(angles)], axis=1)
    np.testing.assert_allclose(position_index(up), [1, 1, 16])
    # The two formulas meet at the line of sight within 1 %: 21.0006 and 6.4999 against 21 and 6.49.
    aside = np.stack([np.sin(0.5), 1e-12, np.cos(0.5)])
    np.testing.assert_allclose(position_index(aside), position_index(aside * [1, -1, 1]), rtol=1e-2)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"threshold": 0}, "threshold: 0"),
        ({"threshold": np.nan}, "threshold: nan"),
        ({"opening": 2}, "opening: 2"),
        ({"peak": -1}, "peak: -1"),
    ],
)
def test_unfit_parameters_are_refused_in_one_line(options, complaint):
    with pytest.raises(InputError, match=complaint):
        glare(fisheye(), **options)


def test_pictures_without_view_or_of_too_many_pixels_are_refused():
    with pytest.raises(InputError, match="view: none in the file"):
        glare(Picture(np.ones((4, 4, 3), np.float32)))
    view = PictureView("equidistant")
    given = glare(Picture(np.ones((4, 4, 3), np.float32)), view=view)
    assert given.illuminance == pytest.approx(np.pi, rel=0.1)
    with pytest.raises(InputError, match="size: 2100 by 1000"):
        glare(Picture(np.ones((1000, 2100, 3), np.float32), view))


def test_a_perspective_picture_with_black_corners_has_a_note():
    """Evalglare stops there: it is a fisheye picture whose view is wrong."""
    rgb = np.full((40, 40, 3), 1000.0, np.float32)
    view = PictureView("perspective", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (60.0, 60.0))
    assert glare(Picture(rgb, view)).notes == ()
    rgb[[0, 0, -1, -1], [0, -1, 0, -1]] = 0
    [note] = glare(Picture(rgb, view)).notes
    assert "the corners are black in a perspective view of 60° by 60°" in note
    assert glare(fisheye(disk(30, 20, 5, 8000), size=60)).notes == ()
