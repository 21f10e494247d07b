"""Metrics against loops in plain Python, written from the words of the standards alone."""

import math

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.runtime.errors import InputError

GROUPS = GroupStates(("south", "west", "roof"), (("open", "blind"),) * 3)
ROOMS = np.array(["a"] * 50 + ["b"] * 20, object)
HALF_HOURS = np.arange("2015-01-01T00:30", "2016-01-01", 60, "M8[m]").astype("M8[ns]")


def working(times):
    """Whether a stamp in the middle of its hour lies from 8 to 18 h."""
    return [8 <= int(str(t)[11:13]) < 18 for t in times]


def closed_by_hand(sun, group):
    """Closed groups of an hour: LM-83 closes those with most sun until under 2 % are in it."""
    out = set()
    for points in (range(50), range(50, 70)):
        lit = [0] * 3
        for i in points:
            lit[group[i]] += sun[i] >= 1000
        while sum(lit) >= 0.02 * len(points) and sum(lit) > 0:
            worst = max(range(3), key=lambda g: lit[g])
            out.add(worst)
            lit[worst] = 0
    return out


def test_lm_83_with_three_groups_in_two_rooms():
    rng = np.random.default_rng(3)
    times = HALF_HOURS[working(HALF_HOURS)]
    assert len(times) == 3650
    shape = len(times), len(ROOMS)
    group = rng.integers(0, 3, shape)
    group[:, :50] = np.minimum(group[:, :50], 1)
    some = rng.random(shape) < rng.choice([0.0, 0.015, 0.05, 0.3], len(times))[:, None]
    some[:, 60:64] |= rng.random((len(times), 4)) < [0.08, 0.1, 0.11, 0.3]
    sun = np.where(some, rng.choice([999.9, 1000.0, 30_000.0], shape), 0.0)
    sun[:40] = 0
    sun[:40, 0] = 1000  # one of 50 points: 2 %, which closes
    E = rng.lognormal(5.7, 1.0, (8, *shape))  # of every set of closed groups
    coords = {"time": times, "grid": ("sensor", ROOMS)}
    direct = xr.Dataset(
        {"direct_sun": (("time", "sensor"), sun), "sun_group": (("time", "sensor"), group)}, coords
    )
    rule = {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.02}
    taken = FacadeStates.of(rule | GROUPS.attributes(), direct).of_group.astype(int)
    by_hand = [closed_by_hand(s.tolist(), g.tolist()) for s, g in zip(sun, group, strict=True)]
    assert [set(np.flatnonzero(row)) for row in taken] == by_hand
    assert {0} in by_hand
    assert {0, 1, 2} in by_hand

    number = [sum(1 << g for g in groups) for groups in by_hand]
    applied = [E[n, t].tolist() for t, n in enumerate(number)]
    total = xr.DataArray(
        E[taken @ [1, 2, 4], np.arange(len(times))], {"time": times}, ("time", "sensor")
    )
    hours = [sum(row[i] >= 300 for row in applied) for i in range(len(ROOMS))]
    enough = sum(2 * h >= 3650 for h in hours)
    assert 0 < enough < len(ROOMS)
    assert metrics.sda(total) == 100 * enough / len(ROOMS)
    in_sun = sum(sum(row[i] >= 1000 for row in sun.tolist()) >= 250 for i in range(len(ROOMS)))
    assert 0 < in_sun < len(ROOMS)
    assert metrics.ase(direct["direct_sun"]) == 100 * in_sun / len(ROOMS)


@pytest.mark.parametrize("half", [False, True])
def test_provision_over_the_4380_hours_with_most_diffuse_light(half):
    """The same year by hours and by half hours, which have many ties at dusk."""
    rng = np.random.default_rng(4)
    hour = np.arange(8760) % 24
    diffuse = np.round(np.maximum(np.sin((hour - 6) / 12 * np.pi), 0) * 9 + rng.random(8760) * 3)
    E = diffuse[:, None] * rng.uniform(20, 160, 30)
    step, repeats = (0.5, 2) if half else (1.0, 1)
    diffuse, E = np.repeat(diffuse, repeats), np.repeat(E, repeats, axis=0)
    chosen = metrics.daylight_hours(xr.DataArray(diffuse, dims="time"), step_hours=step)
    order = sorted(range(len(diffuse)), key=lambda t: (-diffuse[t], t))[: 4380 * repeats]
    assert np.flatnonzero(chosen).tolist() == sorted(order)
    at = xr.DataArray(E, dims=("time", "sensor")).isel(time=np.flatnonzero(chosen))
    for area in (0.5, 0.95):
        points = math.ceil(area * 30 - 1e-9)
        reached = [sorted((column[t] for t in order), reverse=True) for column in E.T.tolist()]
        lasting = sorted((row[len(order) // 2 - 1] for row in reached), reverse=True)
        assert metrics.provision(at, area) == lasting[points - 1]


@pytest.mark.parametrize(
    "call",
    [
        metrics.da, metrics.cda, metrics.udi, metrics.sda, metrics.msda, metrics.ase, metrics.mse,
        metrics.uniformity, metrics.light_exposure, metrics.provision, metrics.daylight_hours,
        metrics.daylight_factor, metrics.months, metrics.shade_closed, metrics.sunlight_hours,
        metrics.view_level, lambda values: metrics.share_of_points(values, 50.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("values", [np.ones((4, 3)), None, [[1.0]]])
def test_what_is_no_data_array_is_refused_in_one_line(call, values):
    with pytest.raises(InputError, match="give an xarray DataArray") as told:
        call(values)
    assert "\n" not in str(told.value)


def test_the_order_of_the_dims_does_not_matter():
    E = xr.DataArray(np.random.default_rng(5).lognormal(5.7, 1, (48, 5)), dims=("time", "sensor"))
    for metric in (metrics.da, metrics.cda, metrics.udi, metrics.light_exposure):
        xr.testing.assert_equal(metric(E), metric(E.T))
    assert metrics.sda(E.isel(sensor=[0])) in (0.0, 100.0)
    assert metrics.sda(E * 0) == 0
