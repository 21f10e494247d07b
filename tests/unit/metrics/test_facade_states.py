"""Which groups of panes close in an hour: by the rule, by schedules, and in draws."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.case.groups import OTHERS, VARYING, GroupStates
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.schedule import HOURS, Schedule
from drcmitsuba.metrics.facade_states import FEW, FacadeStates, ShadeRule, numbered, sunlit
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.intervals.facade_draws import draw_closures
from drcmitsuba.metrics.intervals.sun import draw_sun, unpacked
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


def closed_by(rule, sunlit, sensors):
    """Closed groups by the numbers of sunlit sensors (…, group) of a single grid."""
    return rule.closed(np.array(sunlit)[..., None, :], np.array([sensors]))


def test_groups_with_most_sunlit_sensors_close_until_few_are_left():
    closed = closed_by(rule(), [[9, 12], [12, 9], [5, 4], [9, 9], [10, 0]], 100)
    # 21: east leaves 9; the same for south; 9 in all; a tie closes the first; 10 of 100 is enough.
    expected = [[0, 1], [1, 0], [0, 0], [1, 0], [1, 0]]
    np.testing.assert_array_equal(closed, np.array(expected, bool))
    assert closed_by(rule(), [30, 20], 100).all()


def test_each_room_asks_for_groups_by_its_own_sensors():
    """A hall of 100 points and a room of 10: 10 % close, and 1 of 110 is no tenth of all."""
    sensors = np.array([100, 10])
    sunlit = np.array(
        [
            [[0, 0], [0, 1]],  # the room closes the east
            [[9, 0], [0, 0]],  # too few of the hall
            [[9, 1], [0, 0]],  # ten of the hall by both: the south closes, one is left
            [[9, 1], [0, 1]],  # the hall asks for the south, the room for the east
            [[0, 9], [1, 0]],  # the room for the south; the hall has too few
            [[5, 4], [0, 0]],
        ]
    )
    expected = [[0, 1], [0, 0], [1, 0], [1, 1], [1, 0], [0, 0]]
    np.testing.assert_array_equal(rule().closed(sunlit, sensors), np.array(expected, bool))
    np.testing.assert_array_equal(rule().required(sensors), [10, 1])


def test_the_sun_is_counted_by_room_and_group():
    """Three points of a hall, one of a room, which lies between them in the list."""
    E = np.array([[2000, 1000, 999, 2000], [0, 3000, 0, 0]])
    through = direct(E, np.array([[0, 1, 1, 0], [0, 0, 0, 0]]))
    through = through.assign_coords(grid=("sensor", np.array(["h", "r", "h", "h"], object)))
    np.testing.assert_array_equal(sunlit(through, rule()), [[[2, 0], [0, 1]], [[0, 0], [1, 0]]])
    attributes = {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.5}
    states = FacadeStates.of(attributes | GROUPS.attributes(), through)
    np.testing.assert_array_equal(states.of_group, [[2, 1], [2, 0]])
    whole = FacadeStates.of(attributes | GROUPS.attributes(), through.drop_vars("grid"))
    np.testing.assert_array_equal(whole.of_group, [[2, 0], [0, 0]])
    np.testing.assert_array_equal(
        metrics.shade_closed(through["direct_sun"], area=0.5), [True, True]
    )
    np.testing.assert_array_equal(
        metrics.shade_closed(through["direct_sun"].drop_vars("grid"), area=0.5), [True, False]
    )


def test_an_area_of_0_always_closes_every_group_that_can():
    groups = GroupStates((*GROUPS.names, OTHERS), (*GROUPS.states, ("open",)))
    np.testing.assert_array_equal(
        closed_by(rule(0.0, groups), np.zeros((1, 3), int), 50), [[True, True, False]]
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
    np.testing.assert_array_equal(closed_by(by_rule, [[90, 4]], 100), [[False, False]])
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
    group = np.repeat([1, 0], 10)[None]
    rules = Rules(Metrics(), 1000.0, 0.1, 1.0, GROUPS)
    draws = draw_sun(E, error, (1000, 1000), None, 0)
    time = xr.DataArray(TIMES[:1], dims="time")
    closures = draw_closures(E, group, np.zeros(20, int), time, draws, rules.shade)
    south = np.array([GROUPS.indices(state)[0] > 0 for state in closures.states])
    east = np.array([GROUPS.indices(state)[1] > 0 for state in closures.states])
    assert east[closures.drawn].all()
    # Two of 20 close it: both have to be above 1000 lx.
    both = (unpacked(draws.closing).sum(axis=0) == 2).mean()
    assert south[closures.drawn].mean() == pytest.approx(both)
    assert 0.1 < both < 0.5
    np.testing.assert_allclose(closures.shares(np.zeros(1, int))[0].mean(), 50 + 50 * both)


def test_each_room_closes_by_its_own_draws():
    """In one hour a hall is certain to close the east, a room in doubt whether to close the south.

    Of three rooms of 20, 4 and 4 points the last is certain to ask for nothing.
    """
    E, error = np.zeros((2, 28)), np.zeros((2, 28))
    E[0, :4] = 3000  # the hall, through the east
    E[0, 20], error[0, 20] = 1000, 300  # the room, through the south
    group = np.repeat([1, 0], [20, 8])[None].repeat(2, axis=0)
    grid = np.repeat([0, 1, 2], [20, 4, 4])
    rules = Rules(Metrics(), 1000.0, 0.2, 1.0, GROUPS)
    draws = draw_sun(E, error, (1000, 1000), None, 0)
    time = xr.DataArray(TIMES[:2], dims="time")
    closures = draw_closures(E, group, grid, time, draws, rules.shade)
    assert closures.states == ("open", "open/fabric", "fabric/fabric")
    np.testing.assert_array_equal(closures.state, [2, 0])  # a tie passes
    np.testing.assert_array_equal(closures.hours, [0])
    np.testing.assert_array_equal(closures.drawn[0], 1 + unpacked(draws.closing)[0])
    # Counted together, four of 28 or five of them are too few.
    together = draw_closures(E, group, np.zeros(28, int), time, draws, rules.shade)
    assert together.states == ("open",)


def test_draws_of_one_grid_are_those_without_grids():
    """Sensors in any order, groups and doubt at random; every draw by the rule itself."""
    rng = np.random.default_rng(3)
    E, error = rng.uniform(0, 2000, (2, 2, 30))
    group, grid = rng.integers(-1, 2, (2, 30)), rng.integers(0, 3, 30)
    shade = Rules(Metrics(), 1000.0, 0.3, 1.0, GROUPS).shade
    draws = draw_sun(E, error, (1000, 1000), None, 0)
    time = xr.DataArray(TIMES[:2], dims="time")
    for number in (grid, 0 * grid):
        closures = draw_closures(E, group, number, time, draws, shade)
        for k, closing in enumerate(unpacked(draws.closing).T):
            drawn = E >= 1000
            drawn[draws.time, draws.sensor] = closing
            lit = direct(np.where(drawn, 2000.0, 0), group)
            lit = lit.assign_coords(grid=("sensor", number.astype(str).astype(object)))
            expected = FacadeStates.of(
                {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.3}
                | GROUPS.attributes(),
                lit,
            ).of_group
            state = closures.state.copy()
            state[closures.hours] = closures.drawn[:, k]
            got = [GROUPS.indices(closures.states[i]) for i in state]
            np.testing.assert_array_equal(got, expected)
