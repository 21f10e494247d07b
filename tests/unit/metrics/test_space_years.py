"""Daylight of spaces and its variants: against sums over whole arrays, and against known truths."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.space_tasks import at_target
from drcmitsuba.metrics.space_years import SpaceYears, of_block
from drcmitsuba.metrics.spaces import sensors_by_space
from tests.unit.metrics.test_sensor_counts import sky_of

HOURS, SENSORS, REPLICATES = 600, 24, 8
SKY = sky_of(np.datetime64("2015-01-01T01", "ns") + np.arange(HOURS) * np.timedelta64(14, "h"))
SUNS = SKY["sun_bin"].values
RULES = Rules(Metrics(sda_threshold=450), 1000.0, 1.0, 1.0)
SPACE = np.repeat(np.array(["a", "b", "c"], object), [4, 8, 12])
ROWS = [
    {"name": "a", "use": "", "storey": "", "floor_area": 10.0, "target": 500.0, "hours": [8, 20]},
    {"name": "b", "use": "", "storey": "", "floor_area": 20.0},
    {"name": "c", "use": "", "storey": "", "floor_area": 30.0, "target": 300.0},
]
TAKEN = FacadeStates(("open", "shaded"), np.arange(HOURS) % 2, np.arange(HOURS)[:, None] % 2)


def coefficients(rng, level, shared=0.05, own=0.1):
    """C whose bins are hours, so that C is E (time, sensor), with errors by space and sensor."""
    states = []
    for share in (1.0, 0.7):
        errors = rng.normal(0, own, (REPLICATES, HOURS, SENSORS))
        by_space = rng.normal(0, shared, (REPLICATES, 1, 3))
        errors += by_space[..., np.unique(SPACE, return_inverse=True)[1]]
        E = share * level * (1 + errors)
        nothing = np.zeros((SENSORS, HOURS))
        arrays = {"replicates": (("replicate", "sensor", "bin"), E.swapaxes(1, 2))}
        arrays |= dict.fromkeys(("straight", "straight_se"), (("sensor", "bin"), nothing))
        at = {axis: ("sensor", np.arange(SENSORS) % 4 * 1.0) for axis in "xyz"}
        C = xr.Dataset(arrays, {"bin": SUNS, "space": ("sensor", SPACE), **at})
        dark = xr.zeros_like(C.isel(bin=[0])).assign_coords(bin=np.array(["ground"], object))
        states.append(xr.concat([dark, C], "bin").astype(np.float32))
    return Coefficients(states[0], {"shaded": states[1]})


def illuminance(C):
    E = accumulate.illuminance(C.open, [C.others["shaded"]], SKY, TAKEN.index)
    return E.assign_coords(clock=SKY["clock"]).assign_attrs(spaces=json.dumps(ROWS))


def years_of(C):
    E = illuminance(C)
    return SpaceYears.of(C, SKY, E, TAKEN, sensors_by_space(E), RULES)


@pytest.fixture(scope="module")
def case():
    """C, E and the level of light, near the targets of all spaces."""
    rng = np.random.default_rng(2)
    level = rng.uniform(300, 900, (HOURS, SENSORS))
    C = coefficients(rng, level)
    return C, illuminance(C), level


def test_variants_are_those_of_whole_arrays(case):
    """A second route: every variant of E as one array, counted by `at_target`."""
    C, E, _ = case
    spaces = sensors_by_space(E)
    years = years_of(C)
    every = np.arange(SENSORS)
    lux = accumulate.replicates(C.open, SKY, every).astype(float)
    shut = TAKEN.index == 1
    lux[:, shut] = accumulate.replicates(C.others["shaded"], SKY, every)[:, shut]
    mean = lux.mean(axis=0)
    for k, E_k in enumerate([mean, *(mean + (lux - mean) / np.sqrt(REPLICATES))]):
        of_E = E.assign(total=(("time", "sensor"), E_k))
        DA = at_target(of_E, spaces, RULES)["DA"].values
        for j, space in enumerate(spaces):
            assert years.autonomy[k, j] == pytest.approx(DA[space.sensors] @ space.shares)
            daylight = E_k[:, space.sensors] @ space.shares
            np.testing.assert_allclose(years.daylight[k, :, j], daylight, rtol=1e-5)
    assert np.ptp(years.autonomy, axis=0).min() > 0


def test_blocks_of_sensors_add_up(case):
    C, E, _ = case
    spaces, whole = sensors_by_space(E), years_of(C)
    joint = SpaceYears.dark(REPLICATES, HOURS, len(spaces))
    for here in (slice(0, 2), slice(2, 9), slice(9, SENSORS)):
        others = {"shaded": C.others["shaded"].isel(sensor=here)}
        part = Coefficients(C.open.isel(sensor=here), others)
        places, its = of_block(spaces, here)
        joint.add(SpaceYears.of(part, SKY, E.isel(sensor=here), TAKEN, its, RULES), places)
    np.testing.assert_allclose(joint.autonomy, whole.autonomy)
    np.testing.assert_allclose(joint.daylight, whole.daylight, rtol=1e-5)


@pytest.mark.slow
def test_intervals_hold_what_is_true(case):
    """300 simulations: autonomy and mean illuminance of three spaces, and of all by area.

    The share of 95 % intervals that hold the truth is no more than 4 standard errors, 5 points,
    from 95 %.
    """
    _, _, level = case
    rng = np.random.default_rng(7)
    quiet = coefficients(rng, level, 0.0, 0.0)
    truth, areas = years_of(quiet), [row["floor_area"] for row in ROWS]

    def numbers(years):
        DA, lux = years.autonomy, years.daylight.mean(axis=1)
        of = [*DA.T, *lux.T, *(np.average(a, axis=1, weights=areas) for a in (DA, lux))]
        return [years.interval(values) for values in of]

    exact = [interval.value for interval in numbers(truth)]
    held = np.zeros(len(exact))
    widths = np.zeros(len(exact))
    for _ in range(seeds := 300):
        drawn = numbers(years_of(coefficients(rng, level)))
        held += [i.low <= true <= i.high for i, true in zip(drawn, exact, strict=True)]
        widths += [i.high - i.low for i in drawn]
    assert (np.abs(held / seeds - 0.95) < 4 * np.sqrt(0.95 * 0.05 / seeds)).all(), held / seeds
    # Spaces err independently: their mean is surer than the mean of their intervals says.
    for parts, joint in ((widths[:3], widths[6]), (widths[3:6], widths[7])):
        assert joint < 0.8 * np.average(parts, weights=areas)
