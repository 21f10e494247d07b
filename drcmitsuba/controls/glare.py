"""Control by glare: the first state of the façade in which no eye is dazzled."""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.controls.control import states_of
from drcmitsuba.runtime.errors import InputError


def glare(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    dgp: xr.DataArray, limit: float = 0.40,
) -> xr.DataArray:  # fmt: skip
    """Take in every hour the first state in which no view has a DGP above a limit.

    Parameters
    ----------
    E, weather : xr.Dataset
        Not used.
    time : xr.DataArray (time,)
    groups : GroupStates
    dgp : xr.DataArray, dims (state, time, view)
        Daylight glare probability as `GlareYear.hours["dgp"]`, of the views that count; its states
        are tried in their order, `applied` is not.
    limit : float
        Largest DGP that is allowed [–].

    Returns
    -------
    xr.DataArray of int, dims (time, group)
        The state with the least glare, where all exceed the limit.

    Raises
    ------
    InputError
        Other dims, a NaN, a limit out of range, a time stamp without DGP, or an unknown state.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> groups = controls.groups_of(drcmitsuba.load_case("corner_office.toml"))
    >>> noon = np.array(["2015-03-20T12", "2015-03-20T13"], "datetime64[ns]")
    >>> time = xr.DataArray(noon, dims="time")
    >>> dgp = xr.DataArray(
    ...     [[[0.30], [0.45]], [[0.25], [0.30]]], dims=("state", "time", "view"),
    ...     coords={"state": ["open", "shaded"], "time": time},
    ... )
    >>> controls.glare(None, None, time, groups=groups, dgp=dgp).values
    array([[0, 0],
           [2, 1]])
    """
    if set(dgp.dims) != {"state", "time", "view"}:
        got = f"dims {', '.join(map(str, dgp.dims))}"
        raise InputError("glare", "dgp", got, "give state, time and view")
    if not 0 < limit < 1:
        raise InputError("glare", "limit", f"{limit}", "give a DGP from 0 to 1")
    missing = ~np.isin(time.values, dgp["time"].values)
    if missing.any():
        first = np.datetime_as_string(time.values[missing][0], unit="m")
        got = f"no value for {int(missing.sum())} time stamps, {first} the first"
        raise InputError("glare", "dgp", got, "compute glare for the same period")
    names = [str(name) for name in dgp["state"].values if name != "applied"]
    worst = dgp.sel(state=names, time=time.values).max("view", skipna=False)
    values = worst.transpose("time", "state").values
    if not np.isfinite(values).all() or not len(names):
        raise InputError("glare", "dgp", "NaN or no state", "give finite values of some states")
    fits = values <= limit
    chosen = np.where(fits.any(axis=1), fits.argmax(axis=1), values.argmin(axis=1))
    indices = np.array([groups.indices(name) for name in names])
    return states_of(indices[chosen], time, groups, "glare")
