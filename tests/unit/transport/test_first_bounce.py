"""Sums over first vertices against products of matrices."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend


@pytest.mark.parametrize("replicates", [1, 3])
@pytest.mark.parametrize(("sky", "suns"), [(146, 0), (1, 5), (3, 1)])
def test_paths_gather_what_a_matrix_gathers(sky, suns, replicates):
    backend.select()
    from drcmitsuba.transport.gather.blocks import Met
    from drcmitsuba.transport.interreflection.first_bounce import CellLight
    from drcmitsuba.transport.light.irradiance import Irradiance

    rng = np.random.default_rng(sky)
    cells, sensors, paths = 50, 11, 6
    size = replicates, sensors * paths
    H = rng.random((replicates, cells, sky + suns), np.float32)
    cell = rng.integers(0, cells, size)
    weight = rng.random(size, np.float32) * (rng.random(size) < 0.7)
    sent = weight[..., None] * np.take_along_axis(H, cell[..., None], axis=1)
    expected = sent.reshape(replicates * sensors, paths, -1).sum(axis=1)
    parts = (H[..., :sky], H[..., sky:])
    light = CellLight.of(
        Irradiance(*(mi.TensorXf(part.reshape(replicates * cells, -1).copy()) for part in parts))
    )
    met = Met(mi.UInt32(), mi.UInt32(cell.ravel().astype(np.uint32)), mi.Float(weight.ravel()))
    ours = light.gathered(met, replicates, paths, (sky, suns))
    assert dr.width(light.values) % 4 == 0
    assert [part.shape for part in ours] == [(replicates * sensors, n) for n in (sky, suns)]
    joined = np.concatenate([part.numpy() for part in ours], axis=1)
    np.testing.assert_allclose(joined, expected, rtol=2e-6)


def test_both_ways_to_gather_give_the_same_coefficients(monkeypatch):
    from tests.unit.transport.test_cells_and_transfer import CASE, Case, of_case

    backend.select()
    case = Case.model_validate(CASE)
    by_matrix = of_case(case, cells=True)["replicates"].values
    monkeypatch.setattr("drcmitsuba.transport.interreflection.first_bounce.MANY", 0)
    by_paths = of_case(case, cells=True)["replicates"].values
    np.testing.assert_allclose(by_paths, by_matrix, rtol=1e-5, atol=1e-7)
