"""Autonomy of spaces at their targets in their hours, on a day that is counted by eye."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.metrics.confidence import Interval
from drcmitsuba.metrics.evaluate_metrics import summarise
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.space_tasks import at_target, in_use
from drcmitsuba.metrics.space_years import SpaceYears
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.runtime.errors import InputError

RULES = Rules(Metrics(sda_threshold=300), 1000.0, 0.02, 1.0)
HOURS = np.arange("2015-03-02T08", "2015-03-02T12", dtype="datetime64[h]").astype("datetime64[ns]")
ROWS = [
    {"name": "west", "use": "office", "storey": "", "floor_area": 12.0, "target": 500.0,
     "hours": [9, 11], "power": 10.0},
    {"name": "east", "use": "", "storey": "", "floor_area": 4.0},
]  # fmt: skip
E_LUX = np.array(
    [[900.0, 900, 100], [400, 600, 300], [500, 499, 299], [0, 0, 500]]
)  # (time, sensor)


def year(error=0.0, rows=ROWS, **coords):
    """E of two sensors in the west and one in the east, from 8 to 12 h."""
    dims = ("time", "sensor")
    E = {"total": (dims, E_LUX), "total_se": (dims, error + 0 * E_LUX)}
    E |= {"direct_sun": (dims, 0 * E_LUX), "direct_sun_se": (dims, 0 * E_LUX)}
    at = {"space": ("sensor", np.array(["west", "west", "east"], object))}
    at |= {axis: ("sensor", np.arange(3.0)) for axis in "xyz"} | {"grid": at["space"]}
    attrs = {"spaces": json.dumps(rows), "interval_factor": 2.0}
    return xr.Dataset(E, {"time": HOURS, **at, **coords}, attrs)


def test_a_space_counts_its_target_in_its_hours():
    """West: at 9 h one sensor of two has 500 lx, at 10 h the other. East: 300 lx at 9 and 11 h."""
    E = year()
    spaces = sensors_by_space(E)
    assert at_target(E, spaces, RULES)["DA"].values.tolist() == [50, 50, 50]
    years = SpaceYears.of_errors(E, spaces, RULES)
    assert years.autonomy.tolist() == [[50, 50]] * 3
    rows = summarise(E, RULES, years=years)["spaces"]
    told = {row["name"]: {key: row[key] for key in ("target", "hours", "DA")} for row in rows}
    DA = {"value": 50, "low": 50, "high": 50}
    assert told["west"] == {"target": 500, "hours": [9, 11], "DA": DA}
    assert told["east"] == {"target": 300, "hours": None, "DA": DA}


def test_bounds_have_all_errors_in_one_direction():
    """±2 · 0.5 lx: 500 and 300 fail at the lower end, 499 and 299 pass at the upper one."""
    E = year(0.5)
    years = SpaceYears.of_errors(E, sensors_by_space(E), RULES)
    for values in years.autonomy.T:
        assert years.interval(values) == Interval(50, 25, 75)
    np.testing.assert_allclose(years.daylight[:, 0, 0], [900, 899, 901])
    assert years.daylight[:, 3, 0].tolist() == [0, 0, 1]  # no light is negative


def test_hours_are_those_of_the_clock():
    E = year(clock=("time", HOURS + np.timedelta64(1, "h")))
    west, east = sensors_by_space(E)
    assert in_use(west, E, 1.0).tolist() == [True, True, False, False]
    assert in_use(east, E, 1.0).all()
    night = sensors_by_space(year(rows=[{**ROWS[0], "hours": [10, 9]}, ROWS[1]]))[0]
    assert in_use(night, year(), 1.0).tolist() == [True, False, True, True]  # past midnight
    evening = sensors_by_space(year(rows=[{**ROWS[0], "hours": [20, 22]}, ROWS[1]]))[0]
    assert in_use(evening, E, 1.0).all()  # the period has none of them


def test_daylight_is_the_mean_of_the_floor():
    E = year()
    years = SpaceYears.of_errors(E, sensors_by_space(E), RULES)
    np.testing.assert_allclose(years.daylight[0], [[900, 100], [500, 300], [499.5, 299], [0, 500]])


def test_sensors_of_grids_of_other_spacing_stand_for_other_areas():
    """Nine points 1 m apart stand for 9 m², four points 2 m apart for 16 m²."""
    x, y = (np.concatenate([np.repeat(np.arange(3.0), 3), 10 + np.repeat([0.0, 2.0], 2)]),
            np.concatenate([np.tile(np.arange(3.0), 3), np.tile([0.0, 2.0], 2)]))  # fmt: skip
    at = {"x": x, "y": y, "z": 0 * x, "grid": np.repeat(np.array(["a", "b"], object), [9, 4])}
    E = xr.Dataset(
        coords={name: ("sensor", v) for name, v in at.items()},
        attrs={"spaces": json.dumps([ROWS[0]])},
    )
    (space,) = sensors_by_space(E)
    np.testing.assert_allclose(space.shares, np.repeat([1 / 25, 4 / 25], [9, 4]))
    in_line = E.assign_coords(y=("sensor", np.where(x < 10, y, 0.0)))
    (space,) = sensors_by_space(in_line.assign_coords(x=("sensor", np.arange(13.0))))
    np.testing.assert_allclose(space.shares, 1 / 13)


@pytest.mark.parametrize("hours", [3, [1], ["a", "b"], [1, 2, 3], [0, float("inf")]])
def test_damaged_hours_are_named(hours):
    with pytest.raises(InputError, match="spaces"):
        sensors_by_space(year(rows=[{**ROWS[0], "hours": hours}, ROWS[1]]))
