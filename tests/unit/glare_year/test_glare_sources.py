"""Sources of many hours at once, against sources that are joined hour by hour."""

import numpy as np
import pytest
from scipy import sparse

from drcmitsuba.glare_year.luminances import PixelRows
from drcmitsuba.glare_year.pixels import rays
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.sources import contrast_sums
from drcmitsuba.glare_year.tiles import EyeTiles
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat


@pytest.fixture(autouse=True, scope="module")
def _variant():
    backend.select()


def frame_of(forward):
    forward = np.asarray(forward) / np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(right, forward), forward])


def rows_of(L):
    """Pixels of luminances (pixel, hour), each of which is a row."""
    each = np.arange(len(L))
    return PixelRows(each, each, np.ones(len(each), np.float32), flat(L), *L.shape)


def joined(d, bright, reach):
    """Number of the component of each bright direction, by flooding; −1 of the others."""
    number = np.full(len(d), -1)
    for start in np.flatnonzero(bright):
        if number[start] < 0:
            number[start], edge = start, [start]
            while edge:
                i = edge.pop()
                near = bright & (number < 0) & (np.linalg.norm(d - d[i], axis=1) <= reach)
                number[near] = start
                edge += list(np.flatnonzero(near))
    return number


def by_tile(number, tile):
    """Number of each ray's source, where rays of one tile are one source from the start."""
    while True:
        least = np.full(tile.max() + 1, len(number))
        np.minimum.at(least, tile[number >= 0], number[number >= 0])
        new = np.where(number < 0, -1, least[tile])
        for old in np.unique(number[number >= 0]):
            new[number == old] = new[number == old].min()
        if (new == number).all():
            return number
        number = new


def one_by_one(L, tiles, frame, threshold, peak):
    """Σ L² ω / P² of one hour and view, ray by ray."""
    values = L[tiles.pixel]
    tile = np.repeat(np.arange(len(tiles)), np.diff(tiles.first))
    ahead = tiles.direction[tile] @ frame[2] > 0
    total, reach = 0.0, 2 * np.sin(tiles.opening / 4)
    for low, high, chain in ((threshold, peak, threshold), (peak, np.inf, peak)):
        number = by_tile(joined(tiles.rays, ahead & (values > chain), reach), tile)
        counts = ahead & (values > low) & (values <= high)
        for source in np.unique(number[counts]):
            mine = counts & (number == source)
            flux, omega = values[mine].sum() * tiles.solid_angle, mine.sum() * tiles.solid_angle
            towards = (values[mine, None] * tiles.direction[tile[mine]]).sum(axis=0)
            P = position_index(frame @ towards / np.linalg.norm(towards))
            total += flux**2 / omega / P**2
    return total


@pytest.mark.parametrize("hours", [1, 7])
def test_sources_of_many_hours_are_those_joined_one_by_one(hours):
    rng, sent = np.random.default_rng(3), rays(np.array([[0.0, 1, 0], [1.0, 0, 0]]))
    near = sent.directions @ [0.6, 0.75, 0.28] > 0.9  # 800 rays, many at the edges of views
    _, tile = np.unique(sent.tile[near], return_inverse=True)
    first = np.flatnonzero(np.r_[True, np.diff(tile) > 0, True])
    pixel = np.cumsum(rng.random(near.sum()) < 0.3)  # some rays share a pixel
    frames = np.stack([frame_of(d) for d in ([0, 1, 0.1], [1, 0.3, 0], [0.7, -0.6, -0.3])])
    tiles = EyeTiles(
        first, sent.directions[near], pixel, sent.solid_angle, frames[:, 2], opening=0.1
    )
    L = np.exp(rng.normal(6.4, 1.2, (pixel.max() + 1, hours))).astype(np.float32)
    ours = contrast_sums(rows_of(L), tiles, frames, np.full(hours, 2000.0), 5000.0)
    theirs = [
        [one_by_one(L[:, h], tiles, frame, 2000.0, 5000.0) for h in range(hours)]
        for frame in frames
    ]
    assert np.min(theirs) > 0
    np.testing.assert_allclose(ours, theirs, rtol=2e-4)


def test_pixels_are_sums_of_rows():
    """Pixels of any number of rows, of none too, against pixels whose sums are made before."""
    rng, sent = np.random.default_rng(5), rays(np.array([[0.0, 1, 0]]))
    near = sent.directions @ [0.2, 0.95, 0.1] > 0.97
    _, tile = np.unique(sent.tile[near], return_inverse=True)
    first = np.flatnonzero(np.r_[True, np.diff(tile) > 0, True])
    pixel = np.cumsum(rng.random(near.sum()) < 0.5)
    frames = frame_of([0, 1, 0.2])[None]
    tiles = EyeTiles(first, sent.directions[near], pixel, sent.solid_angle, frames[:, 2])
    weights = sparse.random_array((pixel.max() + 1, 40), density=0.06, rng=rng, dtype=np.float32)
    values = np.exp(rng.normal(7.5, 1.5, (40, 9))).astype(np.float32)
    weights = weights.tocsr()
    assert (np.diff(weights.indptr) == 0).any()
    of = np.repeat(np.arange(pixel.max() + 1), np.diff(weights.indptr)), weights.indices
    light = PixelRows(*of, weights.data, flat(values), pixel.max() + 1, 9)
    L = weights @ values
    np.testing.assert_allclose(light.luminance(), L, rtol=1e-6)
    limit = np.full(9, 2000.0)
    ours, theirs = (
        contrast_sums(each, tiles, frames, limit, 8000.0) for each in (light, rows_of(L))
    )
    assert ((limit < L) & (L < 8000)).any()
    assert (L > 8000).any()
    np.testing.assert_allclose(ours, theirs, rtol=1e-5)


def test_a_threshold_of_each_view_and_hour_counts():
    frames = np.stack([frame_of([1, 1, 0]), frame_of([0, 1, 0.01])])
    d = np.array([[0.0, 1, 0], [1.0, 0, 0]])
    tiles = EyeTiles(np.arange(3), d, np.arange(2), 0.01, frames[:, 2])
    L = np.array([[3000.0, 500.0], [2500.0, 4000.0]], np.float32)
    limit = np.array([[2000.0, 2000.0], [2900.0, 100.0]])
    sums = contrast_sums(rows_of(L), tiles, frames, limit, 1e5)
    P = position_index(np.einsum("vki,ti->vtk", frames, tiles.direction)) ** 2
    expected = [
        [3000**2 * 0.01 / P[0, 0] + 2500**2 * 0.01 / P[0, 1], 4000**2 * 0.01 / P[0, 1]],
        [3000**2 * 0.01 / P[1, 0], 500**2 * 0.01 / P[1, 0]],
    ]
    np.testing.assert_allclose(sums, expected, rtol=1e-5)


def test_a_view_has_no_source_behind_it():
    frames = np.stack([frame_of([0, 1, 0]), frame_of([0, -1, 0])])
    tiles = EyeTiles(np.arange(2), np.array([[0.0, 1, 0]]), np.arange(1), 0.01, frames[:, 2])
    L, limit = np.full((1, 3), 3000, np.float32), np.full(3, 2000.0)
    sums = contrast_sums(rows_of(L), tiles, frames, limit, 5e4)
    np.testing.assert_allclose(sums, [[3000**2 * 0.01] * 3, [0] * 3], rtol=1e-5)
    away = EyeTiles(np.arange(2), tiles.rays, np.arange(1), 0.01, frames[1:, 2])
    assert (contrast_sums(rows_of(L), away, frames[1:], limit, 5e4) == 0).all()


def test_dark_hours_have_no_sources():
    tiles = EyeTiles(np.arange(2), np.array([[0.0, 1, 0]]), np.arange(1), 0.01, np.eye(3)[1:2])
    sums = contrast_sums(rows_of(np.zeros((1, 4))), tiles, frame_of([0, 1, 0])[None],
                         np.full(4, 2000.0), 5e4)  # fmt: skip
    assert (sums == 0).all()
    none = PixelRows(*np.zeros((2, 0), int), np.zeros(0, np.float32), flat(np.ones(4)), 1, 4)
    assert not contrast_sums(none, tiles, frame_of([0, 1, 0])[None], np.zeros(4), 5e4).any()
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
