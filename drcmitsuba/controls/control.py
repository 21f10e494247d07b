"""Controls: functions of E, weather and time that give the states of the façade."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order
from drcmitsuba.runtime.toml import shortened

Control = Callable[[xr.Dataset, xr.Dataset, xr.DataArray], Any]
"""Function of E with all groups open [lx], of the weather from `outside` and of the time stamps. It
returns the index of every group's state, int, (time, group). `functools.partial` makes one of any
function of this room: it fixes what follows these three arguments."""


def states_of(
    indices: np.ndarray, time: xr.DataArray, groups: GroupStates, source: str = "control"
) -> xr.DataArray:
    """Check states, and name their time stamps and groups.

    Parameters
    ----------
    indices : np.ndarray of int, shape (time, group)
        Index of every group's state.
    time : xr.DataArray (time,)
    groups : GroupStates
        Names of the groups and of their states.
    source : str
        Name of the control in error messages.

    Returns
    -------
    xr.DataArray of int, dims (time, group)

    Raises
    ------
    InputError
        Another shape, no whole numbers, or a state that a group does not have.
    """
    values = np.asarray(indices)
    shape = (time.sizes["time"], len(groups))
    if values.shape != shape:
        got = f"the shape {values.shape}"
        raise InputError(source, "states", got, f"give {shape}: time stamps and groups")
    if values.dtype.kind not in "iub":
        remedy = "give the index of each state, 0 for open"
        raise InputError(source, "states", f"the type {values.dtype}", remedy)
    beyond = (values < 0) | (values > np.array(groups.last))
    if beyond.any():
        row, group = (int(i[0]) for i in np.nonzero(beyond))
        name, last = groups.names[group], groups.last[group]
        got = f"{values[row, group]} for group {name!r}"
        raise InputError(source, "states", got, f"give an index from 0 to {last}")
    names = np.array(groups.names, dtype=object)
    coords = {"time": time["time"], "group": names}
    return xr.DataArray(values.astype(int), coords, ("time", "group"), "facade_state")


def called(
    control: Control, E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, groups: GroupStates
) -> xr.DataArray:
    """States by any function of the user's, checked.

    Parameters
    ----------
    control : callable
        Function of (E, weather, time), see `Control`.
    E, weather : xr.Dataset
        Illuminance with all groups open [lx]; weather from `outside`.
    time : xr.DataArray (time,)
    groups : GroupStates

    Returns
    -------
    xr.DataArray of int, dims (time, group)

    Raises
    ------
    InputError
        As `states_of`.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> groups = controls.groups_of(drcmitsuba.load_case("corner_office.toml"))
    >>> noon = np.array(["2015-03-20T12", "2015-03-20T13"], "datetime64[ns]")
    >>> time = xr.DataArray(noon, dims="time")
    >>> controls.called(
    ...     lambda E, weather, time: np.ones((len(time), 2), int), None, None, time, groups
    ... ).values
    array([[1, 1],
           [1, 1]])
    """
    name = getattr(control, "__name__", type(control).__name__)
    labels: dict[str, Any] = {"time": time.values, "group": groups.names}
    return states_of(in_order(control(E, weather, time), labels, name), time, groups, name)


def seasonal(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    control: Control, months: Collection[int], state: int = 0,
) -> xr.DataArray:  # fmt: skip
    """Another control, but one state in some months: a blind or a film that winter takes out.

    Parameters
    ----------
    E, weather, time, groups
        As for `called`.
    control : Control
        Control of the other months.
    months : collection of int
        Months, 1 to 12, in which every group has `state`, or its last state where it has fewer.
    state : int
        Index of that state.

    Raises
    ------
    InputError
        As `states_of` and `in_state`; months out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> case = drcmitsuba.load_case("corner_office.toml")
    >>> groups, weather = controls.groups_of(case), controls.outside(case)
    >>> from functools import partial
    >>> by_sun = partial(controls.facade_irradiance, groups=groups, azimuths=[180, 90])
    >>> states = controls.seasonal(
    ...     None, weather, weather["time"], groups=groups, control=by_sun, months=[12, 1, 2]
    ... )
    >>> int(states.sel(time="2015-01").max())
    0
    """
    if not set(months) <= set(range(1, 13)):
        raise InputError("seasonal", "months", f"{sorted(months)}", "give numbers from 1 to 12")
    others = called(control, E, weather, time, groups)
    out_of_season = np.isin(time.dt.month.values, list(months))[:, None]
    fixed = in_state(state, groups)
    return states_of(np.where(out_of_season, fixed, others.values), time, groups, "seasonal")


def in_state(state: int, groups: GroupStates) -> np.ndarray:
    """Indices of the groups' states, int, (group,): one for all, or the last one of fewer states.

    Raises
    ------
    InputError
        It is no index, or no group has so many states.
    """
    most = max(groups.last, default=0)
    if not isinstance(state, int | np.integer) or not 0 <= state <= most:
        remedy = f"give the index of a state, from 0 to {most}"
        raise InputError("control", "state", shortened(str(state)), remedy)
    return np.minimum(state, np.array(groups.last, int))
