"""Products of rays and light: pieces, replicates, bins without light, and the same every time."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.transport.light import products
from drcmitsuba.transport.light.lit_cells import LitCells
from drcmitsuba.transport.light.products import Columns, PathMatrix, RayMatrix, product
from tests.unit.transport.test_cells_and_transfer import closed_box

ROWS, CELLS, BINS, REPLICATES = 5, 40, 7, 3
RNG = np.random.default_rng(4)


def rays(count):
    row = RNG.integers(0, REPLICATES * ROWS, count)
    cell, weight = RNG.integers(0, CELLS, count), RNG.random(count).astype(np.float32)
    there = RNG.random(count) < 0.8
    matrix = RayMatrix(
        mi.UInt32(row.astype(np.uint32)), mi.UInt32(cell.astype(np.uint32)), mi.Float(weight),
        ROWS, REPLICATES, mi.Bool(there),
    )  # fmt: skip
    dense = np.zeros((REPLICATES, ROWS, CELLS))
    np.add.at(dense, (row // ROWS, row % ROWS, cell), weight * there)
    return matrix, dense


def paths(each):
    """Paths of two replicates more than are summed, half of them without a vertex."""
    rows = (REPLICATES + 2) * ROWS
    cell = RNG.integers(0, CELLS, (rows, each))
    weight = (RNG.random((rows, each)) * (RNG.random((rows, each)) < 0.5)).astype(np.float32)
    matrix = PathMatrix(flat_indices(cell), flat(weight), each, ROWS, REPLICATES, first=1)
    dense = np.zeros((rows, CELLS))
    np.add.at(dense, (np.arange(rows)[:, None], cell), weight)
    return matrix, dense.reshape(-1, ROWS, CELLS)[1:-1]


def light():
    D = RNG.random((REPLICATES, CELLS, BINS)).astype(np.float32)
    D[:, RNG.random(CELLS) < 0.4] = 0
    D[..., 2] = 0
    return mi.TensorXf(D.reshape(-1, BINS)), D.astype(float)


@pytest.mark.parametrize(("summed", "together"), [(512, 1 << 24), (7, 1 << 24), (7, 1)])
@pytest.mark.parametrize("made", [lambda: rays(1000), lambda: paths(70)], ids=["rays", "paths"])
def test_pieces_of_the_lit_cells_add_up(monkeypatch, summed, together, made):
    monkeypatch.setattr(products, "SUMMED", summed)
    monkeypatch.setattr(products, "TOGETHER", together)
    (matrix, G), (d, D) = made(), light()
    added, A = rays(300)
    expected = {None: G @ D, added.columns: (G + A) @ D}
    for further, values in expected.items():
        C = product(matrix, d, None, further).numpy().reshape(values.shape)
        np.testing.assert_allclose(C, values, rtol=1e-5)
        assert not C[..., 2].any()


@pytest.mark.parametrize("summed", [512, 3])
@pytest.mark.parametrize("made", [lambda: rays(1000), lambda: paths(70)], ids=["rays", "paths"])
def test_tiles_of_bins_have_the_product_of_all(monkeypatch, summed, made):
    """A dark tile, one of a single bin, and cells that only one tile lights; else as above."""
    monkeypatch.setattr(products, "SUMMED", summed)
    (matrix, G), (_, D) = made(), light()
    tiles = [np.array([4, 0]), np.array([2]), np.array([6, 1, 5]), np.array([3])]
    D[:, ::3, tiles[0]] = D[:, 1::3, tiles[2]] = 0
    d = mi.TensorXf(D.reshape(-1, BINS).astype(np.float32))
    reached = LitCells.by(d, REPLICATES, tiles)
    assert reached.lit.numpy().tolist() == np.flatnonzero(D.any(axis=(0, 2))).tolist()
    assert reached.shining.numpy().tolist() == [0, 1, 3, 4, 5, 6]
    assert [tile.bins.numpy().tolist() for tile in reached.tiles] == [[4, 0], [6, 1, 5], [3]]
    for tile in reached.tiles:
        own = np.flatnonzero(D[..., tile.bins.numpy()].any(axis=(0, 2)))
        assert reached.lit.numpy()[tile.lit.numpy()].tolist() == own.tolist()
    added, A = rays(300)
    expected = {None: G @ D, added.columns: (G + A) @ D}
    for further, values in expected.items():
        C = product(matrix, d, reached, further).numpy().reshape(values.shape)
        np.testing.assert_allclose(C, values, rtol=1e-5)
        assert not C[..., 2].any()


def test_columns_of_several_cells_have_the_paths_of_all():
    (matrix, G), block = paths(70), RNG.integers(0, 4, CELLS)
    joined = matrix.columns(Columns(flat_indices(block), 0, 4, 1))
    expected = np.stack([G[..., block == b].sum(axis=-1) for b in range(4)], axis=-1)
    np.testing.assert_allclose(joined.numpy(), expected.reshape(-1, 4), rtol=1e-6)


def test_many_paths_of_a_row_do_not_drift():
    """A tenth and a tenth …: in single precision, half a million sum up to 1 % less."""
    each = 1 << 19
    weight = dr.full(mi.Float, 0.1, each)
    matrix = PathMatrix(dr.zeros(mi.UInt32, each), weight, each, 1, 1)
    total = matrix.columns(Columns(dr.zeros(mi.UInt32, 1), 0, 1, 1)).numpy()[0, 0]
    assert total == pytest.approx(each * float(np.float32(0.1)), rel=1e-6)


def test_dark_light_and_no_rays_give_nothing():
    matrix, _ = rays(10)
    dark = dr.zeros(mi.TensorXf, (REPLICATES * CELLS, BINS))
    for tiles in ((), [np.arange(4), np.arange(4, BINS)]):
        lit, shining, parts = LitCells.by(dark, REPLICATES, tiles)
        assert (dr.width(lit), dr.width(shining), parts) == (0, 0, ())
    assert not product(matrix, dark).numpy().any()
    assert product(matrix, dr.zeros(mi.TensorXf, (REPLICATES * CELLS, 0))).shape == (15, 0)


def test_sums_do_not_depend_on_the_order_of_threads():
    """Rays of one row in several threads; sums in single precision fail this."""
    (matrix, _), (d, _) = rays(400_000), light()
    first = product(matrix, d).numpy()
    for _ in range(20):
        np.testing.assert_array_equal(product(matrix, d).numpy(), first)


@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("idle", [0, 20])
def test_what_sensors_gather_is_the_same_by_light_on_cells_and_by_the_matrix_of_all_bounces(
    steps, idle
):
    replicates, bins = 2, 3
    seen, transfer = closed_box(0.7, Accuracy(paths=256, replicates=replicates))
    cells, every = seen.cells.count, range(replicates)
    bounces = tuple(
        b._replace(weight=dr.select(b.source < cells - idle, b.weight, 0)) for b in transfer.bounces
    )
    transfer = replace(transfer, bounces=bounces, steps=steps, sending=cells - idle)
    D = RNG.random((replicates * cells, bins)).astype(np.float32)
    d = mi.TensorXf(D)
    met = seen.met(seen.blocks[0])
    to_cells = PathMatrix(met.cell, met.weight, 256, 1, replicates)
    by_light = product(to_cells, d + transfer.indirect(every, d))
    whole, onward = transfer.followed(every, to_cells, slice(0, 1))
    by_matrix = product(whole, d, None, onward)
    np.testing.assert_allclose(by_matrix.numpy(), by_light.numpy(), rtol=1e-5)
    assert transfer.pays(1, 1000, 100, 1 << 20)
    assert not transfer.pays(10_000, 100, 100, 1 << 20)


def test_the_last_bounces_are_followed_cell_by_cell():
    """Y = T·(D + Y) from the light of blocks, by NumPy."""
    seen, transfer = closed_box(0.7, Accuracy(paths=256, replicates=2))
    cells, blocks = seen.cells.count, transfer.blocks
    T, (source, cell, weight) = np.zeros((cells, cells)), transfer.bounces[0]
    np.add.at(T, (source.numpy(), cell.numpy()), weight.numpy())
    D = RNG.random((cells, 2)).astype(np.float32)
    P = np.zeros((cells, blocks.count))
    P[np.arange(cells), blocks.of.numpy()] = 1
    W = P.T * blocks.share.numpy()
    X = np.linalg.solve(np.eye(blocks.count) - W @ T @ P, W @ T @ D)
    Y = P @ X
    sends = T.any(axis=1, keepdims=True)
    for steps in range(3):
        ours = replace(transfer, steps=steps).indirect(range(1), mi.TensorXf(D))
        np.testing.assert_allclose(ours.numpy(), Y, rtol=2e-5)
        Y = np.where(sends, T @ (D + Y), P @ X)
