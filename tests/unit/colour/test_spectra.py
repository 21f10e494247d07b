"""Files of spectra: all forms are read, unfit ones refused; RGB and CIELAB keep their colour."""

from __future__ import annotations

import numpy as np
import pytest

from drcmitsuba.case.colour import Lab
from drcmitsuba.colour.bands import GRID, TRISTIMULUS, Bands, colour, d65, responses
from drcmitsuba.colour.spectra import Spectrum, of_lab, of_rgb, read_spectrum, smooth_mixes
from drcmitsuba.runtime.errors import InputError

BANDS = Bands.of(9)


def read(tmp_path, text: str) -> Spectrum:
    file = tmp_path / "s.csv"
    file.write_text(text, encoding="utf-8")
    return read_spectrum(file, BANDS)


@pytest.mark.parametrize(
    "text",
    [
        "wavelength,value\n380,0.2\n780,0.6\n",
        "380;0.2\r\n780;0.6\r\n",
        "# measured\n\n380 0.2\n780\t0.6",
        "{ Units, Wavelength Units } SI Microns\n{ Thickness } 6\n0.38 0.2\n0.78 0.6\n",
    ],
    ids=["csv", "semicolons", "blanks", "IGDB"],
)
def test_forms_of_one_spectrum(tmp_path, text):
    at = read(tmp_path, text).at(BANDS)
    expected = 0.2 + 0.4 * (np.array(BANDS.wavelengths) - 380) / 400
    assert at == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("450,0.2\n650,0.6\n", "450 to 650 nm; cover 413 to 665 nm"),
        ("380,20\n780,60\n", "in percent"),
        ("780,0.2\n380,0.6\n", "380 nm after a larger one"),
        ("380,-0.2\n780,0.6\n", "-0.2"),
        ("380,0.2\n500,x\n780,0.6\n", 'line 2: "500,x"'),
        ("380,0.2\n500\n", "line 2"),
        ("380,0.2\n500,0.2,0.3\n780,0.6\n", "3 numbers after lines of 2"),
        ("a spectrum\n", "0 of them"),
        ("380,0.2\n500,nan\n780,0.6\n", "line 2"),
        ("380,0.2,0.1\n500,0.9,0.2\n780,0.6,0.1\n", "add up to 1.1 at 500 nm"),
    ],
    ids=["short", "percent", "falling", "negative", "word", "one", "columns", "none", "nan", "sum"],
)
def test_unfit_files_are_refused_in_one_line(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def xyz_of(spectrum: Spectrum) -> np.ndarray:
    """Tristimulus values of a surface under D65, white has Y = 1."""
    light = d65()
    values = np.interp(GRID, spectrum.wavelengths, spectrum.values[:, 0])
    return np.array([responses()[n] @ (light * values) for n in TRISTIMULUS]) / (
        responses()["Y"] @ light
    )


@pytest.mark.parametrize("rgb", [(0.2, 0.4, 0.1), (0.9, 0.1, 0.05), (0.5, 0.5, 0.5), (1, 1, 1)])
def test_a_spectrum_of_rgb_has_this_rgb_under_d65(rgb):
    spectrum = of_rgb(rgb)
    back = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ xyz_of(spectrum)
    assert back == pytest.approx(rgb, abs=2e-3)
    assert spectrum.values.min() >= -1e-6
    assert spectrum.values.max() <= 1 + 1e-6


def test_lab_keeps_its_colour_and_is_refused_outside_srgb():
    spectrum = of_lab(Lab(lab=(60, 20, 30)), "case", "colour.spectra.walls")
    white = colour.CCS_ILLUMINANTS["cie_2_1931"]["D65"]
    assert colour.XYZ_to_Lab(xyz_of(spectrum), white) == pytest.approx([60, 20, 30], abs=0.3)
    with pytest.raises(InputError, match="outside sRGB"):
        of_lab(Lab(lab=(50, 120, -120)), "case", "colour.spectra.walls")


@pytest.mark.parametrize("count", [9, 27])
def test_mixes_of_a_film_have_its_colour(count):
    bands = Bands.of(count)
    mixes, rgb = smooth_mixes(bands), np.array([0.45, 0.4, 0.3])
    seen = [bands.weights(name) @ (mixes @ rgb) for name in TRISTIMULUS]
    matrix = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    assert seen == pytest.approx((matrix @ rgb / matrix.sum(axis=1)).tolist(), abs=1e-9)
    assert mixes.sum(axis=1) == pytest.approx(np.ones(count), abs=1e-9)
    assert mixes.min() >= 0  # saturated films lose nothing, and none sends on more than all light
