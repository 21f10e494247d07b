"""Metrics from counts by block of sensors are those from whole arrays of E, grid by grid."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import summarise
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.grids import grid_of_sensors, sensors_by_grid
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.intervals.draw import BlockDraws, draw_block
from drcmitsuba.metrics.intervals.facade_draws import (
    closures_from,
    draw_closures,
    sunlit_sensors,
)
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.metrics.intervals.sun import SunDraws, draw_sun
from drcmitsuba.metrics.sensor_counts import CountedYear, sensor_counts
from drcmitsuba.metrics.space_years import SpaceYears

HOURS, SENSORS, REPLICATES = 48, 40, 4
EDGES = (0, 7, 8, 25, 40)
TIMES = np.datetime64("2015-01-20T12", "ns") + np.arange(HOURS) * np.timedelta64(36, "h")
RULES = Rules(Metrics(sda_threshold=400, sda_fraction=0.5, ase_hours=8), 1000.0, 0.3, 1.0)


def sky_of(times):
    """Sky that is dark but for a sun of its own at each time stamp."""
    suns = np.array([f"sun_{i}" for i in range(len(times))], object)
    return xr.Dataset(
        {"sky": (("time", "bin"), np.zeros((len(times), 1))), "sun": ("time", np.ones(len(times)))},
        coords={
            "time": times, "clock": ("time", times), "bin": np.array(["ground"], object),
            "sun_bin": ("time", suns),
        },
    )  # fmt: skip


SKY = sky_of(TIMES)
SUNS = SKY["sun_bin"].values


@pytest.fixture(scope="module")
def year():
    """C whose bins are hours, so that C is E: noisy, in three grids, sun near its threshold."""
    rng = np.random.default_rng(4)
    level = rng.uniform(300, 700, (HOURS, SENSORS))
    lit = rng.uniform(0, 1, (HOURS, SENSORS)) < rng.uniform(0, 0.6, (HOURS, 1))
    sun = np.where(lit, rng.choice([400, 950, 1000, 3000], (HOURS, SENSORS)), 0.0)
    error = np.where(rng.uniform(0, 1, sun.shape) < 0.2, 0.2 * sun, 0)
    states = []
    for share in (1.0, 0.6):
        E = share * level * rng.normal(1, 0.1, (REPLICATES, HOURS, SENSORS))
        arrays = {"replicates": (("replicate", "sensor", "bin"), E.swapaxes(1, 2))}
        arrays |= {"straight": (("sensor", "bin"), sun.T)}
        arrays |= {"straight_se": (("sensor", "bin"), error.T)}
        C = xr.Dataset(arrays, {"bin": SUNS, **{a: ("sensor", np.arange(40.0)) for a in "xyz"}})
        C = C.assign_coords(
            grid=("sensor", np.repeat(np.array(["a", "b", "c"], object), [9, 20, 11]))
        )
        dark = xr.zeros_like(C.isel(bin=[0])).assign_coords(bin=np.array(["ground"], object))
        states.append(xr.concat([dark, C], "bin").astype(np.float32))
    return Coefficients(states[0].assign_attrs(has_shade=1), {"shaded": states[1]})


def illuminance(C, index):
    E = accumulate.illuminance(C.open, [C.others["shaded"]], SKY, index)
    return E.assign_attrs(has_shade=1)


def parts_of(sun):
    """Draws of the direct sun by block of sensors."""
    for start, stop in pairwise(EDGES):
        here = (sun.sensor >= start) & (sun.sensor < stop)
        drawn = sun.time[here], sun.sensor[here] - start, sun.exposed[here], sun.closing[here]
        yield slice(start, stop), SunDraws(*drawn)


def draw_closures_hour_by_hour(sunlit, sizes, hours):
    """Whether the only group closes, (hour, draw), each grid and draw of an hour by itself."""
    required, closes = RULES.shade.required(sizes), np.zeros((len(hours), DRAWS), bool)
    for i, hour in enumerate(hours):
        for grid, least in enumerate(required):
            sunny = sunlit.sure[hour, grid, 0] + np.zeros(DRAWS, int)
            for place, closing in zip(sunlit.place, sunlit.closing, strict=True):
                if place == hour * len(required) + grid:
                    sunny += closing
            closes[i] |= sunny >= least
    return closes


def test_blocks_of_sensors_have_the_numbers_of_all_together(year):
    direct = accumulate.direct_sun(year.open, SKY)
    mean, error = direct["direct_sun"].values, direct["direct_sun_se"].values
    sun = draw_sun(mean, error, (1000, 1000), 32, 0)
    grid, rule = grid_of_sensors(year.open), RULES.shade
    sizes = np.bincount(grid)
    shut = draw_closures(mean, None, grid, SKY["time"], sun, rule)
    assert len(shut.hours) > 3
    assert set(shut.state) == {0, 1}

    sunlit = None
    for here, part in parts_of(sun):
        block = sunlit_sensors(mean[:, here], None, grid[here], part, rule, len(sizes))
        sunlit = block if sunlit is None else sunlit.plus(block)
        places = len(sunlit.place)
        sunlit = sunlit.without_certain(rule.required(sizes))
    assert len(sunlit.place) < places  # some hours close for certain
    by_block = closures_from(sunlit, sizes, SKY["time"], rule)
    for name in ("state", "closed", "hours", "drawn", "closed_drawn"):
        np.testing.assert_array_equal(getattr(by_block, name), getattr(shut, name), err_msg=name)

    one_by_one = draw_closures_hour_by_hour(sunlit, sizes, shut.hours)
    np.testing.assert_array_equal(shut.drawn > 0, one_by_one)

    E = illuminance(year, shut.state)
    whole = draw_block(year, SKY, E, RULES, sun, shut, grid, 0)
    draws, counts = None, []
    for here, part in parts_of(sun):
        C = Coefficients(
            year.open.isel(sensor=here), {"shaded": year.others["shaded"].isel(sensor=here)}
        )
        E_block = illuminance(C, shut.state)
        block = draw_block(C, SKY, E_block, RULES, part, shut, grid[here], 0)
        draws = block if draws is None else draws.plus(block)
        counts.append(sensor_counts(E_block, RULES))
    assert isinstance(draws, BlockDraws)
    names, month = list(sensors_by_grid(E)), E["time"].dt.month.values
    np.testing.assert_allclose(draws.mean, whole.mean, rtol=1e-6)
    every = xr.concat(counts, "sensor", data_vars="minimal", coords="minimal", compat="override")
    none = SpaceYears.of_errors(E, (), RULES)
    counted = CountedYear(
        every, month, RULES, draws.draws(shut, month - 1, names), shut, shut.state[:, None], none
    )
    expected = summarise(E, RULES, whole.draws(shut, month - 1, names))
    numbers = counted.numbers()
    assert 0 < numbers["sDA"]["value"] < 100
    assert 0 < numbers["ASE"]["value"] < 100
    assert numbers["undecided"]
    assert numbers == expected
    assert FacadeStates(shut.states, shut.state, shut.state[:, None]).states == ("open", "shaded")


def test_counts_are_countable_by_eye():
    times = np.array(["2015-01-01T12", "2015-01-02T12", "2015-03-01T12"], "datetime64[ns]")
    total = np.array([[500.0, 399.0], [900.0, 0.0], [0.0, 600.0]])
    E = xr.Dataset(
        {"total": (("time", "sensor"), total), "direct_sun": (("time", "sensor"), 2 * total)},
        {"time": times, "x": ("sensor", [0.0, 1.0])},
    )
    counts = sensor_counts(E, RULES)
    np.testing.assert_array_equal(counts["enough"].sel(month=[1, 2, 3]), [[2, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(counts["in_sun"].sel(month=[1, 2, 3]), [[2, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(counts["mean_illuminance"], [1400 / 3, 333])
