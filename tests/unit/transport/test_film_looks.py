"""Sums of the weights of directions to films."""

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.transport.films.looks import Directions, Looked


def directions(receiver, row, weight):
    columns = mi.UInt32(receiver), dr.zeros(mi.UInt32, len(receiver)), mi.UInt32(row)
    return Directions(*columns, mi.Float(weight))


def test_weights_are_summed_by_receiver_and_cell():
    rng = np.random.default_rng(4)
    rows, receivers = np.array([2, 3, 7]), 5
    expected, kinds = np.zeros((receivers, len(rows))), []
    for count in (40, 9):
        receiver = np.sort(rng.choice([0, 1, 4], count))  # two see nothing
        at, weight = rng.integers(0, len(rows), count), rng.random(count)
        np.add.at(expected, (receiver, at), weight)
        kinds.append(directions(receiver, rows[at], weight))
    sums = Looked(receivers, 40, tuple(kinds)).by_row(mi.UInt32(rows), 9).numpy()
    np.testing.assert_allclose(sums, expected, rtol=1e-6)


def test_half_a_million_directions_do_not_drift():
    count = 1 << 19
    none = np.zeros(count, int)
    looked = Looked(1, count, (directions(none, none, np.full(count, 0.1)),))
    total = looked.by_row(mi.UInt32([0]), 1).numpy()
    np.testing.assert_allclose(total, count * np.float32(0.1), rtol=1e-6)
