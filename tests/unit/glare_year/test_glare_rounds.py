"""Rounds toward a target of glare: averages, looks at made years, and when the rounds end."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import Accuracy, Target
from drcmitsuba.glare_year import rounds
from drcmitsuba.glare_year.eye_samples import EyeSamples, by_hour
from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rounds import (
    IntervalLook,
    StateSampler,
    of_glare,
    of_illuminance,
    toward,
)
from drcmitsuba.glare_year.state_doubts import StateDoubts
from drcmitsuba.metrics.intervals.facade_draws import DrawnStates
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.runtime import time_limit
from drcmitsuba.runtime.progress import silent

RNG = np.random.default_rng(5)
NAMES = ("illuminance", "sums", "sharp", "deviations")
ONE_POINT = Target(1, "point of glare hours")


def arrays(hours, views, replicates=3):
    shapes = {"illuminance": (replicates,), "sums": (), "sharp": (), "deviations": (replicates,)}
    return {name: RNG.random((*shape, hours, views)) for name, shape in shapes.items()}


def samples(hours, views):
    return EyeSamples(**arrays(hours, views), rounds=np.ones((hours, views), int))


def made(dgp, spread):
    """Year of glare by DGP (state, time, view), with replicates at ± a spread (same shape)."""
    signs = np.array([1, -1, 1, -1])[:, None, None, None]
    replicates = (dgp + signs * spread).astype(np.float32)
    coords = {"state": list("ab")[: len(dgp)], "time": np.arange(dgp.shape[1]), "view": ["eye"]}
    hours = xr.Dataset({"dgp": (("state", "time", "view"), dgp.astype(np.float32))}, coords)
    return GlareYear(None, hours, replicates, {"seed": 0}, {})


# ---- averages ---------------------------------------------------------------------------------


def test_rounds_are_averaged_in_the_hours_and_eyes_that_they_have():
    first = samples(4, 3)
    hours, views = np.array([0, 3]), np.array([2, 0])
    once, twice = arrays(2, 2), arrays(2, 2)
    result = first.averaged(once, hours, views).averaged(twice, hours, views)
    at = (..., hours[:, None], views)
    for name in NAMES:
        expected = getattr(first, name).copy()
        expected[at] = (expected[at] + once[name] + twice[name]) / 3
        np.testing.assert_allclose(getattr(result, name), expected, rtol=1e-12)
    np.testing.assert_array_equal(result.rounds, [[3, 1, 3], [1] * 3, [1] * 3, [3, 1, 3]])
    assert (first.rounds == 1).all()


def test_a_round_of_illuminance_leaves_the_sources_as_they_are():
    first, more = samples(2, 1), RNG.random((3, 2, 1))
    result = first.averaged({"illuminance": more}, np.arange(2), np.arange(1))
    np.testing.assert_allclose(result.illuminance, (first.illuminance + more) / 2, rtol=1e-12)
    for name in NAMES[1:]:
        np.testing.assert_array_equal(getattr(result, name), getattr(first, name))


def test_every_hour_has_the_samples_of_its_state():
    states, index = [samples(3, 2), samples(3, 2)], np.array([1, 0, 1])
    applied = by_hour(states, index)
    for name in (*NAMES, "rounds"):
        for time, state in enumerate(index):
            taken = getattr(states[state], name)[..., time, :]
            np.testing.assert_array_equal(getattr(applied, name)[..., time, :], taken)


# ---- looks ------------------------------------------------------------------------------------


def test_the_half_width_is_countable_where_one_hour_is_in_doubt():
    """One of 20 hours is at the limit, so that it is above in half of the draws: 5 points wide."""
    dgp, spread = np.full((1, 20, 1), 0.3), np.zeros((1, 20, 1))
    dgp[0, 7], spread[0, 7] = 0.4, 0.01
    spread[0, 3] = 1e-4  # far from every limit
    year = made(dgp, spread)
    assert year.half_widths() == pytest.approx(np.array([[2.5]]))
    assert np.flatnonzero(year.in_doubt[0, :, 0]).tolist() == [7]
    assert year.numbers()["DGP"]["a"]["eye"]["above"]["0.40"]["high"] == pytest.approx(5)
    look = of_glare(year, ONE_POINT)
    assert look.half_width == pytest.approx(2.5)
    assert np.argwhere(look.wanting).tolist() == [[0, 7, 0]]
    assert not of_glare(year, Target(2.6, "point of glare hours")).wanting.any()


def test_an_interval_has_the_hours_whose_state_is_in_doubt():
    """In hour 5 of 20 the shade is open in a third of the draws, and then the eye is dazzled."""
    dgp = np.full((2, 20, 1), 0.3)
    drawn = np.zeros((2, DRAWS), int)
    drawn[0, ::3] = 1
    drawn[1, 1] = 1  # where the other state dazzles no more than the one applied
    other = np.full((4, 1, 2, 1), 0.3, np.float32)
    other[:, 0, 0] = 0.5
    year = made(dgp, np.zeros((2, 20, 1)))
    in_doubt = replace(year, doubts=StateDoubts(np.array([5, 9]), drawn, other))
    assert year.interval(0.40)["high"].values.max() == 0
    shares = in_doubt.interval(0.40)
    assert shares["high"].values[:, 0].tolist() == [0, 5]
    assert shares["value"].values.max() == 0
    chance = in_doubt.classes()["probability"]
    assert chance.sel(state="b", view="eye").values.tolist() == [1, 0, 0, 0]  # 5 % may exceed it
    assert not in_doubt.in_doubt.any()  # no further sample of DGP narrows it


def test_hours_in_doubt_of_the_applied_shade_are_simulated_in_their_state(monkeypatch):
    index, begun = np.arange(4) % 2, []

    def at_eyes(case, state, hours, looking, run):
        begun.append((state, hours.tolist()))
        return np.ones((3, len(hours), 1))

    monkeypatch.setattr(rounds, "at_rows", lambda light, hours: hours)
    monkeypatch.setattr(rounds, "at_eyes", at_eyes)
    case = SimpleNamespace(accuracy=Accuracy())
    looking = SimpleNamespace(take=lambda views: views)
    other = DrawnStates(np.array([1, 3]), np.zeros((1, 4), int), np.ones((2, DRAWS), int))
    sampler = StateSampler(case, None, looking, None, Run(0), ("a", "b"), index, other)
    assert sampler.states == ("a", "b", "applied")
    before = [samples(4, 1), samples(4, 1)]
    wanting = np.zeros((3, 4, 1), bool)
    wanting[0, 0] = wanting[2, [2, 3]] = True
    *_, after, in_draws = sampler.more([*before, by_hour(before, index)], wanting, 1, False)
    assert begun == [("a", [0, 2]), ("b", [3])]
    assert after.rounds[:, 0].tolist() == [2, 1, 2, 2]
    assert in_draws.rounds[:, 0].tolist() == [2, 1, 2, 1]  # those of state a
    np.testing.assert_allclose(after.illuminance[:, 3], (before[1].illuminance[:, 3] + 1) / 2)


def test_eyes_whose_illuminance_is_known_well_enough_are_not_wanted():
    E = np.array([[1.0, 1.1], [1.0, 0.9]])[:, None].repeat(5, axis=1)  # (replicate, time, view)
    one = EyeSamples(E, E[0], E[0], E, np.ones((5, 2), int))
    look = of_illuminance([one], Target(2, "% at each sensor"))
    # Standard error 0.1, Student's factor of two replicates 12.706.
    assert look.half_width == pytest.approx(127.06, rel=1e-4)
    assert look.wanting[0].tolist() == [[False, True]] * 5


# ---- ends -------------------------------------------------------------------------------------


class Made:
    """Sampler whose rounds take 10 s each on a clock of its own, and half widths fall by them."""

    def __init__(self, monkeypatch, limit):
        self.clock, self.begun = 0.0, []
        self.case = SimpleNamespace(accuracy=Accuracy(target=str(ONE_POINT), time_limit=limit))
        self.run = SimpleNamespace(timed=silent)
        monkeypatch.setattr(time_limit.time, "perf_counter", lambda: self.clock)

    def more(self, samples, wanting, number, with_sources):
        assert with_sources
        self.begun.append((number, self.clock))
        self.clock += 10
        return samples

    def look(self, samples):
        return IntervalLook(4 / (1 + len(self.begun)), np.ones((1, 1, 1), bool))


def test_rounds_end_where_the_target_is_reached(monkeypatch):
    sampler = Made(monkeypatch, 1000)
    _, note = toward(ONE_POINT, sampler, [], sampler.look)
    assert [number for number, _ in sampler.begun] == [1, 2, 3]
    assert note == "hours of glare: ±1 points at the widest eye after 4 rounds, wanted ±1 points"


def test_no_round_begins_after_the_time_limit(monkeypatch):
    sampler = Made(monkeypatch, 15)
    _, note = toward(ONE_POINT, sampler, [], sampler.look)
    assert sampler.begun == [(1, 0.0), (2, 10.0)]
    assert note.endswith("after 3 rounds, wanted ±1 points; the limit of 15 s is over")


def test_a_target_that_is_met_at_once_adds_no_round(monkeypatch):
    sampler = Made(monkeypatch, 15)
    _, note = toward(Target(5, "point of glare hours"), sampler, [], sampler.look)
    assert not sampler.begun
    assert "after 1 round, wanted ±5 points" in note
