"""Spectra of sources: published temperatures of skies, red low suns, light on the ground."""

from __future__ import annotations

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.case.colour import Colour
from drcmitsuba.case.sky import CieTable
from drcmitsuba.colour import sources
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.sources import SourceSpectra, sky_temperatures, sun_spectra
from drcmitsuba.plan.notes import colour_notes
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.daylight import Daylight, daylight
from tests.unit.colour.rooms import box

BANDS = Bands.of(9)


@pytest.fixture(scope="module")
def case() -> Case:
    backend.select()
    return box()


@pytest.fixture(scope="module")
def light(case) -> Daylight:
    return daylight(case)


def of_sky(case: Case, type_: int) -> Case:
    return case.with_tables(
        sky=CieTable(model="cie", type=type_, diffuse_horizontal_illuminance=15_000.0),
        period=case.period.model_copy(
            update={"timestamps": None, "hours": (12, 13), "months": [6]}
        ),
    )


def test_a_clear_sky_has_the_temperatures_of_chains_formula(case):
    clear = of_sky(case, 12)
    light = daylight(clear)
    L = light.sky["sky"].values[:, 1:]
    expected = np.clip(1e6 / (59.77 * np.log10(L) - 132.1), 4000, 25_000)
    assert sky_temperatures(clear, light) == pytest.approx(expected, rel=1e-9)


def test_an_overcast_sky_has_one_temperature(case):
    overcast = of_sky(case, 3)
    assert sky_temperatures(overcast, daylight(overcast)) == pytest.approx(6514)


def test_takagi_is_bluer_for_dark_patches_and_ends_at_6500_K(case):
    other = of_sky(case, 12).with_tables(colour=Colour(bands=9, sky="takagi"))
    light = daylight(other)
    L, T = light.sky["sky"].values[:, 1:].ravel(), sky_temperatures(other, light).ravel()
    order = np.argsort(L)
    assert (np.diff(T[order]) <= 1e-6).all()
    assert T.min() > 6500


def test_one_temperature_for_all_is_a_phase_of_daylight(case, light):
    grey = case.with_tables(colour=Colour(bands=9, sky=6504.0, sun=6504.0))
    spectra = SourceSpectra.of(grey, light, BANDS)
    for band in (0, 4, 8):
        sky = spectra.of_band(light.sky, band)
        # D65 as CIE tabulates it, beside the phase that its formula gives at 6504 K.
        for name in ("sky", "sun"):
            assert sky[name].values == pytest.approx(light.sky[name].values, rel=5e-4)


@pytest.mark.parametrize("model", ["chain", "takagi"])
def test_light_of_all_bands_is_the_light_by_luminance(case, light, model):
    spectra = SourceSpectra.of(case.with_tables(colour=Colour(bands=9, sky=model)), light, BANDS)
    photopic = BANDS.weights("Y")
    for name in ("sky", "sun"):
        total = sum(w * spectra.of_band(light.sky, k)[name] for k, w in enumerate(photopic))
        assert total.values == pytest.approx(light.sky[name].values, rel=1e-5)


def test_a_low_sun_is_redder_and_its_turbidity_gives_the_illuminance(light):
    spectra = sun_spectra(light)
    up = light.sky["direct_normal_illuminance"].values > 3_000
    red_to_blue = spectra[:, sources.GRID == 650][:, 0] / spectra[:, sources.GRID == 450][:, 0]
    zenith = light.sun["solar_zenith"].values
    low, high = red_to_blue[up & (zenith > 72)], red_to_blue[up & (zenith < 50)]
    assert low.min() > high.max()
    E = sources.PHOTOPIC * (spectra @ sources.responses()["Y"]) * 5.0
    direct = light.sky["direct_normal_illuminance"].values
    # Suns that are dimmer than through the most turbid air shine through cloud, which is grey.
    ratio = E[up] / direct[up]
    assert ratio.min() > 0.999
    assert (ratio[direct[up] > 80_000] < 1.001).all()
    assert (ratio[direct[up] > 60_000] < 1.03).mean() > 0.85


def test_the_ground_has_the_mean_spectrum_of_what_lights_it(case, light):
    even = case.with_tables(colour=Colour(bands=9, sky=9000.0, sun=9000.0))
    spectra = SourceSpectra.of(even, light, BANDS)
    shining = light.sky["sky"].values.sum(axis=1) > 0
    assert spectra.ground[:, shining] == pytest.approx(spectra.sun[:, shining], rel=1e-5)


def test_measured_spectra_of_sky_and_sun(case, light, tmp_path):
    phases, at = sources.daylight_phases(), sources.MIREDS
    power = np.array([np.interp(1e6 / 9000, at, row) for row in phases])
    file = tmp_path / "sky.csv"
    file.write_text("\n".join(f"{w},{40 * p}" for w, p in zip(sources.GRID, power, strict=True)))
    of_file = case.with_tables(colour=Colour(bands=9, sky=file, sun=file))
    of_cct = case.with_tables(colour=Colour(bands=9, sky=9000.0, sun=9000.0))
    spectra = [SourceSpectra.of(c, light, BANDS) for c in (of_file, of_cct)]
    for band in (0, 4, 8):
        mine, known = (s.of_band(light.sky, band) for s in spectra)
        for name in ("sky", "sun"):
            assert mine[name].values == pytest.approx(known[name].values, rel=1e-3)


def test_a_source_without_light_is_refused(case, light, tmp_path):
    for spectrum in ("380,0\n780,0\n", "380,0\n400,0\n401,1\n402,0\n780,0\n"):
        (tmp_path / "dark.csv").write_text(spectrum)
        dark = case.with_tables(colour=Colour(bands=9, sun=tmp_path / "dark.csv"))
        with pytest.raises(InputError, match="no visible light"):
            SourceSpectra.of(dark, light, BANDS)
        with pytest.raises(InputError, match="no visible light"):
            colour_notes(dark)
    (tmp_path / "dark.csv").write_text("380,1e999\n780,1\n")
    with pytest.raises(InputError, match=r"dark\.csv"):
        colour_notes(dark)


def test_keys_that_only_bands_follow_are_told_without_them(case):
    grey = case.with_tables(colour=Colour(sky=4000.0, melanopic_threshold=400.0))
    (note,) = colour_notes(grey)
    assert note == "colour: sky, melanopic_threshold take part with bands = 9 or 27 alone"
    assert not colour_notes(case.with_tables(colour=Colour()))
