"""Straight light by any shares, from the pairs of a bin and a sensor that see each other."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.transport.elements.straight_light import Entries, StraightLight
from drcmitsuba.transport.elements.straight_pairs import NO_MIRROR, StraightPairs

BINS, SENSORS, REPLICATES = 12, 5, 3
OWN = {(2, NO_MIRROR): np.arange(0, 12, 2), (7, 3): np.arange(12), (9, NO_MIRROR): np.arange(3)}
"""Own bins by an element's position among the shares and that of the one that mirrors it."""
SHARES = np.linspace(0.1, 1.0, 10).astype(np.float32)
FACTORS = np.linspace(1.0, 0.7, 10).astype(np.float32)


@pytest.fixture(scope="module")
def light():
    """Some pairs are seen by two elements; one element has none."""
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    rng, lights = np.random.default_rng(3), {}
    for number, own in OWN.items():
        size = len(own) * SENSORS
        entries = [
            Entries(
                r, places := rng.choice(size, size // 3, replace=False), rng.random(len(places))
            )
            for r in range(REPLICATES if number[0] != 9 else 0)
        ]
        lights[number] = own, StraightLight.of(entries, REPLICATES, (len(own), SENSORS))
    return lights


def expected(lights, shares, bins):
    C = np.zeros((BINS, SENSORS))
    for (number, mirror), (own, each) in lights.items():
        share = shares[number] * (1 if mirror == NO_MIRROR else shares[mirror])
        C[own] += FACTORS[number] * share * each.dense().mean(axis=0)
    return C[bins].ravel()


@pytest.mark.parametrize("bins", [np.arange(BINS), np.array([0, 1, 4, 9])])
def test_the_sum_is_that_of_whole_arrays(light, bins):
    pairs = StraightPairs.of(light, np.arange(BINS), SENSORS).at(bins)
    C = pairs.weighed(mi.Float(SHARES), mi.Float(FACTORS)).numpy()
    np.testing.assert_allclose(C, expected(light, SHARES, bins), rtol=1e-5, atol=1e-7)
    assert np.count_nonzero(C) < len(C)


def test_gradients_flow_to_the_shares(light):
    pairs = StraightPairs.of(light, np.arange(BINS), SENSORS)
    shares, factor = mi.Float(SHARES), np.random.default_rng(4).random(BINS * SENSORS)
    dr.enable_grad(shares)
    dr.backward(dr.sum(pairs.weighed(shares, mi.Float(FACTORS)) * mi.Float(factor)))
    every, steps = np.arange(BINS), 0.01 * np.eye(len(SHARES))  # exact: C is bilinear
    by_hand = [
        (expected(light, SHARES + step, every) - expected(light, SHARES - step, every))
        @ factor / 0.02
        for step in steps
    ]  # fmt: skip
    np.testing.assert_allclose(shares.grad.numpy(), by_hand, rtol=1e-4)


def test_without_pairs_it_is_dark(light):
    pairs = StraightPairs.of({}, np.arange(BINS), SENSORS)
    assert not pairs.weighed(mi.Float(SHARES), mi.Float(FACTORS)).numpy().any()
