"""Probability of passing: of the verdicts that say 80 to 90 %, so many come true.

A room has 100 points around the threshold, and the replicates of E have errors of 3 %, half of
which all points share. Every seed is another simulation of it. The limit lies anywhere within 12
points of the true sDA, as the limits of standards do: a verdict comes true where the true sDA
reaches its limit.
"""

import numpy as np
import pytest

from drcmitsuba.standards.quantities import count
from drcmitsuba.standards.standard import Level, Limit, read
from drcmitsuba.standards.verdict import outcome
from drcmitsuba.standards.year import StandardYear
from tests.unit.standards.made_year import WORKING, evidence, median_reached

ERROR, SHARED = 0.03, 0.5


def outcomes(seeds, limits):
    """Probabilities of passing, and whether the truth passes, of some limits for each seed."""
    around = np.exp(np.random.default_rng(4).normal(0.05, 0.25, 100))
    truth = 100 * float((around >= 1).mean())
    quantity = read("lm-83-12").quantities["sDA"]
    p, passed = [], []
    for seed in seeds:
        of_point = around * 300 / median_reached(WORKING)
        E = evidence(of_point, ERROR, times=WORKING, shared=SHARED, seed=seed)
        year = StandardYear(E, np.arange(len(WORKING)))
        counted = {"sDA": count(quantity, year)}
        for limit in truth + np.random.default_rng([seed, 5]).uniform(-12, 12, limits):
            asked = Limit(quantity="sDA", at_least=float(limit))
            level = Level(name="any", limits=(asked,), source="", sure="second-hand")
            p.append(outcome(level, counted, year).probability)
            passed.append(truth >= limit)
    return np.array(p), np.array(passed)


@pytest.mark.slow
def test_of_1000_seeds_77_to_93_percent_pass_where_80_to_90_are_told():
    p, passed = outcomes(range(1000), 6)
    for low in np.arange(0.1, 0.85, 0.1):
        here = (p >= low) & (p < low + 0.1)
        middle = low + 0.05
        assert passed[here].mean() == pytest.approx(middle, abs=0.12), low
    here = (p >= 0.8) & (p < 0.9)
    assert 0.77 <= passed[here].mean() <= 0.93
    assert passed[p == 1].mean() > 0.98
    assert passed[p == 0].mean() < 0.02
