"""Rays that are looked for by the openings they pass are the same as those found among all rays."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.scene import scene as scenes
from drcmitsuba.transport.rays import even_rays
from drcmitsuba.transport.rays.even_rays import EvenRays, runs
from drcmitsuba.transport.rays.openings import Openings
from tests.unit.transport.exact_scenes import WINDOW, flat, glazing, room

RAYS = 1024
RNG = np.random.default_rng(3)


def receivers(size, windows):
    """Points anywhere, in all directions; on the walls; and close to the windows, also outside."""
    anywhere, near = RNG.random((400, 3)), RNG.random((200, 3))
    near[:, 1] = 10.0 ** RNG.uniform(-6, -1, 200) * np.where(np.arange(200) % 4, 1, -1)
    on_walls = RNG.random((100, 3))
    on_walls[np.arange(100), np.arange(100) % 3] = np.arange(100) % 2
    p = np.concatenate([anywhere, near, on_walls]) * size
    n = RNG.normal(size=p.shape)
    n[::3] = np.round(n[::3] / abs(n[::3]).max(axis=1, keepdims=True))  # along axes and diagonals
    edges = windows[:, np.array([0, 2])].reshape(-1, 3)  # opposite corners
    p = np.concatenate([p, np.repeat(edges, 5, axis=0) + [0, 0.01, 0]])
    n = np.concatenate([n, RNG.normal(size=(len(p) - len(n), 3))])
    return p, n / np.linalg.norm(n, axis=1, keepdims=True)


@pytest.mark.parametrize("rotation", [0.0, 33.0])
def test_no_ray_that_passes_an_opening_is_left_out(rotation, monkeypatch):
    world = scenes.load(room(WINDOW, {"glass": glazing(0.6)}, rotation))
    quads = world.enclosure.openings
    turn = world.enclosure.turn
    points, normals = receivers(np.array([3, 4, 3]), quads @ turn)
    points, normals = points @ turn.T, normals @ turn.T
    # Openings that overlap, one seen through the other, and one in the ceiling.
    ceiling = np.array([[1, 1, 3], [1, 2, 3], [2, 2, 3], [2, 1, 3.0]]) @ turn.T
    openings = Openings(np.concatenate([quads, quads[:1] + 0.2 * turn[:, 0], [ceiling]]))
    count = len(points)
    rays = EvenRays.of(
        flat(points), flat(normals), dr.arange(mi.UInt32, count), 0, count, RAYS, 7
    )  # fmt: skip

    def wanted(d):
        return d.z > -0.9

    def sorted_rays(some):
        row = np.concatenate([one.receiver.numpy() for one in some])
        d = np.concatenate([dr.ravel(one.d).numpy().reshape(-1, 3) for one in some])
        order = np.lexsort((*d.T, row))
        return row[order], d[order]

    found = [runs(openings, i, rays.p, rays.n, rays.shifts, RAYS) for i in range(3)]
    each = [rays._by(i, some, wanted, openings) for i, some in enumerate(found)]
    by_opening = sorted_rays([one for some in each for one in some])
    monkeypatch.setattr(even_rays, "MOST_OPENINGS", 0)
    among_all = sorted_rays([*rays.leaving(wanted, openings)])
    assert len(among_all[0]) > 10_000
    for mine, theirs in zip(by_opening, among_all, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_few_rays_are_made_from_a_work_plane():
    world = scenes.load(room(WINDOW, {"glass": glazing(0.6)}))
    x, y = np.meshgrid(np.linspace(0.5, 2.5, 5), np.linspace(1, 3.5, 6))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(30, 0.8)])
    up = np.tile([0.0, 0, 1], (30, 1))
    rays = EvenRays.of(flat(points), flat(up), dr.arange(mi.UInt32, 30), 0, 30, RAYS, 7)
    openings = Openings(world.enclosure.openings)
    assert rays._found(openings) is not None
    made = dr.sum(mi.Float(runs(openings, 0, rays.p, rays.n, rays.shifts, RAYS).count))[0]
    (passed,) = (dr.width(one.d) for one in rays.leaving(lambda d: mi.Bool(True), openings))
    assert passed <= made < 0.4 * 30 * RAYS
