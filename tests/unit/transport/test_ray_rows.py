"""Sparse products of rays against matrices of NumPy."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend


@pytest.mark.parametrize("rays", [0, 1, 500])
def test_rows_of_rays_times_an_array_are_a_product_of_matrices(rays):
    backend.select()
    from drcmitsuba.transport.ray_rows import RayRows, narrowed, widened

    rng, rows, inner, columns = np.random.default_rng(rays), 7, 11, 6
    row, column = rng.integers(0, rows, rays), rng.integers(0, inner, rays)
    weight = rng.random(rays, np.float32) * (rng.random(rays) < 0.8)
    T = np.zeros((rows, inner))
    np.add.at(T, (row, column), weight)
    dense = rng.random((inner, columns), np.float32)
    matrix = RayRows.sorted_by(
        mi.UInt32(row.astype(np.uint32)), mi.UInt32(column.astype(np.uint32)),
        mi.Float(weight.astype(np.float32)), rows,
    )  # fmt: skip
    values, width = widened(mi.Float(dense.ravel()), inner, columns)
    assert width == 8
    out = narrowed(matrix.times(values, width), rows, columns)
    np.testing.assert_allclose(out.numpy().reshape(rows, columns), T @ dense, rtol=1e-5, atol=1e-6)
