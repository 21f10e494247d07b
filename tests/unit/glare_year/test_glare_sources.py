"""Sources of many hours at once, against sources that are joined hour by hour."""

from itertools import pairwise

import numpy as np
import pytest

from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.sources import Tiles, contrast_sums
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError


@pytest.fixture(autouse=True, scope="module")
def _variant():
    backend.select()


def spread(count, seed):
    """Unit vectors all round."""
    d = np.random.default_rng(seed).standard_normal((count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def frame_of(forward):
    forward = np.asarray(forward) / np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(right, forward), forward])


def joined(d, bright, reach):
    """Number of the component of each bright direction, by flooding."""
    number = np.full(len(d), -1)
    for start in np.flatnonzero(bright):
        if number[start] < 0:
            number[start], edge = start, [start]
            while edge:
                i = edge.pop()
                near = bright & (number < 0) & (d @ d[i] >= np.cos(reach))
                number[near] = start
                edge += list(np.flatnonzero(near))
    return number


def one_by_one(L, tiles, frame, threshold, peak):
    """Σ L² ω / P² of one hour and view, tile by tile."""
    first, omega, total = tiles.first, tiles.solid_angle, 0.0
    inside = [slice(a, b) for a, b in pairwise(first)]
    any_bright = np.array([(L[i] > threshold).any() for i in inside])
    any_peak = np.array([(L[i] > peak).any() for i in inside])
    for number, low, high in (
        (joined(tiles.direction, any_bright, tiles.opening / 2), threshold, peak),
        (joined(tiles.direction, any_peak, tiles.opening / 2), peak, np.inf),
    ):
        for source in np.unique(number[number >= 0]):
            w, flux, towards = 0.0, 0.0, np.zeros(3)
            for tile in np.flatnonzero(number == source):
                d = tiles.direction[tile]
                if d @ frame[2] <= 0:
                    continue
                values, sizes = L[inside[tile]], omega[inside[tile]]
                of_source = (values > low) & (values <= high)
                w += sizes[of_source].sum()
                flux += (values * sizes)[of_source].sum()
                towards += (values * sizes)[of_source].sum() * d
            if w > 0:
                P = position_index(frame @ towards / np.linalg.norm(towards))
                total += flux**2 / w / P**2
    return total


@pytest.mark.parametrize("hours", [1, 7])
def test_sources_of_many_hours_are_those_joined_one_by_one(hours):
    rng, tiles_count, each = np.random.default_rng(3), 400, 3
    first = np.arange(tiles_count + 1) * each
    omega = rng.uniform(0.5, 2, tiles_count * each) * 4 * np.pi / (tiles_count * each)
    tiles = Tiles(first, spread(tiles_count, 5), omega, opening=0.3)
    L = np.exp(rng.normal(6.5, 1.6, (tiles_count * each, hours))).astype(np.float32)
    frames = np.stack([frame_of(d) for d in ([0, 1, 0.1], [1, 0.3, 0], [-1, -1, -0.3])])
    ours = contrast_sums(L, tiles, frames, np.full(hours, 2000.0), 5000.0)
    theirs = [
        [one_by_one(L[:, h], tiles, frame, 2000.0, 5000.0) for h in range(hours)]
        for frame in frames
    ]
    assert np.min(theirs) > 0
    np.testing.assert_allclose(ours, theirs, rtol=2e-4)


def test_a_threshold_of_each_view_and_hour_counts():
    tiles = Tiles(np.array([0, 1, 2]), np.array([[0.0, 1, 0], [1.0, 0, 0]]), np.array([0.01, 0.02]))
    frames = np.stack([frame_of([1, 1, 0]), frame_of([0, 1, 0.01])])
    L = np.array([[3000.0, 500.0], [2500.0, 4000.0]], np.float32)
    limit = np.array([[2000.0, 2000.0], [2900.0, 100.0]])
    sums = contrast_sums(L, tiles, frames, limit, 1e5)
    P = position_index(np.einsum("vki,ti->vtk", frames, tiles.direction)) ** 2
    expected = [
        [3000**2 * 0.01 / P[0, 0] + 2500**2 * 0.02 / P[0, 1], 4000**2 * 0.02 / P[0, 1]],
        [3000**2 * 0.01 / P[1, 0], 500**2 * 0.01 / P[1, 0]],
    ]
    np.testing.assert_allclose(sums, expected, rtol=1e-5)


def test_dark_hours_have_no_sources():
    tiles = Tiles(np.array([0, 1]), np.array([[0.0, 1, 0]]), np.array([0.01]))
    sums = contrast_sums(np.zeros((1, 4), np.float32), tiles, frame_of([0, 1, 0])[None],
                         np.full(4, 2000.0), 5e4)  # fmt: skip
    assert (sums == 0).all()
    assert Rule().dgp(np.zeros(4), sums[0]) == pytest.approx(0.159)
    assert Rule(low_light=True).dgp(np.zeros(4), sums[0]) == pytest.approx(0.0029, abs=1e-4)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"threshold": 0}, "threshold: 0"),
        ({"opening": 2.0}, "opening: 2.0"),
        ({"peak": float("nan")}, "peak: nan"),
    ],
)
def test_unfit_rules_are_refused_in_one_line(options, complaint):
    with pytest.raises(InputError, match=complaint):
        Rule(**options)
