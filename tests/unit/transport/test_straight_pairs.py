"""Straight light by any shares, from the pairs of a bin and a sensor that see each other."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.transport.elements.straight_light import Entries, StraightLight
from drcmitsuba.transport.elements.straight_pairs import StraightPairs

BINS, SENSORS, REPLICATES = 12, 5, 3
OWN = {2: np.arange(0, 12, 2), 7: np.arange(12), 9: np.arange(3)}
"""Own bins of elements by their positions among the weights."""
SHARES = np.linspace(0.1, 1.0, 10).astype(np.float32)


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
            for r in range(REPLICATES if number != 9 else 0)
        ]
        lights[number] = own, StraightLight.of(entries, REPLICATES, (len(own), SENSORS))
    return lights


def expected(lights, shares, bins):
    C = np.zeros((BINS, SENSORS))
    for number, (own, each) in lights.items():
        C[own] += shares[number] * each.dense().mean(axis=0)
    return C[bins].ravel()


@pytest.mark.parametrize("bins", [np.arange(BINS), np.array([0, 1, 4, 9])])
def test_the_sum_is_that_of_whole_arrays(light, bins):
    pairs = StraightPairs.of(light, np.arange(BINS), SENSORS).at(bins)
    C = pairs.weighed(mi.Float(SHARES)).numpy()
    np.testing.assert_allclose(C, expected(light, SHARES, bins), rtol=1e-5, atol=1e-7)
    assert np.count_nonzero(C) < len(C)


def test_gradients_flow_to_the_weights(light):
    pairs = StraightPairs.of(light, np.arange(BINS), SENSORS)
    weights, factor = mi.Float(SHARES), np.random.default_rng(4).random(BINS * SENSORS)
    dr.enable_grad(weights)
    dr.backward(dr.sum(pairs.weighed(weights) * mi.Float(factor)))
    every = np.arange(BINS)
    by_hand = [expected(light, row, every) @ factor for row in np.eye(len(SHARES))]
    np.testing.assert_allclose(weights.grad.numpy(), by_hand, rtol=1e-4)


def test_without_pairs_it_is_dark(light):
    pairs = StraightPairs.of({}, np.arange(BINS), SENSORS)
    assert not pairs.weighed(mi.Float(SHARES)).numpy().any()
