"""Pairs of points and suns that are looked for by clusters are those found one by one."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.scene import scene as scenes
from drcmitsuba.transport.rays import sun_clusters
from drcmitsuba.transport.rays.openings import Openings
from drcmitsuba.transport.rays.sun_clusters import CLUSTER, SunClusters, possible_pairs
from tests.unit.transport.exact_scenes import WINDOW, flat, glazing, room

RNG = np.random.default_rng(11)
DIAMETER = 0.5
SUNS = 2 * CLUSTER + 5


def directions(count):
    """Unit vectors of any direction."""
    d = RNG.normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def one_by_one(openings, points, normals, suns):
    """Pairs, each of which is tested by itself."""
    row, sun = np.indices((len(points), len(suns))).reshape(2, -1)
    radius = np.radians(DIAMETER) / 2
    keep = np.einsum("ij,ij->i", normals[row], suns[sun]) > -np.sin(radius)
    if openings is not None:
        p, d = (dr.unravel(mi.Vector3f, flat(x)) for x in (points[row], suns[sun]))
        keep &= openings.passed(mi.UInt32(row), p, d, dr.opaque(mi.Float, radius)).numpy()
    return set((row * len(suns) + sun)[keep].tolist())


@pytest.fixture
def quads():
    """A window, and another one in the ceiling."""
    world = scenes.load(room(WINDOW, {"glass": glazing(0.6)}))
    ceiling = np.array([[1, 1, 3], [1, 2, 3], [2, 2, 3], [2, 1, 3.0]])
    return np.concatenate([world.enclosure.openings, [ceiling]])


@pytest.mark.parametrize("kind", ["box", "rooms", "own openings", "open"])
@pytest.mark.parametrize("block", [1 << 20, 8 * CLUSTER])
def test_every_possible_pair_comes_once(quads, kind, block, monkeypatch):
    monkeypatch.setattr(sun_clusters, "SHADOW_RAYS", block)
    points = RNG.random((60, 3)) * [3, 4, 3]
    points[:10, 1] = 1e-4  # beside the window
    normals, suns = directions(len(points)), directions(SUNS)
    within = mi.UInt32(np.arange(len(points)) % 7 > 0) if kind == "rooms" else None
    openings = None if kind == "open" else Openings(quads, within)
    if kind == "own openings":
        openings = Openings(quads, mi.UInt32(np.arange(len(points)) % 4), counts=(-1, 1, 0, 1))
    found = possible_pairs(openings, flat(points), flat(normals), suns, DIAMETER)
    pairs = np.concatenate([some.numpy() for some in found])
    expected = one_by_one(openings, points, normals, suns)
    assert len(pairs) == len(set(pairs.tolist()))
    assert set(pairs.tolist()) == expected
    assert 0 < len(expected) < len(points) * SUNS


def test_points_look_through_the_openings_of_their_own_room(quads):
    """Rooms 1 to 5 have the window, the ceiling's, none, both in turn, and too many to tell."""
    points, suns = RNG.random((60, 3)) * [3, 4, 3], directions(60)
    room = np.arange(60) % 6
    own = [None, quads[:1], quads[1:], quads[:0], quads, None]
    table = tuple(np.repeat(quads, 20, axis=0) if i == 5 else q for i, q in enumerate(own) if i)
    openings = Openings._of_rooms(table, mi.UInt32(room))
    row, (p, d) = (
        dr.arange(mi.UInt32, 60),
        (dr.unravel(mi.Vector3f, flat(x)) for x in (points, suns)),
    )
    passed = openings.passed(row, p, d, dr.opaque(mi.Float, 0.05)).numpy()
    for number, its in enumerate(own):
        alone = np.ones(60, bool)
        if its is not None:
            alone = Openings(its).passed(row, p, d, dr.opaque(mi.Float, 0.05)).numpy()
            alone = np.broadcast_to(alone, 60)
        np.testing.assert_array_equal(passed[room == number], alone[room == number])
    assert openings.are_elsewhere(row).numpy().tolist() == np.isin(room, [0, 5]).tolist()
    assert not openings.are_none
    assert Openings._of_rooms((quads[:0], quads[:0]), mi.UInt32([1, 2])).are_none
    assert not Openings._of_rooms((quads[:0], quads[:0]), mi.UInt32([1, 0])).are_none


def test_no_sun_or_no_opening_gives_no_pair(quads):
    points = flat(np.ones((2, 3)))
    assert [*possible_pairs(Openings(quads), points, points, np.zeros((0, 3)), DIAMETER)] == []
    assert [*possible_pairs(Openings(quads[:0]), points, points, directions(3), DIAMETER)] == []


def test_a_cluster_that_is_not_full_is_bounded_by_its_own_suns():
    angle = np.radians(np.linspace(0, 100, CLUSTER + 1))  # the first sun is left over
    suns = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    clusters = SunClusters.of(suns)
    assert clusters.members.numpy()[CLUSTER] == 0
    assert np.degrees(clusters.spread.numpy()[1]) < 0.1
