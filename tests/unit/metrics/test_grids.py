"""Metrics of the grids of a model, from the draws of all sensors; any grid closes the shade."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.sensors import MOST_GRIDS
from drcmitsuba.metrics import evaluate_metrics
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.runtime.errors import InputError
from tests.unit.metrics.test_intervals import HOURS, coefficients, drawn, replicates

GRIDS = np.array(["south", "north", "south", "south", "north"], object)
ASKED = Rules(Metrics(sda_threshold=500, sda_fraction=0.5, ase_hours=35), 1000, 0.4, 1.0)


def in_doubt(shaded=True):
    """C of five sensors near all limits, in two grids."""
    rng = np.random.default_rng(7)
    E = replicates(rng.uniform(430, 570, (HOURS, 5)), 40.0)
    sun = rng.uniform(0, 2000, (HOURS, 5))
    C = coefficients(E, 0.97 * E if shaded else None, sun, 0.3 * sun)
    return C.assign_coords(grid=("sensor", GRIDS))


@pytest.mark.parametrize("shaded", [True, False])
def test_every_draw_of_all_sensors_is_the_sum_of_its_grids(shaded):
    _, draws = drawn(in_doubt(shaded), ASKED)
    assert list(draws.grids) == ["south", "north"]
    south, north = draws.grids.values()
    for name in ("sDA", "ASE"):
        joined = (3 * south.annual[name] + 2 * north.annual[name]) / 5
        np.testing.assert_allclose(joined, draws.annual[name], atol=1e-9)
        assert np.ptp(draws.annual[name]) > 0
    for name in ("msDA", "MSE"):
        joined = (3 * south.monthly[name] + 2 * north.monthly[name]) / 5
        np.testing.assert_allclose(joined, draws.monthly[name], atol=1e-9)


def test_without_a_shade_grids_change_nothing_for_all_sensors():
    C = in_doubt(shaded=False)
    (_, with_grids), (_, without) = drawn(C, ASKED), drawn(C.drop_vars("grid"), ASKED)
    assert without.grids == {}
    for name, draws in without.annual.items():
        np.testing.assert_array_equal(draws, with_grids.annual[name])
    for name, draws in without.monthly.items():
        np.testing.assert_array_equal(draws, with_grids.monthly[name])


@pytest.mark.parametrize("known", [True, False], ids=["draws", "standard errors"])
def test_a_grid_has_the_metrics_of_its_sensors_under_the_common_shade(known):
    lux, draws = drawn(in_doubt(), ASKED)
    numbers = evaluate_metrics.summarise(lux, ASKED, draws if known else None)
    grids = numbers["grids"]
    assert {name: grid["sensors"] for name, grid in grids.items()} == {"south": 3, "north": 2}
    for name, grid in grids.items():
        assert set(grid) == {"sensors", "sDA", "ASE", "msDA", "MSE"}
        mine = lux.isel(sensor=np.flatnonzero(name == GRIDS))
        assert grid["sDA"]["value"] == metrics.sda(mine["total"], 500, 0.5)
        assert grid["ASE"]["value"] == metrics.ase(mine["direct_sun"], 1000, 35)
        march = metrics.msda(mine["total"], 500, 0.5).values[2]
        assert grid["msDA"][2]["value"] == pytest.approx(march)
        for metric in ("sDA", "ASE"):
            assert grid[metric]["low"] <= grid[metric]["value"] <= grid[metric]["high"]
    whole = sum(grid["sensors"] * grid["sDA"]["value"] for grid in grids.values()) / 5
    assert whole == pytest.approx(numbers["sDA"]["value"])


def test_undecided_sensors_tell_their_grid():
    lux, draws = drawn(in_doubt(), ASKED)
    undecided = evaluate_metrics.summarise(lux, ASKED, draws)["undecided"]
    assert undecided
    assert all(point["grid"] == GRIDS[point["sensor"]] for point in undecided)


def test_without_names_there_are_no_grids():
    lux, draws = drawn(in_doubt().drop_vars("grid"), ASKED)
    assert sensors_by_grid(lux) == {}
    assert "grids" not in evaluate_metrics.summarise(lux, ASKED, draws)


def test_grids_keep_the_order_of_their_first_sensors():
    by_name = sensors_by_grid(in_doubt())
    assert {name: sensors.tolist() for name, sensors in by_name.items()} == {
        "south": [0, 2, 3],
        "north": [1, 4],
    }


def test_more_grids_than_can_be_counted_are_refused():
    names = np.array([f"g{i}" for i in range(MOST_GRIDS + 1)], object)
    many = xr.DataArray(np.zeros(len(names)), {"grid": ("sensor", names)}, ("sensor",))
    with pytest.raises(InputError, match="2001 grids; give at most 2000"):
        sensors_by_grid(many)
