"""Pictures for a screen: exposure, the eye's curve, false colours."""

import numpy as np
import pytest
from matplotlib.image import imread

from drcmitsuba.picture import Picture, tone
from drcmitsuba.picture.false_colour import false_colour, save_png
from drcmitsuba.report import style
from drcmitsuba.runtime.errors import InputError
from tests.unit.picture.made_pictures import disk, fisheye, window


def grey(luminances):
    values = np.asarray(luminances, np.float32)
    return Picture(np.repeat(np.atleast_2d(values)[..., None], 3, axis=2))


def test_white_is_255_half_of_it_188_and_brighter_is_cut_off():
    pixels = tone.exposed(grey([0, 50, 100, 1e6]), white=100)
    np.testing.assert_array_equal(pixels[0, :, 1], [0, 188, 255, 255])
    assert (np.ptp(pixels.astype(int), axis=2) <= 1).all()


def test_the_brightest_fiftieth_is_cut_off_by_default():
    pixels = tone.exposed(grey(np.linspace(1, 100, 1000)))
    assert (pixels[..., 1] == 255).mean() == pytest.approx(0.02, abs=0.01)


def test_the_eye_sees_the_differences_that_ferwerda_measured():
    # Rods in the dark, their end, cones in daylight: thresholds of the paper's curve.
    np.testing.assert_allclose(np.log10(tone.threshold(np.array([1e-5]))), -2.86)
    np.testing.assert_allclose(tone.threshold(np.array([1000.0])), 1000 / 10**1.255)
    steps = tone.threshold(10.0 ** np.array([-3.94, -1.44, -0.0184, 1.9]))
    below = tone.threshold(10.0 ** (np.array([-3.94, -1.44, -0.0184, 1.9]) - 1e-6))
    np.testing.assert_allclose(steps, below, rtol=0.05)


def room_and_sky():
    return fisheye(window(-40, 40, 0, 50, 20_000), disk(60, -20, 20, 5), base=50, size=200)


def test_the_eye_sees_a_dark_room_and_the_sky_outside_at_once():
    made = room_and_sky()
    pixels = tone.human(made)[..., 1].astype(int)
    dark, room, outside = (pixels[np.isclose(made.luminance, L)] for L in (5, 50, 20_000))
    assert np.median(dark) < np.median(room) - 20 < np.median(outside) - 60
    assert np.median(tone.exposed(made)[..., 1][np.isclose(made.luminance, 50)]) < 20


def test_the_eyes_curve_never_falls_and_keeps_below_the_contrast_of_the_scene():
    luminance = np.geomspace(1, 1e5, 4000)
    made = grey(luminance.reshape(40, 100))
    pixels = tone.human(made)[..., 1].ravel().astype(float) / 255
    linear = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    screen = tone.BLACK + linear * (tone.WHITE - tone.BLACK)
    assert (np.diff(pixels) >= 0).all()
    rise = np.diff(np.log(screen[::200])) / np.diff(np.log(luminance[::200]))
    assert rise.max() < 1.2


def test_a_scene_of_one_luminance_or_none_is_shown():
    assert np.unique(tone.human(grey(np.full((9, 9), 700.0)))).size == 1
    assert (tone.human(grey(np.zeros((9, 9)))) == 0).all()
    assert (tone.exposed(grey(np.zeros((9, 9)))) == 0).all()


def test_false_colours_have_a_legend_in_candela(tmp_path):
    figure = false_colour(room_and_sky(), least=10, most=10_000, title="Office $1, 21 March 10:30")
    image, legend = figure.axes
    assert legend.get_ylabel() == "Luminance [cd/m²]"
    figure.canvas.draw()
    assert {"10", "100", "1,000", "10,000"} <= {t.get_text() for t in legend.get_yticklabels()}
    assert image.get_title() == "Office $1, 21 March 10:30"
    assert style.save(figure, tmp_path / "a.png").is_file()


def test_a_png_holds_the_pixels(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 256, (7, 9, 3), dtype=np.uint8)
    save_png(pixels, tmp_path / "a.png")
    np.testing.assert_array_equal(np.round(255 * imread(tmp_path / "a.png"))[..., :3], pixels)


def test_unfit_scales_are_refused_in_one_line():
    with pytest.raises(InputError, match="white: 0"):
        tone.exposed(grey([1.0]), white=0)
    with pytest.raises(InputError, match="scale: 100 to 10"):
        false_colour(grey([1.0, 2.0]), least=100, most=10)
    with pytest.raises(InputError, match="no light"):
        false_colour(grey([0.0]))
