"""Products of rays and light: pieces, replicates, bins without light, and the same every time."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.transport import products
from drcmitsuba.transport.products import RayMatrix, Reached, product
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


def light():
    D = RNG.random((REPLICATES, CELLS, BINS)).astype(np.float32)
    D[:, RNG.random(CELLS) < 0.4] = 0
    D[..., 2] = 0
    return mi.TensorXf(D.reshape(-1, BINS)), D.astype(float)


@pytest.mark.parametrize(("summed", "together"), [(512, 1 << 24), (7, 1 << 24), (7, 1)])
def test_pieces_of_the_lit_cells_add_up(monkeypatch, summed, together):
    monkeypatch.setattr(products, "SUMMED", summed)
    monkeypatch.setattr(products, "TOGETHER", together)
    (matrix, G), (d, D) = rays(1000), light()
    added, A = rays(300)
    expected = {None: G @ D, added.columns: (G + A) @ D}
    for further, values in expected.items():
        C = product(matrix, d, None, further).numpy().reshape(values.shape)
        np.testing.assert_allclose(C, values, rtol=1e-5)
        assert not C[..., 2].any()


def test_dark_light_and_no_rays_give_nothing():
    matrix, _ = rays(10)
    dark = dr.zeros(mi.TensorXf, (REPLICATES * CELLS, BINS))
    assert [dr.width(x) for x in Reached.by(dark, REPLICATES)] == [0, 0]
    assert not product(matrix, dark).numpy().any()
    assert product(matrix, dr.zeros(mi.TensorXf, (REPLICATES * CELLS, 0))).shape == (15, 0)


def test_sums_do_not_depend_on_the_order_of_threads():
    """Rays of one row in several threads; sums in single precision fail this."""
    (matrix, _), (d, _) = rays(400_000), light()
    first = product(matrix, d).numpy()
    for _ in range(20):
        np.testing.assert_array_equal(product(matrix, d).numpy(), first)


def test_what_sensors_gather_is_the_same_by_light_on_blocks_and_by_the_matrix_of_all_bounces():
    replicates, bins = 2, 3
    seen, transfer = closed_box(0.7, Accuracy(paths=256, replicates=replicates))
    cells, every = seen.cells.count, range(replicates)
    D = RNG.random((replicates * cells, bins)).astype(np.float32)
    d = mi.TensorXf(D)
    met = seen.met(seen.blocks[0])
    to_cells = RayMatrix(met.row, met.cell, met.weight, 1, replicates, met.weight > 0)
    block = dr.gather(mi.UInt32, transfer.blocks.of, met.cell)
    X = transfer.indirect(every, d)
    to_blocks = to_cells._replace(cell=block)
    by_blocks = product(to_cells, d) + product(to_blocks, X)
    by_matrix = product(to_cells, d, None, transfer.onward(every, to_blocks))
    np.testing.assert_allclose(by_matrix.numpy(), by_blocks.numpy(), rtol=1e-5)
    assert transfer.pays(1, 1000, 100)
    assert not transfer.pays(10_000, 100, 100)
