"""Draws that reach far enough to move an entry, against all draws of all entries."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.metrics.intervals import autonomy
from drcmitsuba.metrics.intervals.autonomy import GROUPS, Doubts, State, draw_autonomy, multipliers
from drcmitsuba.metrics.intervals.bootstrap_counts import Needed, draws_passed, sums
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.reach import FEWER, Reach
from drcmitsuba.metrics.intervals.rules import DRAWS

REPLICATES, STAMPS, SENSORS = 6, 400, 40
LIMIT = 300.0


def doubts(own, count=4000):
    """Entries at all distances from the threshold, some on it, some without errors."""
    rng = np.random.default_rng(3)
    E = rng.standard_normal((count, REPLICATES)).astype(np.float32)
    E *= rng.uniform(0, 5, (count, 1))
    error = E.std(axis=1, ddof=1) / np.sqrt(REPLICATES)
    off = np.column_stack([E - E.mean(axis=1, keepdims=True), rng.uniform(-9, 9, count) * error])
    off[:20, -1] = 0
    off[20:40] = 0
    off[40:60, :-1], off[40:60, -1] = 0, np.linspace(-1, 1, 20)
    errors = rng.uniform(0, 3, count).astype(np.float32) if own else None
    group = rng.integers(0, GROUPS, count)
    return Doubts(off.astype(np.float32), errors, group, multipliers(REPLICATES, 5))


@pytest.mark.parametrize("own", [False, True])
def test_draws_that_are_left_out_change_nothing(own):
    every = doubts(own)
    reach = Reach.of(every.drawn.replicates, every.drawn.others if own else None)
    passed = every.passes()[:, reach.order]
    level = reach.levels(every.off[:, -1], every.error)
    by_mean = every.off[:, -1] >= 0
    for k, draws in enumerate(FEWER):
        here = level == k
        assert (passed[here, draws:] == by_mean[here, None]).all()
        assert here.sum() > 30 or k == len(FEWER) - 1
    if not own:  # most draws do move what lies within their reach: the limits are no wider
        assert (passed[level == 1] != by_mean[level == 1, None]).any(axis=1).mean() > 0.8


def year(seed, hours=()):
    """E (replicate, time, sensor) in two states of the façade, and the states in draws."""
    rng = np.random.default_rng(seed)
    shared = rng.standard_normal((REPLICATES, 1, 1)) + rng.standard_normal((REPLICATES, 1, SENSORS))
    mean = rng.uniform(0, 600, (STAMPS, SENSORS)) + np.linspace(-60, 60, SENSORS)
    E = [(m + 20 * shared + rng.normal(0, 9, shared.shape)).astype(np.float32)
         for m in (mean, 0.8 * mean)]  # fmt: skip
    time = np.datetime64("2015-01-01T00", "ns") + np.arange(STAMPS) * np.timedelta64(21, "h")
    every = np.ones(STAMPS, bool)
    sky = xr.Dataset(coords={"time": time})
    dims = ("replicate", "time", "sensor")
    unknown = np.zeros((STAMPS, SENSORS), np.float32)
    states = [
        State.of(xr.Dataset({"illuminance": (dims, e)}, {"time": time}), sky, every,
                 (unknown, unknown), ~every) for e in E
    ]  # fmt: skip
    month = time.astype("datetime64[M]").astype(int) % 12
    hours = np.array(hours, int)
    drawn = rng.integers(0, 2, (len(hours), DRAWS))
    state = rng.integers(0, 2, STAMPS)
    shut = Closures(("open", "shaded"), state, state / 1.0, hours, drawn, drawn / 1.0)
    return (
        E,
        states,
        shut,
        Needed(month, np.bincount(month) // 2, STAMPS // 2, np.arange(SENSORS) % 2),
    )


def by_hand(E, shut, needed, drawn):
    """Sensors that pass in every draw, from E of every entry in every draw."""
    state = np.repeat(shut.state[:, None], DRAWS, axis=1)
    state[shut.hours] = shut.drawn
    passed = np.empty((STAMPS, SENSORS, DRAWS), bool)
    for k, e in enumerate(E):
        mean = e.mean(axis=0)
        moved = (
            np.tensordot(e - mean, drawn.replicates, (0, 0)) + (mean - np.float32(LIMIT))[..., None]
        )
        passed = np.where((state == k)[:, None], moved >= 0, passed)
    monthly = np.stack([passed[needed.month == m].sum(axis=0) for m in range(12)])
    return passed, monthly >= needed.monthly[:, None, None], passed.sum(axis=0) >= needed.yearly


@pytest.mark.parametrize("hours", [(), (3, 50, 51, 200)])
def test_counts_are_those_of_all_draws_of_all_entries(hours, monkeypatch):
    monkeypatch.setattr(autonomy, "BEYOND", 1e-12)  # nothing counts as certain
    E, states, shut, needed = year(7, hours)
    drawn = multipliers(REPLICATES, 2)
    tally = draw_autonomy(states, shut, LIMIT, needed, drawn)
    passed, months, of_year = by_hand(E, shut, needed, drawn)
    annual, monthly = tally.shares()
    np.testing.assert_allclose(annual, 100 * of_year.mean(axis=0))
    np.testing.assert_allclose(monthly, 100 * months.mean(axis=1))
    np.testing.assert_allclose(tally.passing, of_year.mean(axis=1))
    undecided = (tally.passing > 0.025) & (tally.passing < 0.975)
    assert undecided.sum() > 3
    q = passed[:, undecided].mean(axis=2)
    np.testing.assert_array_equal(tally.hours, ((q > 0.025) & (q < 0.975)).sum(axis=1))


def test_sums_of_bytes_are_counts():
    rng = np.random.default_rng(4)
    passed = rng.random((1300, 40)) < 0.9
    first = np.array([0, 3, 4, 900])
    expected = [passed[a:b].sum(axis=0) for a, b in zip(first, [*first[1:], 1300], strict=True)]
    np.testing.assert_array_equal(sums(passed, first), expected)
    np.testing.assert_array_equal(draws_passed(passed), passed.sum(axis=1))
    every = np.ones((2, DRAWS), bool)
    np.testing.assert_array_equal(draws_passed(every), [DRAWS, DRAWS])
