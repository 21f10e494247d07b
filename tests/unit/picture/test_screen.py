"""Screens: their spaces, colours that they do not reach, and light that they show as white."""

import io

import numpy as np
import pytest
from PIL import Image, ImageCms

from drcmitsuba.colour.bands import colour
from drcmitsuba.picture import Picture
from drcmitsuba.picture.exr_header import BT709
from drcmitsuba.picture.false_colour import save_png
from drcmitsuba.picture.picture import to_xyz
from drcmitsuba.picture.screen import (
    D50,
    D65_TO_D50,
    DISPLAY_P3,
    P3_IN_D50,
    SRGB,
    Screen,
    display_p3,
    parsed_white,
)
from drcmitsuba.runtime.errors import InputError

P3 = Screen("display-p3")


def of(rgb):
    """Picture of linear BT.709 colours of a luminance of white of 1 cd/m²."""
    return Picture(np.atleast_3d(np.asarray(rgb, np.float32)).reshape(1, -1, 3), primaries=BT709)


def linear(pixels):
    return colour.models.eotf_sRGB(pixels / 255)


@pytest.mark.parametrize("screen", [SRGB, P3])
def test_colours_of_a_screen_are_those_of_colour_science(screen):
    rgb = np.random.default_rng(1).uniform(0, 1, (500, 3))
    made = of(rgb)
    shown = screen.show(made, made.luminance)
    name = {"srgb": "sRGB", "display-p3": "Display P3"}[screen.space]
    space = colour.RGB_COLOURSPACES[name]
    wanted = space.cctf_encoding(colour.RGB_to_RGB(rgb, "sRGB", space))
    assert np.abs(shown.pixels[0] - 255 * wanted).max() <= 1
    assert shown.moved == 0


def test_a_colour_of_srgb_comes_back_from_p3_by_its_profile():
    rgb = np.random.default_rng(2).uniform(0.02, 1, (200, 3))
    made = of(rgb)
    image = Image.fromarray(P3.show(made, made.luminance).pixels)
    there = ImageCms.ImageCmsProfile(io.BytesIO(display_p3()))
    back = ImageCms.profileToProfile(image, there, ImageCms.createProfile("sRGB"))
    apart = np.asarray(back).astype(int) - SRGB.show(made, made.luminance).pixels
    assert np.abs(apart).max() <= 3  # 8 bits twice, and the tables of the program
    assert np.abs(apart).mean() < 0.5


def test_the_profile_has_the_primaries_of_display_p3_in_d50():
    adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        to_xyz(BT709).sum(axis=1), D50, transform="Bradford"
    )
    np.testing.assert_allclose(D65_TO_D50, adapted, atol=3e-4)
    np.testing.assert_allclose(np.transpose(P3_IN_D50), adapted @ to_xyz(DISPLAY_P3), atol=3e-4)


@pytest.mark.parametrize("screen", [SRGB, P3])
def test_a_colour_beyond_the_screen_keeps_luminance_and_hue(screen):
    rgb = np.array([[1.6, 0.1, 0.05], [-0.2, 0.6, 0.1], [0.9, 0.9, -0.3], [0.1, -0.1, 3.0]])
    made = of(rgb)
    shown = screen.show(made, made.luminance)
    assert shown.moved == 1
    xyz = linear(shown.pixels[0]) @ to_xyz(screen.primaries).T
    np.testing.assert_allclose(xyz[:, 1], made.luminance[0], atol=0.006)
    white = to_xyz(BT709).sum(axis=1)
    before, after = (
        v / v.sum(axis=1, keepdims=True) - white / white.sum() for v in (rgb @ to_xyz(BT709).T, xyz)
    )  # from white in the diagram, where a hue is a direction
    turned = np.arctan2(before[:, 0], before[:, 1]) - np.arctan2(after[:, 0], after[:, 1])
    assert np.abs(np.degrees(turned)).max() < 1.5  # of 8 bits


def test_light_brighter_than_white_is_white_and_does_not_count_as_moved():
    shown = SRGB.show(of([[3.0, 2.0, 1.5], [0.3, 0.3, 0.3]]), np.array([[2.0, 0.3]]))
    assert (shown.pixels[0, 0] == 255).all()
    assert shown.moved == 0


def test_light_of_4000_k_is_neutral_in_a_view_of_it_and_under_a_white_of_4000_k():
    x, y = colour.temperature.CCT_to_xy_CIE_D(4000)
    warm = np.linalg.solve(to_xyz(BT709), [x / y, 1, (1 - x - y) / y])
    made = of(warm * np.array([[0.1], [0.4], [0.9]]))
    as_is = SRGB.show(made, made.luminance)
    assert as_is.pixels[0, 1, 0] > as_is.pixels[0, 1, 2] + 40
    for white in ("view", 4000.0):
        shown = Screen(white=white).show(made, made.luminance)
        assert np.ptp(shown.pixels[0].astype(int), axis=1).max() <= 1
        np.testing.assert_allclose(linear(shown.pixels[0])[:, 1], made.luminance[0], atol=0.006)
        np.testing.assert_allclose(shown.white, (x, y), atol=1e-4)


def test_files_state_their_space(tmp_path):
    pixels = np.zeros((2, 3, 3), np.uint8)
    for screen in (SRGB, P3):
        save_png(pixels, tmp_path / f"{screen.space}.png", screen)
    assert b"sRGB" in (tmp_path / "srgb.png").read_bytes()
    with Image.open(tmp_path / "display-p3.png") as image:
        assert image.info["icc_profile"] == display_p3()
    profile = ImageCms.ImageCmsProfile(io.BytesIO(display_p3()))
    assert ImageCms.getProfileDescription(profile).strip() == "Display P3"


@pytest.mark.parametrize("text", ["warm", "100", "30000", "nan"])
def test_an_unfit_white_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="white"):
        Screen(white=parsed_white(text))


def test_whites_are_read():
    assert [parsed_white(t) for t in ("daylight", "view", "4000K")] == ["daylight", "view", 4000]
