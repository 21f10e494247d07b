"""Straight light of few pairs, against a dense array that the same entries are added to."""

import numpy as np

from drcmitsuba.transport.elements.light import ElementLight
from drcmitsuba.transport.elements.straight_light import Entries, StraightLight

REPLICATES, BINS, SENSORS = 3, 7, 5


def entries(rng):
    """Entries of every replicate, two times, as two launches of one result bring them."""
    for k in (*range(REPLICATES), *range(REPLICATES)):
        places = rng.permutation(BINS * SENSORS)[:6]
        yield Entries(k, places, rng.random(6).astype(np.float32))


def test_entries_are_added_up():
    every = [*entries(np.random.default_rng(1))]
    dense = np.zeros((REPLICATES, BINS * SENSORS), np.float32)
    for each in every:
        np.add.at(dense[each.result], each.places, each.C)
    light = StraightLight.of(every, REPLICATES, (BINS, SENSORS))
    np.testing.assert_allclose(light.dense().reshape(REPLICATES, -1), dense, rtol=1e-6)
    np.testing.assert_array_equal(light.places, np.flatnonzero(dense.any(axis=0)))


def test_none_is_dark():
    assert not StraightLight.of((), REPLICATES, (BINS, SENSORS)).dense().any()


def test_pairs_of_some_bins():
    """Own bins are every second one of all labels."""
    every = [*entries(np.random.default_rng(2))]
    straight = StraightLight.of(every, REPLICATES, (BINS, SENSORS))
    own, dark = 2 * np.arange(BINS), np.zeros((REPLICATES, BINS, SENSORS), np.float32)
    light = ElementLight(own, straight, None, dark, dark)
    bins = np.arange(3, 11)
    expected = np.zeros((REPLICATES, 2 * BINS, SENSORS), np.float32)
    expected[:, own] = straight.dense()
    expected = expected[:, bins].reshape(REPLICATES, -1)
    places, C = light.seen_at(bins)
    got = np.zeros_like(expected)
    got[:, places] = C
    np.testing.assert_array_equal(got, expected)
    assert got.any()
