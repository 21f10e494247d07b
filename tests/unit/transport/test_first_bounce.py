"""Sums over first vertices against products of matrices."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend


@pytest.mark.parametrize(("sky", "suns"), [(146, 0), (1, 5), (3, 1)])
def test_paths_gather_what_a_matrix_gathers(sky, suns):
    backend.select()
    from drcmitsuba.transport.deposit import Irradiance
    from drcmitsuba.transport.first_bounce import CellLight

    rng = np.random.default_rng(sky)
    cells, blocks, sensors, paths = 50, 7, 11, 6

    def random(*shape):
        return rng.random(shape, np.float32)

    D, X = ((random(n, sky), random(n, suns)) for n in (cells, blocks))
    block, cell = rng.integers(0, blocks, cells), rng.integers(0, cells, sensors * paths)
    weight = random(sensors * paths) * (rng.random(sensors * paths) < 0.7)
    H = np.concatenate(D, axis=1) + np.concatenate(X, axis=1)[block]
    expected = (weight[:, None] * H[cell]).reshape(sensors, paths, -1).sum(axis=1)
    tensors = [Irradiance(*(mi.TensorXf(part) for part in both)) for both in (D, X)]
    light = CellLight.of(*tensors, mi.UInt32(block.astype(np.uint32)))
    ours = light.gathered(mi.UInt32(cell.astype(np.uint32)), mi.Float(weight), paths)
    assert dr.width(light.values) % 4 == 0
    np.testing.assert_allclose(ours, expected, rtol=2e-6)


def test_both_ways_to_gather_give_the_same_coefficients(monkeypatch):
    from tests.unit.transport.test_cells_and_transfer import CASE, Case, of_case

    backend.select()
    case = Case.model_validate(CASE)
    by_matrix = of_case(case, cells=True)["replicates"].values
    monkeypatch.setattr("drcmitsuba.transport.first_bounce.MANY", 0)
    by_paths = of_case(case, cells=True)["replicates"].values
    np.testing.assert_allclose(by_paths, by_matrix, rtol=1e-5, atol=1e-7)
