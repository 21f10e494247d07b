"""Which groups of panes close in an hour: by the rule, by schedules, and in draws."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.groups import OTHERS, VARYING, GroupStates
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.schedule import HOURS, Schedule
from drcmitsuba.metrics.facade_states import FEW, FacadeStates, ShadeRule, numbered
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.intervals.sun import draw_closures, draw_sun
from drcmitsuba.runtime.errors import InputError

GROUPS = GroupStates(("south", "east"), (("open", "blind", "fabric"), ("open", "fabric")))
TIMES = np.array(["2015-01-01T00:00", "2015-02-28T12:00", "2015-06-01T10:00"], "M8[ns]")


def rule(area=0.1, groups=GROUPS, **kind):
    return ShadeRule(groups, area=area, **kind)


def direct(E, group):
    """Direct sun (time, sensor) through groups of panes."""
    coords = {"time": TIMES[: len(E)]}
    dims = ("time", "sensor")
    return xr.Dataset({"direct_sun": (dims, E), "sun_group": (dims, group)}, coords)


def test_groups_with_most_sunlit_sensors_close_until_few_are_left():
    closed = rule().closed(np.array([[9, 12], [12, 9], [5, 4], [9, 9], [10, 0]]), 100)
    # 21: east leaves 9; the same for south; 9 in all; a tie closes the first; 10 of 100 is enough.
    expected = [[0, 1], [1, 0], [0, 0], [1, 0], [1, 0]]
    np.testing.assert_array_equal(closed, np.array(expected, bool))
    both = rule().closed(np.array([30, 20]), 100)
    assert both.all()


def test_an_area_of_0_always_closes_every_group_that_can():
    groups = GroupStates((*GROUPS.names, OTHERS), (*GROUPS.states, ("open",)))
    np.testing.assert_array_equal(
        rule(0.0, groups).closed(np.zeros((1, 3), int), 50), [[True, True, False]]
    )


def test_a_closed_group_takes_its_last_state():
    E, group = np.full((3, 4), 2000.0), np.zeros((3, 4))
    E[1], group[2] = 0, 1
    attributes = {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.5}
    states = FacadeStates.of(attributes | GROUPS.attributes(), direct(E, group))
    assert states.states == ("open", "open/fabric", "fabric/open")
    np.testing.assert_array_equal(states.index, [2, 0, 1])
    np.testing.assert_array_equal(states.of_group, [[2, 0], [0, 0], [0, 1]])


def test_a_schedule_takes_the_hour_of_the_year():
    hours = np.zeros(HOURS, np.int16)
    hours[[0, 58 * 24 + 12, 151 * 24 + 10]] = [1, 2, 1]
    schedule = Schedule({0: hours}, 2)
    time = xr.DataArray(TIMES, dims="time")
    np.testing.assert_array_equal(schedule.indices(time)[:, 0], [1, 2, 1])
    leap = xr.DataArray(np.array(["2016-02-29T12:00"], "M8[ns]"), dims="time")
    assert schedule.indices(leap)[0, 0] == 2
    # A scheduled group counts no sensors in the sun, and takes no part in the rule.
    by_rule = rule(schedule=schedule)
    np.testing.assert_array_equal(by_rule.closed(np.array([[90, 4]]), 100), [[False, False]])
    np.testing.assert_array_equal(
        by_rule.indices(np.array([[False, True]] * 3), time), [[1, 1], [2, 1], [1, 1]]
    )


def test_attributes_hold_groups_and_schedules():
    schedule = Schedule({1: np.arange(HOURS) % 2}, 2)
    attributes = GROUPS.attributes() | schedule.attributes()
    assert GroupStates.of_attributes(attributes) == GROUPS
    read = Schedule.of_attributes(attributes, GROUPS)
    np.testing.assert_array_equal(read.of_group[1], schedule.of_group[1])
    assert GroupStates.of_shade().attributes() == {}
    packed = Schedule({1: np.full(HOURS, 2)}, 2).attributes()["schedule"]
    for damaged in ('{"1": [0]}', "[]", '{"0": "eJw="}', "{", '{"a": 1}', '{"1": "x"}', packed):
        with pytest.raises(InputError, match="schedule"):
            Schedule.of_attributes({"schedule": damaged}, GROUPS)
    with pytest.raises(InputError, match="groups"):
        GroupStates.of_attributes({"groups": "{}"})


def test_states_have_names():
    assert GROUPS.label((0, 0)) == "open"
    assert GROUPS.label((2, 1)) == "fabric/fabric"
    for indices in ((0, 0), (1, 0), (2, 1), (-1, 0), (0, -2)):
        assert GROUPS.indices(GROUPS.label(indices)) == indices
    assert GROUPS.indices("shaded") == (2, 1)
    with pytest.raises(InputError, match=r'groups: south: no state "blnd"; did you mean "?blind'):
        GROUPS.indices("blnd/open")
    with pytest.raises(InputError, match='"fabric" for 2 groups'):
        GROUPS.indices("fabric")


def test_many_states_are_one():
    groups = GroupStates(tuple("abcd"), (("open", "shut"),) * 4)
    every = np.array([[i >> g & 1 for g in range(4)] for i in range(16)])
    assert len(every) > FEW
    states, index = numbered(groups, every)
    assert states == ("open", VARYING)
    np.testing.assert_array_equal(index, [0] + [1] * 15)
    states, index = numbered(groups, every[:9])
    assert len(states) == 9
    assert [groups.indices(states[i]) for i in index] == list(map(tuple, every[:9]))


def test_each_group_closes_by_its_own_draws():
    """In one hour the south is in doubt while the east is closed for certain."""
    E, error = np.zeros((1, 20)), np.zeros((1, 20))
    E[0, :4] = 3000  # through the east
    E[0, 10:12], error[0, 10:12] = 1000, 300
    group = np.r_[np.ones(10), np.zeros(10)][None]
    rules = Rules(Metrics(), 1000.0, 0.1, 1.0, GROUPS)
    draws = draw_sun(E, error, (1000, 1000), None, 0)
    time = xr.DataArray(TIMES[:1], dims="time")
    closures = draw_closures(E, group, time, draws, rules.shade)
    south = np.array([GROUPS.indices(state)[0] > 0 for state in closures.states])
    east = np.array([GROUPS.indices(state)[1] > 0 for state in closures.states])
    assert east[closures.drawn].all()
    # Two of 20 close it: both have to be above 1000 lx.
    both = (draws.closing.sum(axis=0) == 2).mean()
    assert south[closures.drawn].mean() == pytest.approx(both)
    assert 0.1 < both < 0.5
    np.testing.assert_allclose(closures.shares(np.zeros(1, int))[0].mean(), 50 + 50 * both)
