"""Rules of others: LM-83's rule of the shade, and schedules."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.schedule import HOURS, Schedule
from drcmitsuba.case.shading import AREA, THRESHOLD
from drcmitsuba.controls.control import states_of
from drcmitsuba.metrics.facade_states import ShadeRule, sunlit
from drcmitsuba.metrics.grids import grid_of_sensors
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose


def lm83(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    threshold: float = THRESHOLD, area: float = AREA,
) -> xr.DataArray:  # fmt: skip
    """Rule of IES LM-83: groups close until less than 2 % of a grid's points are in the sun.

    It is that of `[shading]`; see `metrics.facade_states.ShadeRule`.

    Parameters
    ----------
    E : xr.Dataset
        `direct_sun` (time, sensor) [lx], all groups open; with several groups `sun_group`, too.
    weather : xr.Dataset
        Not used.
    time : xr.DataArray (time,)
    groups : GroupStates
    threshold, area : float
        Direct sun from which on a point counts [lx], and fraction of the points [–].

    Returns
    -------
    xr.DataArray of int, dims (time, group)
        The last state of closed groups, 0 of the others.

    Raises
    ------
    InputError
        E has no `direct_sun`.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> groups = controls.groups_of(drcmitsuba.load_case("office.toml"))
    >>> noon = np.array(["2015-03-20T12", "2015-03-20T13"], "datetime64[ns]")
    >>> time = xr.DataArray(noon, dims="time")
    >>> E = xr.Dataset({"direct_sun": (("time", "sensor"), [[0.0, 0.0], [0.0, 2500.0]])})
    >>> controls.lm83(E.assign_coords(time=time), None, time, groups=groups).values
    array([[0],
           [1]])
    """
    if "direct_sun" not in E:
        remedy = "give E of `drcmitsuba.evaluate`, or another control"
        raise InputError("lm83", "E", "no direct_sun", remedy)
    rule = ShadeRule(groups, threshold, area, Schedule({}, len(groups)))
    closed = rule.closed(sunlit(E, rule), np.bincount(grid_of_sensors(E)))
    return states_of(rule.indices(closed, time), time, groups, "lm83")


def scheduled(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    of_group: Mapping[str, np.ndarray],
) -> xr.DataArray:  # fmt: skip
    """States by a schedule, as `case.schedule.read_schedule` reads it from CSV.

    Parameters
    ----------
    E, weather : xr.Dataset
        Not used.
    time : xr.DataArray (time,)
    groups : GroupStates
    of_group : mapping of str to np.ndarray of int, shape (8760,)
        Index of the state of a group in every hour of the year, in the order of their time stamps
        where an array has them; other groups stay open.

    Raises
    ------
    InputError
        An unknown group, another number of hours, a state that the group does not have.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> case = drcmitsuba.load_case("corner_office.toml")
    >>> groups, weather = controls.groups_of(case), controls.outside(case)
    >>> import numpy as np
    >>> shut_at_night = np.tile(np.arange(24) < 6, 365).astype(int)
    >>> states = controls.scheduled(
    ...     None, weather, weather["time"], groups=groups, of_group={"east": shut_at_night}
    ... )
    >>> states.sel(group="east").values[:8]
    array([1, 1, 1, 1, 1, 1, 0, 0])
    """
    numbers = {}
    for name, states in of_group.items():
        if name not in groups.names:
            got = f"no group {name!r}"
            raise InputError("schedule", "group", got, choose(name, groups.names))
        if np.shape(states) != (HOURS,):
            got = f"{np.shape(states)} for group {name!r}"
            raise InputError("schedule", "hours", got, f"give {HOURS} states")
        g = groups.names.index(name)
        if isinstance(states, pd.Series):
            states = states.sort_index().to_numpy()
        if isinstance(states, xr.DataArray):
            states = states.sortby([*states.indexes]).values
        numbers[g] = np.asarray(states)
        if numbers[g].dtype.kind not in "iub":
            got = f"the type {numbers[g].dtype} for group {name!r}"
            raise InputError("schedule", "states", got, "give the index of each state, 0 for open")
        if (beyond := numbers[g][(numbers[g] < 0) | (numbers[g] > groups.last[g])]).size:
            got = f"{beyond[0]} for group {name!r}"
            raise InputError("schedule", "states", got, f"give an index from 0 to {groups.last[g]}")
    return states_of(Schedule(numbers, len(groups)).indices(time), time, groups, "schedule")
