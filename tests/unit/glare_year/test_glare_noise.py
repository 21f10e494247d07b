"""Noise of bright surfaces: slopes of the sums of glare, and DGP by replicates."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.annual.run import Run
from drcmitsuba.glare_year import state, surface_light
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.luminance_noise import DIM
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import places
from drcmitsuba.glare_year.year import pseudo_values
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests.unit.glare_year.glare_room import TIMES, case_in

EACH = Rule(threshold=1200.0, opening=1e-4)
"""Rule that makes a source of every tile: no other luminances are mixed into it."""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Eyes, and the place of a room with sun patches."""
    case = case_in(tmp_path_factory.mktemp("office"))
    backend.select()
    light, looking = daylight(case), eyes(case)
    (seen,) = places(case, "open", light, looking, Run.of(case, plan(case, light).scope))
    return looking, seen


def test_the_sums_follow_the_luminances_of_each_replicate(place):
    looking, seen = place
    known, times = seen.known, np.arange(len(TIMES))
    lit, noise = known.surfaces, known.surfaces.noise
    bright = np.flatnonzero(lit.luminance > DIM)
    np.testing.assert_array_equal(noise.luminance, lit.luminance[bright])
    assert noise.deviation.shape == (4, len(bright))
    np.testing.assert_allclose(noise.deviation.sum(axis=0), 0, atol=1)
    by_noise = seen.deviations(EACH)
    assert by_noise.shape == (4, len(TIMES), len(looking))
    step, start, slopes = 1e-4, seen.sums(EACH, times)[0], []
    for deviation in noise.deviation:
        L = lit.luminance.copy()
        L[bright] += step * deviation
        moved = replace(seen, known=replace(known, surfaces=replace(lit, luminance=L)))
        slopes.append((moved.sums(EACH, times)[0] - start) / step)
    size = np.sqrt(np.mean(np.square(slopes)))
    assert size > 1e3
    # Tiles at the edge of the window hold sky and surface, which make one source; no luminance
    # crosses the threshold by so small a step.
    assert np.sqrt(np.mean((by_noise - slopes) ** 2)) < 0.15 * size


def test_surfaces_below_the_threshold_move_no_sum(place):
    _, seen = place
    assert not seen.deviations(Rule(threshold=1e6)).any()


def test_replicates_of_dgp_scatter_as_dgp_does():
    """A thousand sets of replicates: their means' scatter is the error that one set has."""
    rng, rule = np.random.default_rng(3), Rule()
    E = 3000 + 150 * rng.standard_normal((8, 1000))
    sums = 5e6 * (1 + 0.5 * rng.standard_normal((8, 1000)))
    mean = sums.mean(axis=0)
    each = pseudo_values(rule, E, mean, sums - mean)
    told = each.std(axis=0, ddof=1) / np.sqrt(8)
    dgp = rule.dgp(E.mean(axis=0), mean)
    assert np.sqrt((told**2).mean()) == pytest.approx(dgp.std(), rel=0.08)
    np.testing.assert_allclose(
        pseudo_values(rule, E, 0 * mean, 0 * E), rule.dgp(E, 0 * mean), rtol=1e-12
    )


def test_dim_points_take_fewer_replicates_and_bright_ones_all(tmp_path, monkeypatch):
    """Luminances agree with those of all replicates, within the noise of either."""
    case = case_in(tmp_path)
    backend.select()
    light, looking = daylight(case), eyes(case)
    run = Run.of(case, plan(case, light).scope)
    monkeypatch.setattr(surface_light, "FIRST", 4)
    (all_at_once,) = places(case, "open", light, looking, run)
    made = []
    compute = state.of_points
    monkeypatch.setattr(surface_light, "FIRST", 2)

    def counted(case, *rest, **options):
        made.append((len(rest[3]), case.accuracy.replicates))
        return compute(case, *rest, **options)

    monkeypatch.setattr(state, "of_points", counted)
    (in_two,) = places(case, "open", light, looking, run)
    (points, first), (bright, rest) = made
    assert (first, rest) == (2, 2)
    L, again = (by_point(place.known.surfaces, points) for place in (all_at_once, in_two))
    assert 0 < (L > DIM).any(axis=1).sum() <= bright < points
    assert in_two.known.surfaces.noise.deviation.shape[0] == 4
    both = (L > DIM) & (again > DIM)
    assert both.sum() > 0.95 * (L > DIM).sum()
    assert again[both].mean() == pytest.approx(L[both].mean(), rel=0.02)
    dim = L < DIM / 4
    assert again[dim].mean() == pytest.approx(L[dim].mean(), rel=0.03)


def by_point(lit, points):
    """Luminances (point, time) [cd/m²]."""
    L = np.zeros((points, len(TIMES)))
    L[lit.point, lit.time] = lit.luminance
    return L
