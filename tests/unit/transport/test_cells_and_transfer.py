"""Light between surfaces solved on cells: closed forms, and paths that follow all bounces."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import sparse

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients, replicate
from drcmitsuba.transport.cells.cells import CellGrid, Cells
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.elements.paths import FollowedPaths, OutsideRooms
from drcmitsuba.transport.gather.blocks import Gathered, Met
from drcmitsuba.transport.interreflection import cell_rays
from drcmitsuba.transport.interreflection.solved_cells import solved

SUNS = np.array([[0.2, -0.75, 0.5], [0.5, -0.5, 0.6]])
SUNS = Suns(("sun_0", "sun_1"), SUNS / np.linalg.norm(SUNS, axis=1, keepdims=True), 5.0)
CASE = {
    "room": {"size": [3.0, 4.0, 2.8], "floor": 0.3, "walls": 0.6, "ceiling": 0.8},
    "facade": {"south": {"strips": [{"bottom": 0.8, "top": 2.4, "material": "glass"}]}},
    "materials": {"glass": {"type": "glazing", "transmittance": 0.7, "reflectance": 0.1}},
    "furniture": [
        {"name": "desk", "corner": [1, 1.5, 0.7], "size": [1.2, 0.6, 0.03], "reflectance": 0.5}
    ],
    "sensors": {"corner": [0.4, 0.4, 0.8], "count": [4, 5], "spacing": 0.7},
    "accuracy": {
        "replicates": 8, "paths": 256, "cell_size": 0.5, "sensor_sky_rays": 64,
        "cell_sky_rays": 64, "sensor_sun_samples": 4,
    },
}  # fmt: skip


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def closed_box(reflectance, accuracy):
    """Transfer in a closed box of one reflectance, seen by one sensor in its middle."""
    x, y, z = 3.0, 4.0, 2.5
    corners = np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]], float)
    top = corners + [0, 0, z]
    sides = [[corners[(i + 1) % 4], corners[i], top[i], top[(i + 1) % 4]] for i in range(4)]
    quads = np.array([corners, top[::-1], *sides])
    world = scene.build([Surface("box", Lambertian(reflectance), quads)])
    point, normal = np.array([[1.5, 2.0, 1.2]]), np.array([[0.0, 0.0, 1.0]])
    seen = Gathered.of(world, point, normal, accuracy, block=1, lanes=1 << 16, once=True)
    return solved(world, seen, accuracy)


@pytest.mark.parametrize("reflectance", [0.2, 0.8, 0.99])
def test_even_light_in_a_closed_box_is_reflected_to_the_sum_of_its_series(reflectance):
    seen, transfer = closed_box(reflectance, Accuracy(paths=256, replicates=2))
    even = dr.ones(mi.TensorXf, (seen.cells.count, 1))
    Y = transfer.indirect(range(1), even)
    expected = reflectance / (1 - reflectance)
    assert Y.numpy() == pytest.approx(expected, rel=2e-4 + 2e-6 / (1 - reflectance) ** 2)


def test_a_closed_box_that_absorbs_nothing_has_a_finite_sum():
    seen, transfer = closed_box(1.0, Accuracy(paths=64, cell_paths=16, replicates=2))
    X = transfer.indirect(range(1), dr.ones(mi.TensorXf, (seen.cells.count, 1)))
    assert np.isfinite(X.numpy()).all()
    assert X.numpy().max() > 1e4


def of_case(case, *, cells, **accuracy):
    world = scene.load(case, effects=EnabledEffects(solved_cells=cells))
    settings = case.accuracy.model_copy(update=accuracy)
    return coefficients.compute(world, *sensor_points(case), SUNS, settings)


def test_solved_cells_and_paths_agree(same):
    case = Case.model_validate(CASE)
    cells = of_case(case, cells=True, paths=1024)["replicates"].values
    paths = of_case(case, cells=False, paths=1024, seed=1)["replicates"].values
    for bins in (slice(0, 1), slice(1, 146), slice(146, None)):
        mine, theirs = (C[..., bins].sum(axis=2) for C in (cells, paths))
        same(mine, other=theirs, within=0.02)


def test_blocks_keep_the_light_of_a_corridor_where_it_falls():
    """Light between a sunlit end and a dark one is that of T solved cell by cell, by place."""
    room = {"size": [2.0, 16.0, 3.0], "floor": 0.2, "walls": 0.5, "ceiling": 0.8}
    sensors = {"corner": [0.25, 0.5, 0.8], "count": [3, 31], "spacing": 0.5}
    case = Case.model_validate(CASE | {"room": room, "furniture": [], "sensors": sensors})
    world = scene.load(case, effects=EnabledEffects(solved_cells=True))
    points, accuracy = sensor_points(case), Accuracy()
    seen = Gathered.of(world, *points, accuracy, block=len(points[0]), lanes=1 << 16, once=True)
    seen, transfer = solved(world, seen, accuracy)
    mine, whole = [], []
    for r in range(accuracy.replicates):
        at = seen.drawn.of(range(r, r + 1)).p.numpy().reshape(-1, 3)
        lit = ((at[:, 1] < 3) & (at[:, 2] < 0.1)).astype(np.float32)
        light = transfer.indirect(range(r, r + 1), mi.TensorXf(lit[:, None])).numpy()[:, 0]
        all_bounces = sparse.identity(transfer.cells, format="csc") - transfer.matrix(r).tocsc()
        exact = sparse.linalg.spsolve(all_bounces, lit) - lit
        part = (at[:, 1] // 2).astype(int)
        mine.append(np.bincount(part, light))
        whole.append(np.bincount(part, exact))
    off = np.sum(mine, axis=0) / np.sum(whole, axis=0) - 1
    assert np.abs(off).max() < 0.015
    assert np.sqrt((off**2).mean()) < 0.01


def test_launches_of_any_size_give_the_same_coefficients(monkeypatch):
    case = Case.model_validate(CASE)
    whole = of_case(case, cells=True)["interreflected"]
    monkeypatch.setattr(cell_rays, "PATHS", 1 << 14)
    parts = of_case(case, cells=True)["interreflected"]
    np.testing.assert_allclose(parts, whole, rtol=2e-4, atol=1e-6 * float(whole.max()))


def test_replicates_are_the_same_in_one_launch_and_in_many(monkeypatch):
    case = Case.model_validate(CASE)
    whole = of_case(case, cells=True)["replicates"].values
    monkeypatch.setattr(replicate, "TOGETHER", 1)
    apart = of_case(case, cells=True)["replicates"].values
    np.testing.assert_allclose(apart, whole, rtol=1e-5, atol=1e-7 * whole.max())


def test_replicates_differ_in_all_that_they_draw():
    case = Case.model_validate(CASE)
    C = of_case(case, cells=True)["replicates"].values[:, :, 0]
    assert len(np.unique(C, axis=0)) == len(C)


def test_weighted_draws_follow_the_weights():
    weights, n = np.array([1.0, 3.0, 0.0, 4.0]), 1 << 12
    cell = dr.repeat(dr.arange(mi.UInt32, n), 4)  # four vertices in each cell
    weight = dr.tile(mi.Float(weights), n)
    zero = dr.zeros(mi.UInt32, 4 * n)
    p = mi.Float(np.repeat(np.tile(np.arange(4.0), n), 3))
    vertices = Vertices(zero, weight, cell, dr.arange(mi.UInt32, 4 * n), p, p)
    first, second = CellPoints.none(2).extended(vertices, cell, n).apart()
    for one in (first, second):
        counts = np.bincount(one.p.numpy()[::3].astype(int), minlength=4)
        expected = n * weights / weights.sum()
        assert counts == pytest.approx(expected, abs=4.5 * np.sqrt(expected.max()))
        assert counts[2] == 0
    assert (first.p.numpy() != second.p.numpy()).any()


def test_each_replicate_draws_from_its_own_vertices():
    """A cell that a replicate has not met takes the point of the next one that has."""
    own, cell = np.array([0, 0, 1, 1, 2, 2]), np.array([0, 1, 1, 1, 0, 2])
    number = dr.arange(mi.UInt32, 6)
    at = mi.Float(np.repeat(np.arange(6.0), 3))
    vertices = Vertices(number, mi.Float([1, 1, 0, 1, 1, 1]), number, number, at, at)
    column = mi.UInt32(cell.astype(np.uint32)), 3
    of = mi.UInt32(own.astype(np.uint32))
    drawn = CellPoints.none(3).extended(vertices, *column, own=of)
    points = drawn.p.numpy()[::3].reshape(3, -1)
    np.testing.assert_array_equal(points, [[0, 1, 5], [4, 3, 5], [4, 1, 5]])
    # A vertex of its own takes the place of a lent one, whatever their weights.
    more = Vertices(number, mi.Float([0, 0, 1e-3, 0, 0, 0]), number, number, at, at)
    of = mi.UInt32([0, 0, 2, 0, 0, 0])
    again = drawn.extended(more, *column, own=of)
    points = again.p.numpy()[::3].reshape(3, -1)
    np.testing.assert_array_equal(points, [[0, 1, 5], [4, 3, 5], [4, 2, 5]])


def test_draws_are_extended_as_if_made_at_once():
    n = 1 << 10
    key = mi.UInt32(np.arange(2 * n) % 64)
    p = mi.Float(np.repeat(np.arange(2.0 * n), 3))
    weight = mi.Float(np.random.default_rng(0).random(2 * n))
    whole = Vertices(key, weight, key, dr.arange(mi.UInt32, 2 * n), p, p)

    def part(start):
        at = dr.arange(mi.UInt32, n) + start
        three = dr.arange(mi.UInt32, 3 * n) + 3 * start
        column = {c: dr.gather(mi.UInt32, getattr(whole, c), at) for c in ("row", "key", "tag")}
        weights = dr.gather(mi.Float, whole.weight, at)
        return replace(whole, **column, weight=weights, **dict.fromkeys(
            ("p", "n"), dr.gather(mi.Float, whole.p, three)))  # fmt: skip

    at_once = CellPoints.none(3).extended(whole, whole.key, 64)
    halves = CellPoints.none(3).extended(part(0), part(0).key, 64)
    halves = halves.extended(part(n), part(n).key, 64)
    np.testing.assert_array_equal(at_once.p.numpy(), halves.p.numpy())


def test_a_black_room_has_no_cells():
    black = {**CASE["room"], "floor": 0.0, "walls": 0.0, "ceiling": 0.0}
    opaque = {"glass": {**CASE["materials"]["glass"], "reflectance": 0.0}}
    C = of_case(
        Case.model_validate(CASE | {"room": black, "materials": opaque, "furniture": []}),
        cells=True,
    )
    assert (C["interreflected"] == 0).all()
    assert (C["direct"] > 0).any()


def test_no_block_lies_in_two_rooms():
    """Cells in a row that face one way; paths with a mark alone meet them, as tiles of walls."""
    count = dr.arange(mi.UInt32, 6)
    index = dr.full(mi.UInt32, 0xFFFFFFFF, 6 * 6)
    dr.scatter(index, count, 6 * count + 4)
    cells = Cells(CellGrid((0.0, 0.0, 0.0), (6, 1, 1), 1.0), index, 6)
    rooms = mi.UInt32([1, 1, 2, 2, 0, 0] * 2)
    places = dr.zeros(mi.Float, 3 * 12)
    drawn = CellPoints(2, 6, mi.UInt32(1), places, places, rooms)
    met = Met(dr.zeros(mi.UInt32, 6), count, dr.ones(mi.Float, 6), dr.ones(mi.UInt32, 6))
    gathered = Gathered(None, (slice(0, 1),), cells, drawn, {0: met})
    paths = FollowedPaths(gathered, OutsideRooms(np.zeros(1, bool), np.zeros(6, bool)))
    blocks = [cells.flat_blocks(3, drawn.rooms)[0].numpy(), paths._blocks[0].numpy()]
    for block in blocks:
        told = np.array([1, 1, 2, 2, 0, 0])
        assert all(len(set(told[block == b])) == 1 for b in np.unique(block))
    assert len(np.unique(cells.flat_blocks(3)[0].numpy())) < len(np.unique(blocks[0]))
