"""Films as an eye sees them: their glow, the suns of their peaks, and the illuminance of both."""

from dataclasses import replace

import numpy as np
import pytest
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.annual.run import Run
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import at_eyes, places
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests import ROOT
from tests.unit.glare_year.glare_room import by_suns, case_in, sum_over
from tests.unit.plugins.measured_files import xml

PRISM = ROOT / "scenes" / "films" / "prism.xml"
BASIS = "LBNL/Klems Full"
FILM = """
[materials.film]
type = "bsdf"
file = "{file}"
"""
LAMBERTIAN, PEAK = 0.3, 0.4
"""Transmittances of a film that scatters evenly, and of a peak that sends light straight on."""


def klems(folder, *, through=0.0, lifted=0.0):
    """A film that scatters evenly, with a straight-through peak or one 20° above it."""
    basis = BASES[BASIS]
    own = np.arange(len(basis))
    matrix = np.full((len(basis), len(basis)), LAMBERTIAN / np.pi)
    matrix[own, own] += through / basis.projected_solid_angle
    if lifted:  # into one cell, whatever the incidence
        matrix[5] += lifted / basis.projected_solid_angle[5]
    data = " ".join(f"{v:.6g}" for v in matrix.ravel())
    path = folder / "film.xml"
    path.write_text(xml("Columns", {"tf": data, "tb": data}, BASIS))
    return path


def opened(folder, file):
    """Case, daylight, eyes and the open state of an office with a film for a window."""
    case = case_in(folder, material="film", more=FILM.format(file=file))
    backend.select()
    light, looking = daylight(case), eyes(case)
    run = Run.of(case, plan(case, light).scope)
    illuminance = at_eyes(case, "open", light, looking, run)
    (place,) = places(case, "open", light, looking, run)
    return case, light, looking, place, illuminance


@pytest.mark.parametrize(
    "name", [pytest.param("prism", marks=pytest.mark.slow), "even with a view through"]
)
def test_the_glow_adds_up_to_the_illuminance_at_the_eye(name, tmp_path):
    file = PRISM if name == "prism" else klems(tmp_path, through=PEAK)
    _, _, looking, place, illuminance = opened(tmp_path, file)
    known = place.known
    L = known.at(np.arange(6))
    for i, forward in enumerate(looking.forward):
        Ev = illuminance[:, :, i]
        error = Ev.std(axis=0, ddof=1) / np.sqrt(len(Ev))
        mean = Ev.mean(axis=0)
        difference = sum_over(known.seen, L, forward) + by_suns(known, forward) - mean
        assert (np.abs(difference) < 5 * error + 0.03 * mean).all()
        assert abs(difference.sum()) < 0.015 * mean.sum() + 5 * np.hypot.reduce(error)
    if name != "prism":
        assert by_suns(known, looking.forward[0]).max() > 1000


def test_an_even_film_glows_by_its_illuminance(tmp_path):
    _, light, _, place, _ = opened(tmp_path, klems(tmp_path))
    known = place.known
    films = known.seen.films
    L = known.at(np.arange(6))[films]
    sun = light.sky["sun_direction"].values @ np.array([0, -1.0, 0])
    omega = disk_solid_angle(light.sky.attrs["sun_diameter"])
    direct = light.sky["sun"].values * omega * np.maximum(sun, 0)
    D = known.seen.glow.sky.mean(axis=0) * np.pi / LAMBERTIAN  # of the vertical plane outside
    assert D.sum() == pytest.approx(np.pi, rel=2e-3)
    expected = LAMBERTIAN / np.pi * (light.sky["sky"].values @ D + direct)
    np.testing.assert_allclose(L.mean(axis=0), expected, rtol=5e-3)
    assert not known.seen.glow.sharpness.any()


@pytest.mark.slow
def test_a_peak_as_narrow_as_the_sun_raises_the_sum_by_the_ratio_of_solid_angles(tmp_path):
    case, light, _, place, _ = opened(tmp_path, klems(tmp_path, lifted=PEAK))
    glow, basis = place.known.seen.glow, BASES[BASIS]
    peaks = glow.sharpness > 0
    assert peaks.any()
    cosine = basis.centres[5][2]
    ratio = basis.projected_solid_angle[5] / cosine / disk_solid_angle(case.outside.sun_diameter)
    np.testing.assert_allclose(glow.sharpness[peaks], ratio, rtol=0.05)
    by_file, sharp = place.sums(Rule(), np.arange(light.sky.sizes["time"]))
    assert (sharp >= by_file).all()
    assert (sharp > 10 * by_file).any()
    even = replace(glow, sharpness=np.zeros_like(glow.sharpness))
    known = replace(place.known, seen=replace(place.known.seen, glow=even))
    np.testing.assert_allclose(
        replace(place, known=known).sums(Rule(), np.arange(6))[1], by_file, rtol=1e-5
    )  # Float32 sums by atomics
