"""Best state of the façade in every hour by an objective."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates, State
from drcmitsuba.controls.control import states_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order


def best_state(
    by_state: Mapping[State, xr.DataArray],
    objective: Callable[[xr.DataArray], xr.DataArray],
    groups: GroupStates,
) -> xr.DataArray:
    """Take in every hour the state of the façade whose objective is highest.

    Parameters
    ----------
    by_state : mapping of str to xr.DataArray (time, sensor)
        E of every state of the façade at all hours [lx], by its name, such as "open/blind".
    objective : callable
        Function of such an array that gives a value for every time stamp, (time,).
    groups : GroupStates

    Returns
    -------
    xr.DataArray of int, dims (time, group)
        Of states with equal values, the one that comes first in `by_state`.

    Raises
    ------
    InputError
        No state, an unknown one, or an objective of another shape or with NaN.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> groups = controls.groups_of(drcmitsuba.load_case("corner_office.toml"))
    >>> noon = np.array(["2015-03-20T12", "2015-03-20T13"], "datetime64[ns]")
    >>> time = xr.DataArray(noon, dims="time")
    >>> by_state = {
    ...     "open/open": xr.DataArray([[400.0], [5000.0]], {"time": time}, ("time", "sensor")),
    ...     "fabric/fabric": xr.DataArray([[60.0], [700.0]], {"time": time}, ("time", "sensor")),
    ... }
    >>> controls.best_state(by_state, lambda E: -abs(E - 500.0).mean("sensor"), groups).values
    array([[0, 0],
           [2, 1]])
    """
    if not by_state:
        raise InputError("best_state", "by_state", "no state", "give E of at least one state")
    time = next(iter(by_state.values()))["time"]
    values = []
    for state, E in by_state.items():
        value = in_order(objective(E), {"time": time.values}, f"objective of {state}")
        if value.shape != time.shape or not np.isfinite(value).all():
            got = f"the shape {value.shape} or NaN for state {state!r}"
            raise InputError("best_state", "objective", got, f"give {time.shape} finite values")
        values.append(value)
    chosen = np.argmax(np.stack(values), axis=0)
    indices = np.array([groups.indices(state) for state in by_state])
    return states_of(indices[chosen], time, groups, "best_state")
