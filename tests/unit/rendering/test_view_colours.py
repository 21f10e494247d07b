"""Pictures in true colour: luminances of many rays, chromaticities of few in each band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba import picture
from drcmitsuba.case.colour import Colour
from drcmitsuba.colour.bands import TRISTIMULUS, Bands, colour
from drcmitsuba.colour.spectra import of_rgb
from drcmitsuba.picture.exr_header import BT709
from drcmitsuba.picture.picture import to_xyz
from drcmitsuba.rendering import Sampling, prepare, render
from drcmitsuba.rendering.view_colours import ViewBands
from tests.fast import slowly
from tests.unit.colour.rooms import box

D65 = {"sky": 6504.0, "sun": 6504.0}
NOON = "03-21 12:00"
FEW = Sampling(samples=6, paths=8, sky=4)
WHITE = to_xyz(BT709).sum(axis=1)
RED = (0.5, 0.12, 0.1)
BRICK = (0.4, 0.25, 0.2)
OUT = {"desk": {"position": [2.0, 3.5, 1.2], "direction": [0, -1, 0.2], "kind": "perspective",
                "angle": 80}}  # fmt: skip


def room(views=OUT, bands=9, colours=D65, spectra=None, **tables):
    case = box(views=views, **tables)
    return case.with_tables(colour=Colour(bands=bands, spectra=spectra or {}, **colours))


def xy(shown):
    """Chromaticities of the pixels (row, column, 2)."""
    xyz = shown.picture.rgb @ to_xyz(BT709).T
    return xyz[..., :2] / np.maximum(xyz.sum(axis=-1, keepdims=True), 1e-9)


@pytest.mark.parametrize("source", slowly(["all", "sky", "sun"], "sky", "sun"))
def test_a_grey_room_under_d65_is_as_grey_as_by_luminance(source):
    views = [
        prepare(room(bands=bands), size=16, sampling=FEW).at(NOON, source)
        for bands in (9, "luminance")
    ]
    in_bands, by_luminance = views
    L = by_luminance.picture.luminance
    assert L.max() > 100
    np.testing.assert_allclose(in_bands.picture.luminance, L, rtol=1e-5)
    np.testing.assert_allclose(in_bands.picture.rgb, L[..., None] + np.zeros(3), rtol=1e-3)
    np.testing.assert_array_equal(in_bands.error, by_luminance.error)


def test_a_red_plate_beside_a_white_one_has_the_colour_of_its_spectrum_under_d65():
    # Plates in a black room see no surface that reflects: their colours are exact.
    plates = [
        {"name": name, "corner": [x, 1.0, 0.5], "size": [0.8, 0.8, 0.0], "reflectance": rho}
        for name, x, rho in (("red", 1.2, 0.2), ("white", 2.0, 0.8))
    ]
    above = {"down": {"position": [2.0, 1.4, 1.6], "direction": [0, 0, -1], "up": [0, 1, 0],
                      "kind": "perspective", "angle": 70}}  # fmt: skip
    black = {"size": [4.0, 4.0, 3.0], "floor": 0.0, "ceiling": 0.0, "walls": 0.0}
    case = room(above, room=black, furniture=plates, spectra={"red": RED})
    shown = render(case, time=NOON, size=24, sampling=FEW)
    got, L = xy(shown), shown.picture.luminance
    bands, spectrum = Bands.of(9), of_rgb(RED)
    weights = np.array([bands.weights(name) for name in TRISTIMULUS])
    red = WHITE * (weights @ spectrum.at(bands))
    columns = {"red": (slice(8, 16), slice(5, 10)), "white": (slice(8, 16), slice(14, 19))}
    assert all((L[at] > 0).all() for at in columns.values())
    of_red = red[:2] / red.sum()
    np.testing.assert_allclose(got[columns["red"]] - of_red, 0, atol=3e-4)
    np.testing.assert_allclose(got[columns["white"]] - WHITE[:2] / WHITE.sum(), 0, atol=3e-4)
    # Nine bands have the colour that the surface was given.
    of_rgb_ = to_xyz(BT709) @ RED
    np.testing.assert_allclose(of_red, of_rgb_[:2] / of_rgb_.sum(), atol=0.004)
    np.testing.assert_allclose(
        L[columns["red"]].mean() / L[columns["white"]].mean(), 0.25, rtol=0.1
    )


def test_the_sky_has_the_colour_temperature_of_its_model():
    clear = {"model": "cie", "type": "clear"}
    hole = {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "open"}]}}
    colours = {"sky": "chain", "sun": "spectrl2"}
    up = {"desk": {"position": [2.0, 0.3, 1.2], "direction": [0, -1, 0.6], "kind": "perspective",
                   "angle": 30}}  # fmt: skip
    case = room(up, colours=colours, sky=clear, facade=hole)
    shown = render(case, time=NOON, size=12, sampling=FEW)
    middle = (slice(3, 9), slice(3, 9))
    L, at = shown.picture.luminance[middle].ravel(), xy(shown)[middle].reshape(-1, 2)
    wanted = 1e6 / np.clip(59.77 * np.log10(L) - 132.1, 40, 250)
    got = colour.temperature.xy_to_CCT(at, method="Hernandez 1999")
    assert np.ptp(wanted) > 500
    np.testing.assert_allclose(got, wanted, rtol=0.02)


@pytest.mark.slow
def test_light_between_coloured_surfaces_has_little_noise_of_colour():
    walls = {"wall east": RED, "wall west": (0.1, 0.2, 0.5)}
    plain = {"size": [4.0, 4.0, 3.0], "floor": 0.3, "ceiling": 0.8, "walls": 0.2}
    case = room(room=plain, spectra=walls)
    each = [
        render(case.with_tables(accuracy=case.accuracy.model_copy(update={"seed": seed})),
               time=NOON, size=32)
        for seed in (1, 2)
    ]  # fmt: skip
    of_ceiling = (slice(0, 4), slice(8, 24))
    red = [one.picture.rgb[..., 0] / one.picture.luminance for one in each]
    L = [one.picture.luminance for one in each]
    colours, light = (np.std(np.log(a / b)[of_ceiling]) for a, b in (red, L))
    assert colours < 0.5 * light
    assert np.mean(np.log(red[0] / red[1])[of_ceiling]) == pytest.approx(0, abs=0.02)


@pytest.mark.slow
def test_stored_light_paths_of_bands_give_the_same_picture(tmp_path):
    case = room(spectra={"floor": BRICK})
    first, again = (prepare(case, size=8, sampling=FEW, folder=tmp_path).at(NOON) for _ in range(2))
    np.testing.assert_array_equal(first.picture.rgb, again.picture.rgb)
    folders = tmp_path / "desk_light_paths"
    assert {p.name for p in folders.iterdir()} == {"channel_0", *(f"band_{k}" for k in range(9))}
    others = room(spectra={"floor": (0.2, 0.25, 0.3)})
    kept = [ViewBands.of(one, ["open"]).tints.content for one in (case, others)]
    assert kept[0] != kept[1]  # so that paths of other spectra are traced anew


def test_files_state_primaries_and_white_and_remarks_tell_what_they_cannot_hold(tmp_path):
    case = room(spectra={"floor": BRICK})
    shown = render(case, time=NOON, size=8, sampling=FEW)
    rgb = shown.picture.rgb.copy()
    rgb[0, 0] = (500.0, 100.0, -50.0)
    made = picture.Picture(rgb, shown.picture.view, BT709)
    told = []
    exr, hdr, _ = replace(shown, picture=made).save(tmp_path, remark=told.append)
    assert any("1.6 % of the pixels are too colourful for BT.709" in text for text in told)
    assert b"PRIMARIES= 0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329" in hdr.read_bytes()
    kept = picture.read(exr)
    np.testing.assert_allclose(kept.primaries, BT709, rtol=1e-6)
    np.testing.assert_array_equal(kept.rgb[0, 0], rgb[0, 0])
    raw = exr.read_bytes()
    assert b"whiteLuminance" in raw
    assert b"chromaticities" in raw
