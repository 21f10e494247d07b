"""Streams of random numbers: no two purposes share a key, seeds are reproducible, points even."""

from itertools import combinations, product

import numpy as np
import pytest

from drcmitsuba.runtime.random_streams import Stream, even_steps, launch_seed


def test_no_two_streams_share_a_key_whatever_their_indices():
    for one, other in combinations(Stream, 2):
        same_length = len(one.value) == len(other.value)
        apart = any(
            None not in pair and pair[0] != pair[1]
            for pair in zip(one.value, other.value, strict=False)
        )
        assert not same_length or apart, (one, other)


def test_keys_of_all_streams_replicates_and_rounds_are_distinct():
    keys = [
        stream.key(*indices)
        for stream in Stream
        for indices in product(range(12), repeat=min(stream.value.count(None), 3))
        if len(indices) == stream.value.count(None)
    ]
    assert len(keys) > 500
    assert len(set(keys)) == len(keys)


def test_a_round_of_adaptive_sampling_meets_no_other_stream():
    """(8, 3) was both round 3 and the shadow edges of a replicate."""
    rounds = {launch_seed(0, Stream.ROUNDS, n) for n in range(64)}
    edges = {launch_seed(0, Stream.SUN_EDGES)}
    photons = {launch_seed(0, Stream.PHOTONS, n) for n in range(64)}
    assert len(rounds | edges | photons) == 2 * 64 + 1


def test_a_seed_follows_from_base_stream_and_index_alone():
    assert launch_seed(3, Stream.PHOTONS, 5) == launch_seed(3, Stream.PHOTONS, 5)
    assert launch_seed(3, Stream.PHOTONS, 5) != launch_seed(4, Stream.PHOTONS, 5)
    assert 0 <= launch_seed(3, Stream.PHOTONS, 5) < 1 << 32


@pytest.mark.parametrize("indices", [(), (1, 2)])
def test_wrong_number_of_indices_is_refused(indices):
    with pytest.raises(ValueError, match=f"PHOTONS: {len(indices)} indices, the stream has 1"):
        Stream.PHOTONS.key(*indices)


@pytest.mark.parametrize("dimensions", [1, 2, 4])
def test_steps_are_powers_of_the_generalised_golden_ratio(dimensions):
    phi = 2**32 / even_steps(dimensions)[0]
    assert phi ** (dimensions + 1) == pytest.approx(1 + phi, rel=1e-8)
    ratios = np.array(even_steps(dimensions)) * phi ** np.arange(1, dimensions + 1) / 2**32
    np.testing.assert_allclose(ratios, 1, rtol=1e-8)
