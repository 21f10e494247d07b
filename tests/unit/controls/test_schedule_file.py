"""States that are written as a schedule are read again, and weather of a whole year."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import controls
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.schedule import Schedule, read_schedule
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import tomllib
from drcmitsuba.sky.daylight import daylight
from tests.system.small_room import CASE

GROUPS = GroupStates(("south", "(others)", 'a "b", c'), (("open", "half", "shut"), ("open",),
                                                          ("open", "x")))  # fmt: skip


def test_states_are_read_again(tmp_path):
    time = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]").astype("datetime64[ns]")
    rng = np.random.default_rng(4)
    values = np.stack([rng.integers(0, last + 1, 8760) for last in GROUPS.last], axis=1)
    states = xr.DataArray(values, {"time": time}, ("time", "group"))
    controls.save_schedule(states, GROUPS, tmp_path / "states.csv")
    of_group = {
        g: read_schedule(tmp_path / "states.csv", GROUPS.names[g], GROUPS.states[g]) for g in (0, 2)
    }
    again = Schedule(of_group, 3).indices(states["time"])
    np.testing.assert_array_equal(again, values)


def test_other_hours_are_open_and_parts_of_an_hour_take_the_highest(tmp_path):
    time = np.array(["2015-01-01T02:00", "2015-01-01T02:30", "2015-03-01T00:00"], "M8[ns]")
    values = np.array([[1, 0, 0], [2, 0, 1], [1, 0, 0]])
    states = xr.DataArray(values, {"time": time}, ("time", "group"))
    controls.save_schedule(states, GROUPS, tmp_path / "states.csv")
    read = read_schedule(tmp_path / "states.csv", "south", GROUPS.states[0])
    assert (read[2], read[59 * 24], np.count_nonzero(read)) == (2, 1, 2)


def test_leap_years_lose_their_day(tmp_path):
    time = np.array(["2016-02-28T05:00", "2016-03-01T00:00", "2016-12-31T23:00"], "M8[ns]")
    states = xr.DataArray(np.full((3, 3), [1, 0, 1]), {"time": time}, ("time", "group"))
    controls.save_schedule(states, GROUPS, tmp_path / "states.csv")
    read = read_schedule(tmp_path / "states.csv", "south", GROUPS.states[0])
    assert np.flatnonzero(read).tolist() == [58 * 24 + 5, 59 * 24, 8759]


def test_states_of_other_groups_are_refused(tmp_path):
    states = xr.DataArray(np.zeros((1, 2), int), {"time": [np.datetime64("2015", "ns")]},
                          ("time", "group"))  # fmt: skip
    with pytest.raises(InputError, match="the shape"):
        controls.save_schedule(states, GROUPS, tmp_path / "states.csv")
    single = GroupStates(("a", "b"), (("open",), ("open",)))
    with pytest.raises(InputError, match="no group with several states"):
        controls.save_schedule(states, single, tmp_path / "states.csv")
    of_all = xr.DataArray(np.zeros((1, 3), int), states.coords, states.dims)
    with pytest.raises(InputError, match="it is a folder"):
        controls.save_schedule(of_all, GROUPS, tmp_path)
    assert not (tmp_path / "states.csv").exists()


def test_the_weather_of_a_case_is_a_part_of_that_of_its_year():
    case = Case(**tomllib.loads(CASE))
    light = daylight(case)
    year, part = controls.outside(case), controls.outside(case, light)
    assert year.sizes["time"] == 8760
    at = year.sel(time=part["time"])
    for name in ("dni", "dhi", "ghi", "sun_direction"):
        np.testing.assert_array_equal(at[name].values, part[name].values)
    assert year["ghi"].max() > 800
    assert controls.groups_of(case).names == ("shade",)
