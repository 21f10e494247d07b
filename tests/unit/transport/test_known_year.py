"""Façades of a year by element, summed without coefficients, against sums over bins."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy.sparse import csr_matrix

from drcmitsuba.annual.weighed_year import WeighedYear
from drcmitsuba.metrics.year_replicates import replicates_of
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.schema import mean_and_error
from drcmitsuba.transport import elements
from drcmitsuba.transport.elements import known_year, year_by_bin
from drcmitsuba.transport.elements.known_year import KnownYear
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.solved_paths import SolvedReturn
from drcmitsuba.transport.elements.year_by_bin import YearByBin
from tests.fast import slowly
from tests.unit.transport.exact_scenes import OPPOSITE, SUNS
from tests.unit.transport.test_light_by_element import case

HOURS, ONLY = 150, 5
"""Time stamps; the element that is the only fill of its opening."""


@pytest.fixture(scope="module", params=slowly(["paths", "cells"], "paths"))
def light(request):
    """Light that openings send back on paths, or solved on cells."""
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    effects = EnabledEffects(solved_cells=request.param == "cells", pane_to_pane=True)
    one = case(furniture=[OPPOSITE])
    kind = SolvedReturn if request.param == "cells" else MarkedLight
    with one_blas_thread():  # as in an evaluation
        light = elements.compute(one, PaneGroups.of(one), SUNS, one.accuracy, effects)
        assert all(isinstance(returned, kind) for returned in light.returned)
        yield light


@pytest.fixture(scope="module", params=["by fills", "by one fill"])
def year(request, light):
    """Light that all openings send back, or only the one that has a single fill."""
    if request.param == "by one fill":
        light = sent_back_by_one_fill(light)
    return year_of(light)


def sent_back_by_one_fill(light):
    return replace(light, returned=tuple(map(by_one_fill, light.returned)))


def year_of(light):
    rng = np.random.default_rng(4)
    L = rng.random((HOURS, len(light.labels))).astype(np.float32)
    L[:, light.sky_bins :] *= rng.random((HOURS, len(light.labels) - light.sky_bins)) < 0.3
    return KnownYear.of(light, csr_matrix(L))


def by_one_fill(returned):
    """Paths that met no opening but the one that has a single fill."""
    if isinstance(returned, SolvedReturn):
        parts = {n: by_one_fill(getattr(returned, n)) for n in ("between", "sensors")}
        return replace(returned, **parts)
    here = np.isin(returned.met, [-1, ONLY]).all(axis=1)
    assert here.any()
    names = ("sensor", "block", "weight", "met")
    return replace(returned, **{name: getattr(returned, name)[here] for name in names})


def indices(count):
    """So many different states of the openings, some hours each."""
    every = np.stack(np.meshgrid(range(3), range(2), [0]), axis=-1).reshape(-1, 3)
    return every[np.random.default_rng(2).integers(0, count, HOURS)]


def expected(year, shares):
    """E by coefficients of every state."""
    L, E = year.L.toarray(), None
    for row in np.unique(shares, axis=0):
        here = (shares == row).all(axis=1)
        C = year.light.coefficients(row)["replicates"].values
        E = np.empty((len(C), HOURS, C.shape[1])) if E is None else E
        E[:, here] = np.einsum("tb,rsb->rts", L[here], C)
    return E


def test_a_year_is_c_of_its_states_times_l(year):
    shares = year.light.shares(indices(6))
    np.testing.assert_allclose(year.illuminance(shares), expected(year, shares), rtol=2e-5)


def test_a_year_of_many_states_is_the_sum_over_bins_hour_by_hour(year, monkeypatch):
    monkeypatch.setattr(known_year, "MOST_ROWS", 0)
    shares = year.light.shares(indices(6))
    by_bins = np.stack([*year.light.illuminance(year.L, shares)])
    np.testing.assert_allclose(year.illuminance(shares), by_bins, rtol=2e-5)


def test_few_states_are_summed_by_their_own_bins(year):
    """Bin by bin, E is that of the year by element, in all hours and in some."""
    by_bin, shares = YearByBin(year.light, year.L), year.light.shares(indices(6))
    np.testing.assert_allclose(by_bin.illuminance(shares), expected(year, shares), rtol=2e-5)
    one, hours = np.array([0.3, 0, 0.7, 0.5, 0.5, 1], np.float32), np.arange(3, HOURS, 7)
    some = by_bin.illuminance(one, hours)
    np.testing.assert_allclose(some, year.illuminance(one)[:, hours], rtol=2e-5)
    assert by_bin.illuminance(one, hours[:0]).shape[1] == 0


def test_many_states_by_bins_are_those_of_the_year_by_element(year, monkeypatch):
    """Both leave out what openings send back many times."""
    for module in (known_year, year_by_bin):
        monkeypatch.setattr(module, "MOST_ROWS", 0)
    shares = year.light.shares(indices(6))
    by_bin = YearByBin(year.light, year.L).illuminance(shares)
    np.testing.assert_allclose(by_bin, year.illuminance(shares), rtol=2e-5)


def test_some_hours_are_those_of_the_year(year):
    shares = year.light.shares(np.array([1, 0, 0]))
    hours = np.flatnonzero(np.random.default_rng(3).random(HOURS) < 0.2)
    some = year.illuminance(shares, hours)
    np.testing.assert_allclose(some, year.illuminance(shares)[:, hours], rtol=1e-6)
    assert year.illuminance(shares, hours[:0]).shape[1] == 0


def test_light_by_openings_with_one_fill_is_summed_once(year, request):
    blocks = year.light.besides.blocks.shape[2]
    receivers = len(year.light.positions) + blocks * ("by fills" in request.node.callspec.id)
    assert all(lit.shape[2] == receivers for lit in year.lit.values())
    assert year.light.elements[ONLY].gives_light
    assert ONLY not in year.lit


@pytest.mark.parametrize("shares", [[1, 0, 0, 0, 1, 1], [0.3, 0, 0.7, 0.5, 0.5, 1]])
def test_straight_light_is_that_of_the_coefficients(year, shares):
    light, shares = year.light, np.array(shares, np.float32)
    bins = np.arange(0, len(light.labels), 3)
    C = light.coefficients(shares)
    mean, error = light.straight(shares, bins)
    np.testing.assert_array_equal(mean.T, C["straight"].values[:, bins])
    np.testing.assert_array_equal(error.T, C["straight_se"].values[:, bins])
    assert mean.any()


def test_its_memory_is_known_before(year):
    assert KnownYear.nbytes(year.light, HOURS) == sum(E.nbytes for E in year.lit.values())


@pytest.fixture
def weighed(light):
    """Façade of two mixtures in turn, of which nothing is kept, and E of all its replicates."""
    year = year_of(sent_back_by_one_fill(light))
    shares = np.array([[1, 0, 0, 0, 1, 1], [0.3, 0, 0.7, 0.5, 0.5, 1]], np.float32)
    part = np.random.default_rng(5).integers(0, 2, HOURS)
    parts = [WeighedYear.constant(year, row) for row in shares]
    return WeighedYear.of_parts(parts, part), year.illuminance(shares[part])


@pytest.mark.parametrize("hours", [None, np.array([3, 9, 77, 149]), np.zeros(0, int)])
def test_statistics_are_those_of_all_replicates(weighed, hours):
    facade, E = weighed
    mean, error = mean_and_error(E if hours is None else E[:, hours])
    ours = facade.statistics(hours)
    np.testing.assert_allclose(ours[0], mean, rtol=1e-6)
    np.testing.assert_allclose(ours[1], error, rtol=1e-4, atol=1e-6 * mean.max(initial=0))


def test_pairs_and_means_are_those_of_all_replicates(weighed):
    facade, E = weighed
    rng = np.random.default_rng(6)
    time, sensor = rng.integers(0, HOURS, 400), rng.integers(0, E.shape[2], 400)
    np.testing.assert_allclose(facade.at(time, sensor), E[:, time, sensor], rtol=1e-6)
    assert facade.at(time[:0], sensor[:0]).shape == (len(E), 0)
    weights, hours = rng.random((2, E.shape[2])).astype(np.float32), np.arange(5, HOURS, 4)
    means = facade.of_means(weights, hours)
    np.testing.assert_allclose(means, E[:, hours] @ weights.T, rtol=1e-5)


def test_an_array_of_xarray_makes_its_numbers_when_it_is_used(weighed):
    facade, E = weighed
    array = xr.DataArray(facade, dims=("replicate", "time", "sensor"))
    assert replicates_of(array.to_dataset(name="illuminance")) is array.data
    np.testing.assert_array_equal(array.values, E)
    np.testing.assert_array_equal(array.isel(sensor=0), E[..., 0])
    np.testing.assert_array_equal(array.mean("replicate"), E.mean(axis=0))
    np.testing.assert_array_equal(array * 2, E * 2)
