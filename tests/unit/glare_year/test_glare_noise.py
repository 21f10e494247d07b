"""Noise of bright surfaces: slopes of the sums of glare, and DGP by replicates."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.annual.run import Run
from drcmitsuba.glare_year import state
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
    known, noise, times = seen.known, seen.noise, np.arange(len(TIMES))
    assert (known.surfaces[noise.point, noise.time] > DIM).all()
    assert noise.deviation.shape == (4, (known.surfaces > DIM).sum())
    np.testing.assert_allclose(noise.deviation.sum(axis=0), 0, atol=1)
    by_noise = seen.deviations(looking, EACH)
    assert by_noise.shape == (4, len(TIMES), len(looking))
    step, start, slopes = 1e-4, seen.sums(looking, EACH, times)[0], []
    for deviation in noise.deviation:
        L = known.surfaces.copy()
        L[noise.point, noise.time] += step * deviation
        moved = replace(seen, known=replace(known, surfaces=L))
        slopes.append((moved.sums(looking, EACH, times)[0] - start) / step)
    size = np.sqrt(np.mean(np.square(slopes)))
    assert size > 1e3
    # Tiles at the edge of the window hold sky and surface, which make one source; no luminance
    # crosses the threshold by so small a step.
    assert np.sqrt(np.mean((by_noise - slopes) ** 2)) < 0.15 * size


def test_surfaces_below_the_threshold_move_no_sum(place):
    looking, seen = place
    assert not seen.deviations(looking, Rule(threshold=1e6)).any()


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
    monkeypatch.setattr(state, "FIRST", 4)
    (all_at_once,) = places(case, "open", light, looking, run)
    made = []
    compute = state._coefficients
    monkeypatch.setattr(state, "FIRST", 2)
    monkeypatch.setattr(
        state, "_coefficients", lambda *a: made.append((len(a[3].points), a[5])) or compute(*a)
    )
    (in_two,) = places(case, "open", light, looking, run)
    (points, first), (bright, rest) = made
    assert (first, rest) == (2, 2)
    L = all_at_once.known.surfaces
    assert 0 < (L > DIM).any(axis=1).sum() <= bright < points
    assert in_two.noise.deviation.shape[0] == 4
    both = (L > DIM) & (in_two.known.surfaces > DIM)
    assert both.sum() > 0.95 * (L > DIM).sum()
    assert in_two.known.surfaces[both].mean() == pytest.approx(L[both].mean(), rel=0.02)
    dim = L < DIM / 4
    assert in_two.known.surfaces[dim].mean() == pytest.approx(L[dim].mean(), rel=0.03)
