"""Answers of films to suns by the parts of their disks, and light of exposed films as products."""

from dataclasses import replace
from itertools import pairwise

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import load_case
from drcmitsuba.case.furniture import Furniture
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.random_streams import Stream
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import pane_light, replicate
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.films import answers as film_answers
from drcmitsuba.transport.films import films as films_module
from drcmitsuba.transport.films.answers import EvenAnswer, SunCells, SunRadiance, disk_parts
from drcmitsuba.transport.films.films import Films
from drcmitsuba.transport.films.orientation import mounts

SUNS = np.array([[0.1, -0.7, 0.7], [0.6, -0.64, 0.48], [-0.5, -0.5, 0.7071], [0.3, 0.9, 0.316]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)
DIAMETER = 0.53


@pytest.fixture(scope="module")
def case():
    return load_case("classroom/reference/o2")


@pytest.fixture(scope="module")
def world(case):
    backend.select()
    return scene.load(case, "open")


@pytest.mark.parametrize(("diameter", "discrepancy"), [(DIAMETER, 0.002), (8.0, 0.006)])
def test_answer_to_suns_is_the_mean_of_f_over_their_disks(world, diameter, discrepancy):
    """Independent route: f at 20,000 random directions on each disk, weighed by the cosine."""
    [mount] = mounts(world)
    suns = SUNS[:3]
    answer = EvenAnswer.of(mount, suns, diameter)
    table = answer.to_suns(answer.f).numpy()
    rng = np.random.default_rng(1)
    brightest = np.argsort(-table.max(axis=1))[:20]
    for k, sun in enumerate(suns):
        cos = 1 - rng.random(20_000) * (1 - np.cos(np.radians(diameter / 2)))
        phi, x = 2 * np.pi * rng.random(cos.size), np.cross(sun, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        across = np.cos(phi)[:, None] * x + np.sin(phi)[:, None] * np.cross(sun, x)
        d = cos[:, None] * sun + np.sqrt(1 - cos**2)[:, None] * across
        wo = mount.turn.to_local(mi.Vector3f(d.T.astype(np.float32)))
        light = np.where(wo.z.numpy() < 0, np.abs(wo.z.numpy()), 0)
        for row in brightest:
            wi = mount.outgoing(dr.full(mi.UInt32, int(row), len(d)), mi.Point2f(0.3, 0.8))
            f = mount.bsdf.eval(mi.BSDFContext(), mount.interaction(wi), wo)[0].numpy()
            values = f[light > 0] / light[light > 0]
            mean = np.average(values, weights=light[light > 0])
            error = values.std() / np.sqrt(len(values))
            # By 262,144 directions, those of the program err by 0.2 % and 0.5 % of the largest f.
            margin = 4 * error + discrepancy * values.std() + 1e-5
            assert table[row, k] == pytest.approx(mean, abs=margin)


@pytest.mark.parametrize("decimals", [3, 4, 5, 6, 12])
def test_panes_with_rounded_corners_are_mounted_once(world, decimals):
    """Rounding turns panes of one façade by up to some thousandths: all have one orientation."""
    [film], (c, s) = world.films, (np.cos(np.radians(20)), np.sin(np.radians(20)))
    ends = pairwise([0, 1.1, 2.3, 3.4, 4.7, 6.0])
    quads = [[[a, 0, 1], [a, 0, 2.5], [b, 0, 2.5], [b, 0, 1]] for a, b in ends]
    quads = np.array(quads) @ [[c, s, 0], [-s, c, 0], [0, 0, 1]]
    panes = replace(film, quads=quads.round(decimals))
    mounted = mounts(replace(world, parts=(panes,)))
    each = sorted(quad.tobytes() for mount in mounted for quad in mount.quads)
    assert each == sorted(quad.tobytes() for quad in panes.quads)
    assert decimals == 3 or len(mounted) == 1


def test_parts_of_a_disk(world):
    [mount] = mounts(world)
    parts = disk_parts(mount, SUNS, DIAMETER)
    first, share = parts.first.numpy(), parts.share.numpy()
    assert len(first) == len(SUNS) + 1
    assert first[-1] == len(share)
    whole = np.add.reduceat(share, first[:-1])
    assert whole[:3] == pytest.approx(1, abs=1e-6)
    assert whole[3] == 0  # this sun stands behind the façade
    assert np.diff(first)[:3].max() <= 4
    small = disk_parts(mount, SUNS[:1], 1e-4)
    assert small.share.numpy() == pytest.approx([1])


def test_only_disks_that_a_cell_cuts_take_many_directions(world, monkeypatch):
    """Suns in the middle of a cell lie in it alone; one on the corner of four lies in all four."""
    [mount] = mounts(world)
    drawn = []
    on_disks = film_answers._on_disks

    def noted(mount, suns, diameter, sun, at):
        drawn.append(dr.width(sun))
        return on_disks(mount, suns, diameter, sun, at)

    monkeypatch.setattr(film_answers, "_on_disks", noted)
    rows = mi.UInt32([400, 401, 402, 403])
    inside = -mount.turn.to_world(mount.outgoing(rows, mi.Point2f(0.5))).numpy().T
    corner = -mount.turn.to_world(mount.outgoing(mi.UInt32(400), mi.Point2f(1e-6))).numpy().T
    parts = disk_parts(mount, np.concatenate([inside, corner]), DIAMETER)
    assert drawn[:2] == [5 * film_answers.RIM_POINTS, 4 + film_answers.DISK_POINTS]
    assert drawn[2:] == [dr.width(parts.d) // 3]  # one for each cell
    assert parts.first.numpy().tolist() == [0, 1, 2, 3, 4, 8]
    share = parts.share.numpy()
    np.testing.assert_allclose(share[:4], 1)
    np.testing.assert_allclose(share[4:6], share[[7, 6]], atol=1e-3)  # opposite ones
    assert share[4:].sum() == pytest.approx(1)
    assert share[4:].min() > 0.15


@pytest.mark.parametrize("subdivision", [1, None])
@pytest.mark.parametrize("count", [0, 4])
def test_product_is_the_sum_over_directions(world, case, monkeypatch, subdivision, count):
    suns = SUNS[:count]
    films = Films.of(world, 0.9, suns, DIAMETER)
    base = Deposit(world, suns, DIAMETER, subdivision, case.accuracy, None, films)
    lit = base.lit(0)
    rng = np.random.default_rng(5)
    points = rng.uniform([0.5, 0.5, 0.1], [8.0, 8.5, 2.5], (300, 3)).astype(np.float32)
    p, n = mi.Float(points.ravel()), mi.Float(np.tile([0, 0, 1], 300).astype(np.float32))
    by_product = lit.by_films(p, n, (Stream.SENSORS,))
    monkeypatch.setattr(films_module, "FEW_ROWS", 0)
    by_sum = lit.by_films(p, n, (Stream.SENSORS,))
    for some, other in zip(by_product, by_sum, strict=True):
        assert some.shape == other.shape
        values, sums = some.numpy(), other.numpy()
        np.testing.assert_allclose(values, sums, rtol=2e-3, atol=1e-6 * max(1, sums.max(initial=0)))
    if count:
        sun = by_sum.sun.numpy()
        assert sun[:, :3].max() > 0
        assert not sun[:, 3].any()


def test_light_by_incident_cells_is_told_by_sun_in_every_replicate(world):
    """Independent route: shares as a dense matrix, in NumPy; the last sun lights nothing."""
    [mount] = mounts(world)
    answer = EvenAnswer.of(mount, SUNS, DIAMETER)
    first, cell, share = (x.numpy() for x in answer.parts[:3])
    shares = np.zeros((answer.f.shape[1], len(SUNS)))
    np.add.at(shares, (cell, np.repeat(np.arange(len(SUNS)), np.diff(first))), share)
    rng = np.random.default_rng(3)
    values = rng.random((2, 5, len(shares))).astype(np.float32)
    shone = rng.random((2, len(SUNS))).astype(np.float32)
    suns = SunCells(answer.f, answer, mi.Float(shone.ravel()))
    sent = suns.sent(mi.TensorXf(values.reshape(10, -1))).numpy().reshape(2, 5, -1)
    np.testing.assert_allclose(sent, values @ shares * shone[:, None], rtol=1e-5)
    assert not sent[..., 3].any()


@pytest.mark.parametrize("count", [2, 4])
def test_exposed_film_whose_answer_is_not_even(world, case, monkeypatch, count):
    """Its light is a product by sun: the same as by incident cells where both can be made."""
    suns = SUNS[-count:]
    films = Films.of(world, 0.9, suns, DIAMETER)
    base = Deposit(world, suns, DIAMETER, 1, case.accuracy, None, films)
    lit = [base.lit(r) for r in range(2)]
    p = mi.Float([2.0, 1.0, 0.8, 4.4, 4.0, 0.8, 6.0, 7.5, 0.8])
    n = mi.Float([0.0, 0.0, 1.0] * 3)
    both = [dr.concat([x, x]) for x in (p, n)]
    numbers = [dr.arange(mi.UInt32, 3), dr.arange(mi.UInt32, 3) + 3]

    def light(kind):
        rest, parts = pane_light.by_panes(lit, *both, (Stream.SENSORS,), numbers)
        for K, of_parts in parts:
            assert isinstance(of_parts.suns, kind)
            rest = rest.plus(of_parts.through(K, 2))
        return rest.numpy()

    by_cells = light(SunCells)
    monkeypatch.setitem(vars(films), "even_answers", (None,))
    by_suns = light(SunRadiance)
    assert by_suns[:, -count:].any()
    np.testing.assert_allclose(by_cells, by_suns, rtol=1e-4, atol=1e-9)


def test_light_of_films_apart_from_cells_is_the_same(case, world, monkeypatch):
    """Light that stays apart, as a product of all replicates, and light that cells hold."""
    accuracy = case.accuracy.model_copy(update={"replicates": 2, "paths": 16})
    light = daylight(case)
    suns = light.suns.only(light.suns.labels[::60])
    points = np.array([[2.0, 1.0, 0.8], [4.4, 4.0, 0.8], [6.0, 7.5, 0.8]])
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    kept = []
    by_panes = replicate.by_panes

    def noted(*args):
        out = by_panes(*args)
        kept.append(len(out[1]))
        return out

    monkeypatch.setattr(replicate, "by_panes", noted)

    def values():
        return compute(world, points, normals, suns, accuracy)["replicates"].values

    apart = values()
    assert kept == [1] * len(kept)
    join = replicate.Replicates.join
    meet = replicate.Replicates.meet

    def met(self, *args):
        meet(self, *args)
        join(self)

    monkeypatch.setattr(replicate.Replicates, "meet", met)
    joined = values()
    monkeypatch.setattr(films_module, "FEW_ROWS", 0)
    summed = values()
    np.testing.assert_allclose(apart, joined, rtol=1e-3, atol=1e-8)
    np.testing.assert_allclose(apart, summed, rtol=1e-2, atol=1e-8)


def test_a_film_under_a_roof_has_narrow_patches_that_share_directions(case, monkeypatch):
    def shaded(corner, size):
        piece = Furniture(name="beyond", corner=corner, size=size, reflectance=0.3)
        world = scene.load(case.with_tables(furniture=(*case.furniture, piece)), "open")
        return Films.of(world, 0.9, SUNS, DIAMETER)

    drawn = []
    monkeypatch.setattr(
        films_module, "sky_answer",
        lambda scene, patches, mount, patch, subdivision, samples, seed: (
            drawn.append(samples) or dr.zeros(mi.Float, mount.rows * 146)
        ),
    )  # fmt: skip
    roof, tower = ((0, -1.2, 3.4), (8.8, 1.2, 0.1)), ((0, -12, 0), (8.8, 1, 9))
    wide, narrow = shaded(*tower), shaded(*roof)
    assert (wide.fineness, narrow.fineness) == ((1,), (3,))
    assert shaded((0, -4.0, 3.4), (8.8, 4.0, 0.1)).fineness == (3,)  # of which no corner is near
    assert len(narrow.patches) > 6 * len(wide.patches)
    for films in (wide, narrow):
        films.answer_to_sky(1, 256, 0)
    assert drawn == [256] * len(wide.patches) + [28] * len(narrow.patches)
    monkeypatch.setattr(films_module, "MOST_ROWS", 4 * len(wide.patches) * narrow.mounts[0].rows)
    assert shaded(*roof).fineness == (2,)


def test_replicates_share_answers_to_suns_but_not_the_light(world, case):
    films = Films.of(world, 0.9, SUNS, DIAMETER)
    base = Deposit(world, SUNS, DIAMETER, 1, case.accuracy, None, films)
    one, two = base.lit(0).on_films, base.lit(1).on_films
    assert one.to_suns is two.to_suns
    assert (one.to_sky.array.numpy() != two.to_sky.array.numpy()).any()


def test_a_direction_close_to_the_plane_of_the_film_tells_all_of_its_cell(world):
    """One direction stands for all suns in its incident cell, however little light it sends."""
    [mount] = mounts(world)
    x = mount.turn.to_world(mi.Vector3f(1, 0, 0)).numpy().ravel()
    z = mount.turn.to_world(mi.Vector3f(0, 0, 1)).numpy().ravel()
    high, grazing = x - 1e-2 * z, x - 1e-7 * z

    def f(sun):
        return EvenAnswer.of(mount, sun[None] / np.linalg.norm(sun), 1e-6).f.numpy()

    assert f(high).max() > 0
    np.testing.assert_allclose(f(grazing)[:, 0], f(high)[:, 0], rtol=1e-3)
