"""Random rooms and buildings beside the path tracer; `fuzz` says how they are drawn and judged."""

import numpy as np
import pytest

from drcmitsuba.runtime import backend
from tests.validation.fuzz.__main__ import KINDS, drawn
from tests.validation.fuzz.agreement import FAINT, LEVEL, agreement, compared


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", KINDS)
def test_random_cases_have_the_light_of_the_path_tracer(kind, seed):
    backend.select()
    for row in compared(drawn(kind, seed), paths=1024):
        print(kind, seed, row)
        assert not row.is_wrong


def test_a_sensor_that_is_wrong_by_itself_is_told():
    rng = np.random.default_rng(0)
    light = 1.0 + np.arange(10.0)
    ours, theirs = (light * rng.normal(1, 0.01, (16, 10)) for _ in range(2))
    assert not agreement("sky", ours, theirs).is_wrong
    ours[:, 3] *= 1.1
    row = agreement("sky", ours, theirs)
    assert row.is_wrong
    assert row.p_worst < LEVEL
    assert abs(row.worst - 0.1) < 0.02
    ours[:, 3] = theirs[:, 3] = FAINT  # light of a closed box
    ours[:, 3] *= 2
    assert not agreement("sky", ours, theirs).is_wrong


def test_leaks_are_told_and_a_sensor_that_does_not_vary_hides_no_other():
    rng = np.random.default_rng(2)
    ours, theirs = (rng.normal(1, 0.01, (16, 10)) for _ in range(2))
    assert agreement("sky", ours, np.zeros((16, 10))).is_wrong
    ours[:, 0] = theirs[:, 0] = 1.0
    assert not agreement("sky", ours, theirs).is_wrong
    ours[:, 3] *= 1.5
    ours[:, 4] *= 0.5
    assert agreement("sky", ours, theirs).is_wrong


def test_a_sum_that_is_wrong_is_told():
    rng = np.random.default_rng(1)
    ours, theirs = (rng.normal(1, 0.01, (16, 40)) for _ in range(2))
    assert agreement("sky", 1.01 * ours, theirs).is_wrong
    assert not agreement("sky", 1.002 * ours, theirs).is_wrong
