"""DGP, UGR and DGI of twelve pictures by `evalglare` and by this package, with the same options.

The pictures differ in projection, size, exposure, number of sources and options. Two things differ
in the program: the place of a source is cut down to whole pixels, and pixels at the edge of `-vth`
have other solid angles, so that the mean luminance is 2.7 % off at 600 by 600 pixels. DGP hardly
sees either.
"""

import re

import pytest

from drcmitsuba import picture
from drcmitsuba.picture import hdr
from drcmitsuba.picture.glare import glare
from tests import SHARED, radiance, skips
from tests.unit.picture.made_pictures import disk, fisheye, halo, sky, window

pytestmark = skips.RADIANCE.mark
TESTIMAGE = SHARED / "data" / "pictures" / "evalglare_testimage.hdr"
MADE = {
    "overcast": (lambda: fisheye(sky(3000), base=300), {}),
    "clear sky with the sun": (
        lambda: fisheye(sky(1500), halo(15, 35, 6, 8000), disk(15, 35, 1.5, 2e5), base=900), {},
    ),
    "a window": (lambda: fisheye(window(-30, 20, -5, 35, 6000), base=250), {}),
    "a window with the sun in it": (
        lambda: fisheye(window(-30, 30, 0, 40, 4000), disk(-10, 25, 1, 3e6), size=400), {},
    ),
    "five windows": (
        lambda: fisheye(*(window(a, a + 16, 0, 25, 3000 + 40 * a) for a in range(-70, 70, 28))), {},
    ),
    "a lit desk": (
        lambda: fisheye(window(20, 60, -40, -10, 7000), disk(-50, -60, 4, 30_000), base=400), {},
    ),
    "dim, three lamps": (
        lambda: fisheye(*(disk(a, 30, 2, 9000) for a in (-40, 0, 55)), base=40), {},
    ),
    "at the edge": (lambda: fisheye(window(60, 89, -10, 30, 12_000), size=300, base=600), {}),
    "hemispherical": (
        lambda: fisheye(
            window(-40, 10, 0, 30, 5000), disk(30, 40, 2, 2e5), size=600, kind="hemispherical",
            base=350,
        ), {},
    ),
    "a multiple of the mean": (
        lambda: fisheye(sky(800), window(-20, 20, 5, 30, 9000), base=200),
        {"threshold": 5.0},
    ),
    "wide opening, no peaks": (
        lambda: fisheye(
            window(-50, -20, 0, 20, 4000), window(0, 30, 0, 20, 3000), disk(10, 10, 1, 1e6)
        ),
        {"opening": 0.8, "peak": float("inf")},
    ),
}  # fmt: skip


def by_evalglare(made, folder, options, exposure=1.0):
    """Results by their names, of the picture as it comes back from its file."""
    hdr.save(made, folder / "made.hdr", exposure)
    return results(folder, "made.hdr", options)


def results(folder, file, options):
    words = []
    if "threshold" in options:
        words += ["-b", str(options["threshold"])]
    if "opening" in options:
        words += ["-r", str(options["opening"])]
    if "peak" in options:
        words += ["-x"]
    text = radiance.run(["evalglare", "-d", *words, str(file)], folder).decode()
    names, values = re.search(r"^(dgp,.*): (.*)$", text, re.MULTILINE).groups()
    return dict(zip(names.split(","), map(float, values.split()), strict=True))


@pytest.mark.parametrize("name", MADE)
def test_glare_of_made_pictures_is_that_of_evalglare(name, tmp_path):
    make, options = MADE[name]
    theirs = by_evalglare(make(), tmp_path, options, exposure=1 / len(name))
    ours = glare(picture.read(tmp_path / "made.hdr"), **options)
    print(f"{name}: {ours.dgp():.4f} {theirs['dgp']:.4f} {ours.ugr:.2f} {theirs['ugr']:.2f}")
    assert ours.dgp() == pytest.approx(theirs["dgp"], abs=0.005)
    assert ours.illuminance == pytest.approx(theirs["E_v"], rel=5e-3)
    off = 0.03 if name == "hemispherical" else 5e-3
    assert ours.mean_luminance == pytest.approx(theirs["av_lum"], rel=off)
    if len(ours.sources):
        assert ours.ugr == pytest.approx(theirs["ugr"], abs=0.35)
        assert ours.dgi == pytest.approx(theirs["dgi"], abs=0.35)
        assert ours.sources.solid_angle.sum() == pytest.approx(theirs["omega_sources"], rel=5e-3)


@skips.needs(TESTIMAGE)
def test_glare_of_its_own_test_picture_is_that_of_evalglare(tmp_path):
    ours = glare(picture.read(TESTIMAGE))
    assert ours.dgp() == pytest.approx(0.530615, abs=5e-4)
    theirs = results(tmp_path, TESTIMAGE, {})
    assert ours.dgp() == pytest.approx(theirs["dgp"], abs=5e-4)
    assert ours.ugr == pytest.approx(theirs["ugr"], abs=0.05)
    assert len(ours.sources) == 3
