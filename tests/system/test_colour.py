"""A year by bands: grey rooms under D65, rooms of one band, files, pictures, one-line errors."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import evaluate
from drcmitsuba.annual.result import Result
from drcmitsuba.case.case import Case
from drcmitsuba.case.colour import Colour
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.spectra import of_rgb
from drcmitsuba.colour.tints import Tints
from drcmitsuba.runtime.errors import InputError
from tests import ROOT
from tests.unit.colour.rooms import box, surface

SHADE = {
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.6},
        "shade": {"type": "diffuser", "transmittance": 0.1},
    },
    "shading": {"material": "shade"},
}
DESK = {"desk": {"position": [2.0, 2.0, 1.2], "direction": [0, 1, 0]}}
D65 = {"sky": 6504.0, "sun": 6504.0}


@pytest.fixture(scope="module")
def grey() -> Result:
    """Grey room with a shade under light like D65."""
    return evaluate(box(**SHADE, views=DESK, colour={"bands": 9, **D65}))


def test_light_of_d65_stays_d65_in_a_grey_room(grey):
    total = grey.illuminance["total"].values
    assert grey.spectral is not None
    for name in ("melanopic", "s_cone_opic", "m_cone_opic", "l_cone_opic", "rhodopic"):
        assert grey.spectral[name].values == pytest.approx(total, rel=1e-3)
    lit = total > 1
    for name, expected in (("chromaticity_x", 0.3127), ("chromaticity_y", 0.3290)):
        assert grey.spectral[name].values[lit] == pytest.approx(expected, abs=3e-4)
    assert grey.spectral["cct"].values[lit] == pytest.approx(6504, abs=25)
    assert grey.spectral["duv"].values[lit] == pytest.approx(0.0032, abs=3e-4)
    at_view = grey.spectral["melanopic_at_views"].values
    assert at_view == pytest.approx(grey.spectral["illuminance_at_views"].values, rel=1e-3)


def test_colour_of_d65_is_told(grey):
    told = grey.metrics["melanopic"]
    for each in (told, told["views"]["desk"]):
        assert each["ratio"] == pytest.approx(1, abs=1e-3)
        assert each["cct"] == pytest.approx(6504, abs=15)
        assert each["duv"] == pytest.approx(0.0032, abs=3e-4)
        assert each["fidelity"] == pytest.approx(100, abs=0.5)
        assert each["gamut"] == pytest.approx(100, abs=0.5)


def test_the_year_by_luminance_is_that_without_bands(grey):
    plain = evaluate(box(**SHADE, views=DESK))
    xr.testing.assert_equal(plain.illuminance, grey.illuminance)
    assert plain.metrics["sDA"] == grey.metrics["sDA"]


def in_band(case: Case, band: int) -> Case:
    """Grey case whose surfaces have the amounts of a band."""
    tints = Tints(case, Bands.of(9))
    room, glass = case.room, case.materials["glass"]
    assert room is not None
    from drcmitsuba.model.materials import Lambertian

    values = {
        name: tints.of(band, surface(part, Lambertian(getattr(room, name)))).reflectance
        for name, part in (("floor", "floor"), ("ceiling", "ceiling"), ("walls", "wall north"))
    }
    return case.with_tables(
        room=room.model_copy(update=values),
        materials={"glass": tints.of(band, surface("glass south", glass))},
        colour=Colour(),
    )


def test_bands_are_rooms_of_their_reflectances():
    """The melanopic response is the weighted sum of evaluations of grey rooms, by other numbers."""
    spectra = {"floor": (0.5, 0.3, 0.15), "walls": (0.6, 0.5, 0.35), "glass": (0.5, 0.7, 0.6)}
    colour = {"bands": 9, "spectra": {k: list(v) for k, v in spectra.items()}, **D65}
    # Replicates of one seed err alike at some hours, those of the default one beyond the bound.
    case = box(colour=colour, accuracy={"seed": 5})
    result, weights = evaluate(case), Bands.of(9).weights("melanopic")
    years = [evaluate(in_band(case, k)).illuminance for k in range(9)]
    expected = sum(w * E["total"].values for w, E in zip(weights, years, strict=True))
    variance = sum((w * E["total_se"].values) ** 2 for w, E in zip(weights, years, strict=True))
    assert result.spectral is not None
    M, error = (result.spectral[n].values for n in ("melanopic", "melanopic_se"))
    # Rooms of all bands have the same random numbers: their errors add up at worst.
    both = np.sqrt(error**2 + 9 * variance)
    assert M.sum() == pytest.approx(expected.sum(), rel=0.004)
    assert (np.abs(M - expected) < 4 * both + 0.02).mean() > 0.999
    assert result.metrics["melanopic"]["ratio"] == pytest.approx(
        expected.sum() / result.illuminance["total"].values.sum(), rel=0.004
    )


@pytest.mark.slow
def test_27_bands_agree_with_9():
    spectra = {"floor": [0.5, 0.3, 0.15], "walls": [0.6, 0.5, 0.35]}
    ratios = [
        evaluate(box(colour={"bands": n, "spectra": spectra})).metrics["melanopic"]["ratio"]
        for n in (9, 27)
    ]
    assert ratios[0] == pytest.approx(ratios[1], rel=0.005)


def test_files_hold_what_the_result_does(grey, tmp_path, drawn):
    grey.save(tmp_path)
    with xr.open_dataset(tmp_path / "colour.nc") as saved:
        xr.testing.assert_allclose(saved["melanopic"], grey.spectral["melanopic"])
        assert saved["melanopic"].attrs["units"] == "lx"
    told = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))["melanopic"]
    assert told == json.loads(json.dumps(grey.metrics["melanopic"]))
    assert (tmp_path / "melanopic_plan.png").stat().st_size > 5_000


@pytest.mark.parametrize(
    ("colour", "words"),
    [
        ({"bands": 8}, "colour.bands"),
        ({"bands": 9, "sky": 3000.0}, "colour.sky"),
        ({"bands": 9, "spectra": {"wals": [0.5, 0.4, 0.3]}}, "colour.spectra.wals"),
        ({"bands": 9, "spectra": {"ceiling": [0.5, 0.05, 0.05]}}, "would be"),
        ({"bands": 9, "spectra": {"floor": "none.csv"}}, "no such file"),
    ],
)
def test_unfit_colours_are_refused_in_one_line(colour, words):
    with pytest.raises(InputError) as caught:
        evaluate(box(colour=colour))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_report_shows_melanopic_light_and_its_rules(grey):
    page = grey.report().markdown()
    assert "## Melanopic light" in page
    assert "WELL v2 L03, 1 point" in page
    told = grey.metrics["melanopic"]["views"]["desk"]["rules"]["WELL v2 L03, 1 point"]
    words = {"yes": "met", "no": "not met", "open": "open"}
    assert f"| {words[told['met']]}, {told['mornings']['value']:.1f}" in page


def test_a_tinted_film_in_a_grey_room_tints_all_light():
    """Light that passed one film has its spectrum, whatever happened to it before and after."""
    film = str(ROOT / "scenes" / "films" / "prism.xml")
    tint = [0.4, 0.6, 0.5]
    case = box(
        materials={"glass": {"type": "bsdf", "file": film}},
        colour={"bands": 9, **D65, "spectra": {"glass": tint}},
        effects={"interreflection": "off"},  # the film reflects, tinted, too
    )
    result, bands = evaluate(case), Bands.of(9)
    values = of_rgb(tint).at(bands)
    expected = bands.weights("melanopic") @ values / (bands.weights("Y") @ values)
    E, M = result.illuminance["total"].values, result.spectral["melanopic"].values
    lit = 0.01 * E.max() < E
    assert M[lit] == pytest.approx(expected * E[lit], rel=2e-3)


def test_a_white_furnace_stays_white_in_every_band():
    """A white room open to a world of one luminance has this luminance everywhere: E = π L."""
    white = {"size": [4.0, 4.0, 3.0], "floor": [1.0, 1.0, 1.0], "ceiling": 1.0, "walls": 1.0}
    E = 10_000.0
    case = box(
        room=white,
        facade={"south": {"strips": [{"bottom": 0.5, "top": 2.7, "material": "open"}],
                          "frame_reflectance": 1.0}},
        materials={},
        sky={"model": "cie", "type": 5, "diffuse_horizontal_illuminance": E},
        outside={"ground_reflectance": 1.0},
        period={"months": [6], "hours": [12, 13]},
        colour={"bands": 9, **D65, "spectra": {"walls": [1.0, 1.0, 1.0]}},
    )  # fmt: skip
    result = evaluate(case)
    assert result.spectral is not None
    sky, error = (result.illuminance[name].values[0] for name in ("sky_open", "sky_open_se"))
    assert (np.abs(sky - E) < 5 * error).all()
    assert sky.mean() == pytest.approx(E, rel=0.01)
    light = result.spectral["spectrum"].values
    assert light == pytest.approx(np.ones(light.shape), abs=1e-3)


def test_three_channels_of_a_grey_room_are_its_luminance():
    grey, rgb = (evaluate(box(colour={"bands": b})).illuminance for b in ("luminance", "rgb"))
    assert rgb.sizes["channel"] == 3
    for channel in range(3):
        assert rgb["total"].values[channel] == pytest.approx(grey["total"].values, rel=1e-4)
