"""Sums over all bounces and their derivatives, against series and differences."""

import drjit as dr
import numpy as np
import pytest

from drcmitsuba.design.room_matrices import AllBounces
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat

SIZE = 4


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def matrices():
    """Light that blocks of two rooms send to one another; rows return at most 0.8."""
    t = np.random.default_rng(1).random((2, SIZE, SIZE))
    return 0.8 * t / t.sum(axis=2, keepdims=True)


def series(t):
    return sum(np.linalg.matrix_power(t, n) for n in range(200))


def test_sum_of_all_bounces_is_the_series():
    M = dr.custom(AllBounces, flat(matrices()), SIZE)
    assert M.numpy() == pytest.approx(series(matrices()).ravel(), rel=1e-5)


def test_a_closed_white_room_has_a_sum():
    white = np.full((1, SIZE, SIZE), 1 / SIZE)
    assert np.isfinite(dr.custom(AllBounces, flat(white), SIZE).numpy()).all()


@pytest.mark.parametrize("mode", ["forward", "backward"])
def test_derivatives_are_differences(mode):
    rng, h = np.random.default_rng(2), 1e-5
    change, weight = rng.random((2, 2, SIZE, SIZE))
    up, down = (series(matrices() + sign * h * change) for sign in (1, -1))
    expected = ((up - down) * weight).sum() / (2 * h)
    t = flat(matrices())
    dr.enable_grad(t)
    M = dr.custom(AllBounces, t, SIZE)
    if mode == "forward":
        dr.set_grad(t, flat(change))
        dr.enqueue(dr.ADMode.Forward, t)
        dr.traverse(dr.ADMode.Forward)
        slope = (dr.grad(M).numpy() * weight.ravel()).sum()
    else:
        dr.backward(dr.sum(M * flat(weight)))
        slope = (dr.grad(t).numpy() * change.ravel()).sum()
    assert slope == pytest.approx(expected, rel=1e-4)
