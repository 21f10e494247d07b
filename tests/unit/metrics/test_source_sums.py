"""Sums by sky and sun on the device against dense sums in double precision."""

import numpy as np
import pytest
from scipy import sparse

from drcmitsuba.metrics import source_sums

REPLICATES, SENSORS, PATCHES, SUNS, TIMES = 3, 7, 20, 9, 11


def numbers(suns):
    rng = np.random.default_rng(3)
    C = rng.random((REPLICATES, SENSORS, PATCHES + SUNS)).astype(np.float32)
    L = rng.random((TIMES, PATCHES)).astype(np.float32)
    patches = rng.permutation(PATCHES + SUNS)[:PATCHES]  # bins of C are in any order
    others = np.setdiff1d(np.arange(PATCHES + SUNS), patches)
    dense = np.zeros((TIMES, PATCHES + SUNS), np.float32)
    for time in range(TIMES - 1):  # none in the last hour
        dense[time, rng.permutation(others)[:suns]] = rng.random(suns)
    return C, patches, L, sparse.csr_matrix(dense)


@pytest.mark.parametrize("suns", [0, 1, 4])
@pytest.mark.parametrize(("together", "summed"), [(1 << 24, 512), (3 * 29 * 2, 8), (1, 1)])
def test_blocks_of_sensors_and_pieces_of_the_sky_add_up(monkeypatch, suns, together, summed):
    monkeypatch.setattr(source_sums, "TOGETHER", together)
    monkeypatch.setattr(source_sums, "SUMMED", summed)
    C, patches, L, light = numbers(suns)
    sky = np.einsum("tp,rsp->rts", L.astype(float), C[:, :, patches].astype(float))
    sun = np.einsum("tb,rsb->rts", light.toarray().astype(float), C.astype(float))
    out = source_sums.source_sums(C, patches, L, light)
    for name, E in (("sky", sky), ("sun", sun), ("total", sky + sun)):
        error = E.std(axis=0, ddof=1) / np.sqrt(REPLICATES)
        np.testing.assert_allclose(out[name], E.mean(axis=0), rtol=2e-6)
        np.testing.assert_allclose(out[f"{name}_se"], error, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("suns", [0, 1, 4])
@pytest.mark.parametrize(("replicates", "indexed"), [(1, 1 << 30), (REPLICATES, 1 << 30), (6, 1)])
def test_sums_at_some_entries_are_those_of_all(monkeypatch, suns, replicates, indexed):
    """Replicates that four do not divide, at once or by fours; entries in any order, some twice."""
    monkeypatch.setattr(source_sums, "INDEXED", indexed)
    C, patches, L, light = numbers(suns)
    C = (
        np.tile(C, (2, 1, 1))[:replicates]
        * np.arange(1, replicates + 1, dtype=np.float32)[:, None, None]
    )
    rng = np.random.default_rng(8)
    time, sensor = rng.integers(0, TIMES, 40), rng.integers(0, SENSORS, 40)
    sky = np.einsum("tp,rsp->rts", L.astype(float), C[:, :, patches].astype(float))
    whole = sky + np.einsum("tb,rsb->rts", light.toarray().astype(float), C.astype(float))
    E = source_sums.sums_at(C, patches, L, light, time, sensor)
    np.testing.assert_allclose(E, whole[:, time, sensor], rtol=2e-6)
    none = np.zeros(0, int)
    assert source_sums.sums_at(C, patches, L, light, none, none).shape == (replicates, 0)


@pytest.mark.parametrize(("times", "sensors"), [(0, SENSORS), (TIMES, 0)])
def test_no_time_stamp_and_no_sensor(times, sensors):
    C, patches, L, light = numbers(1)
    out = source_sums.source_sums(C[:, :sensors], patches, L[:times], light[:times])
    assert {E.shape for E in out.values()} == {(times, sensors)}
