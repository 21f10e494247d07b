"""Fixtures that the tests share: variants, the shared data, and what "the same" means."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy.stats import t as student

import drcmitsuba  # noqa: F401  registers the plugins
from drcmitsuba.cli.startup import OBJECTS
from drcmitsuba.runtime import backend
from tests.fast import pytest_collection_modifyitems  # noqa: F401  hook
from tests.skips import pytest_sessionfinish, pytest_terminal_summary  # noqa: F401  hooks

VARIANTS = ["llvm_ad_mono", "llvm_ad_rgb"] if backend.llvm_version() else []
if backend.cuda_available():
    VARIANTS += ["cuda_ad_mono", "cuda_ad_rgb"]


def pytest_configure() -> None:
    """Let workers that share the cores have a thread each: with more, a run takes a quarter longer.

    OpenBLAS asks the environment, which workers have from the process that starts them.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if "PYTEST_XDIST_WORKER" in os.environ:
        workers = int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        dr.set_thread_count(max(1, dr.thread_count() // workers))


def pytest_collection_finish() -> None:
    """Let Python look for cycles as rarely as commands do, and not among modules and tests."""
    gc.freeze()
    gc.set_threshold(OBJECTS)


def pytest_addoption(parser: pytest.Parser) -> None:
    text = "print how much of what is allowed each hard case takes (tests/hard)"
    parser.addoption("--margins", action="store_true", help=text)


@pytest.fixture(params=VARIANTS)
def variant(request: pytest.FixtureRequest) -> Iterator[str]:
    """Each JIT variant that runs here, set; the first one is set again afterwards."""
    yield backend.select(request.param)
    backend.select(VARIANTS[0])


ROUNDING = 1e-5
"""Float32 sums and tables of 1025 entries are off by up to this share."""
COARSE = 0.1
"""Entries with a larger relative standard error hold too few hits to be normal; they are pooled."""


def _moments(a: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Mean of replicates (axis 0), the variance of that mean, and its degrees of freedom."""
    return a.mean(axis=0), a.var(axis=0, ddof=1) / len(a), len(a) - 1


def _p_values(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two-sided p of Welch's test of equal means, and the standard error of the difference.

    A single row of `b` is exact.
    """
    mean_a, var_a, dof_a = _moments(a)
    mean_b, var_b, dof_b = _moments(b) if len(b) > 1 else (b[0], 0 * var_a, 1)
    var = var_a + var_b
    error = np.sqrt(var + (ROUNDING * mean_b) ** 2)
    share = var_a**2 / dof_a + var_b**2 / dof_b
    dof = np.divide(var**2, share, out=np.ones_like(var), where=share > 0)
    difference = abs(mean_a - mean_b)
    z = np.divide(difference, error, out=np.full_like(error, np.inf), where=error > 0)
    p = np.where(share > 0, 2 * student.sf(z, np.maximum(dof, 1)), 1.0 * (z < 5))
    return np.where(difference == 0, 1.0, p), error


def _pooled(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Entries with few hits in one sum, beside all others."""
    mean_a, var_a, _ = _moments(a)
    coarse = var_a > (COARSE * mean_a) ** 2
    if len(b) > 1:
        mean_b, var_b, _ = _moments(b)
        coarse |= (var_b > (COARSE * mean_b) ** 2) | ((var_a > 0) != (var_b > 0))
    else:
        coarse &= b[0] != 0
    if not coarse.any():
        return a, b
    rest = [x[:, coarse].sum(axis=1, keepdims=True) for x in (a, b)]
    return tuple(np.hstack([x[:, ~coarse], r]) for x, r in zip((a, b), rest, strict=True))


def _same(
    a: np.ndarray,
    *,
    exact: np.ndarray | float | None = None,
    other: np.ndarray | None = None,
    within: float,
    level: float = 1e-4,
) -> None:
    """Assert that independent replicates (axis 0 of `a`) have the expected mean.

    Every entry is tested (Šidák) and their sum, each at `level`: of a hundred such tests one in a
    hundred runs would raise a false alarm, and seeds are fixed. `within` is the largest relative
    standard error of the sum with which the test still means something; a coarser one fails.
    """
    a = np.asarray(a, float).reshape(len(a), -1)
    if other is None:
        b = np.broadcast_to(np.ravel(exact).astype(float), (1, a.shape[1]))
    else:
        b = np.asarray(other, float).reshape(len(other), -1)
    assert a.shape[1] == b.shape[1]
    total_a, total_b = a.sum(axis=1, keepdims=True), b.sum(axis=1, keepdims=True)
    p_sum, error = _p_values(total_a, total_b)
    a, b = _pooled(a, b)
    p, _ = _p_values(a, b)
    expected = abs(total_b.mean())
    report = (
        f"sum off by {(total_a.mean() / total_b.mean() - 1):+.3%} ± {error[0] / expected:.3%}"
        f" (p {p_sum[0]:.2g}); worst of {p.size} entries p {p.min():.2g}"
    )
    print(report)
    assert error[0] <= within * expected, f"too coarse to tell: {report}"
    assert p_sum[0] > level, report
    worst = int(p.argmin())
    assert p[worst] > 1 - (1 - level) ** (1 / p.size), (
        f"entry {worst}: {a[:, worst].mean():.6g}, expected {b[:, worst].mean():.6g}; {report}"
    )


@pytest.fixture(scope="session")
def same():
    """Call `same(replicates, exact=…)` or `same(replicates, other=…)`: see `_same`."""
    return _same


def _plain_coefficients(scene, points, normals, *, replicates=32, spp=2048, seed=0, **parameters):
    integrator = mi.load_dict({"type": "coefficient", **parameters})
    rows = (
        np.tile(np.asarray(a, float).reshape(-1, 3), (replicates, 1)) for a in (points, normals)
    )
    parts = integrator.sensors(scene, *rows, spp, seed).numpy()
    return parts.reshape(2, replicates, -1, parts.shape[2])


@pytest.fixture(scope="session")
def plain_coefficients():
    """Replicates by the plugin `coefficient`, shape (2: direct, interreflected; n, sensor, bin)."""
    return _plain_coefficients
