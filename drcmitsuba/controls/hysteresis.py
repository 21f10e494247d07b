"""Controls by a threshold with hysteresis: at the work plane, on the façade, at the eye.

A group closes when its signal reaches `close`, opens when it falls below `reopen`, and keeps its
state in between. Every day begins open: the night before was dark.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.controls.control import in_state, states_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order


def closed_by(signal: np.ndarray, time: xr.DataArray, close: float, reopen: float) -> np.ndarray:
    """Whether each group is closed.

    Parameters
    ----------
    signal : np.ndarray, shape (time, group)
        Any signal that rises with the light, time stamps in order.
    time : xr.DataArray (time,)
        Dates.
    close, reopen : float
        Thresholds in the unit of the signal; ties close, and ties stay closed.

    Returns
    -------
    np.ndarray of bool, shape (time, group)

    Raises
    ------
    InputError
        NaN in the signal, or `reopen` above `close`.
    """
    if not np.isfinite(signal).all():
        raise InputError("control", "signal", "NaN or infinite", "give a finite signal")
    if not reopen <= close < np.inf:
        got = f"close {close:g}, reopen {reopen:g}"
        raise InputError("control", "thresholds", got, "give reopen at or below close")
    days = time.values.astype("datetime64[D]")
    first = np.append(True, days[1:] != days[:-1])[:, None]
    shuts = signal >= close
    decides = shuts | (signal < reopen) | first
    # The last time stamp, up to each, at which the signal decides.
    last = np.maximum.accumulate(np.where(decides, np.arange(len(days))[:, None], 0), axis=0)
    return np.take_along_axis(shuts, last, axis=0)


def work_plane(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    close: float = 2000.0, reopen: float | None = None, state: int | None = None,
) -> xr.DataArray:  # fmt: skip
    """Close all groups where the mean illuminance of the work plane is too high.

    Parameters
    ----------
    E : xr.Dataset
        `total_open` (time, sensor), all groups open [lx].
    weather : xr.Dataset
        Not used.
    time : xr.DataArray (time,)
    groups : GroupStates
    close, reopen : float
        Mean illuminance at which groups close, and below which they open, by default the same [lx].
    state : int, optional
        Index of the state that closed groups take, those with fewer states their last one; by
        default the last one of each.

    Returns
    -------
    xr.DataArray of int, dims (time, group)

    Raises
    ------
    InputError
        As `closed_by` and `control.states_of`, and `control.in_state` for `state`.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> groups = controls.groups_of(drcmitsuba.load_case("corner_office.toml"))
    >>> noon = np.array(["2015-03-20T12", "2015-03-20T13"], "datetime64[ns]")
    >>> time = xr.DataArray(noon, dims="time")
    >>> E = xr.Dataset({"total_open": (("time", "sensor"), [[500.0, 900.0], [4000.0, 6000.0]])})
    >>> controls.work_plane(E, None, time, groups=groups, close=3000).values
    array([[0, 0],
           [2, 1]])
    """
    light = in_order(E["total_open"], {"time": time.values}, "total_open")
    mean = light.reshape(len(light), -1).mean(axis=1, dtype=float)
    signal = np.repeat(mean[:, None], len(groups), axis=1)
    return _closing(signal, time, groups, close, reopen, state)


def vertical_illuminance(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    eyes: xr.DataArray, close: float = 2000.0, reopen: float | None = None,
    state: int | None = None,
) -> xr.DataArray:  # fmt: skip
    """Close all groups where the vertical illuminance at any eye is too high.

    Parameters
    ----------
    eyes : xr.DataArray (time, sensor)
        Vertical illuminance at the eyes, all groups open [lx]: of sensors that face as people do.
    close, reopen : float
        Illuminance at which groups close, and below which they open, by default the same [lx].
    E, weather, time, groups, state
        As for `work_plane`; E is not used.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> groups = controls.groups_of(drcmitsuba.load_case("corner_office.toml"))
    >>> noon = np.array(["2015-03-20T12", "2015-03-20T13"], "datetime64[ns]")
    >>> time = xr.DataArray(noon, dims="time")
    >>> eyes = xr.DataArray([[800.0], [5000.0]], {"time": time}, ("time", "sensor"))
    >>> controls.vertical_illuminance(None, None, time, groups=groups, eyes=eyes).values
    array([[0, 0],
           [2, 1]])
    """
    at_eyes = in_order(eyes, {"time": time.values}, "eyes")
    highest = at_eyes.reshape(len(at_eyes), -1).max(axis=1)
    signal = np.repeat(highest[:, None], len(groups), axis=1)
    return _closing(signal, time, groups, close, reopen, state)


def facade_irradiance(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    azimuths: Sequence[float], close: float = 200.0, reopen: float | None = None,
    state: int | None = None, ground_reflectance: float = 0.2,
) -> xr.DataArray:  # fmt: skip
    """Close a group where the irradiance on its façade is too high.

    I = DNI max(s·n, 0) + DHI / 2 + ρ GHI / 2 on a vertical façade, under an even sky.

    Parameters
    ----------
    weather : xr.Dataset
        `dni`, `dhi`, `ghi` (time,) [W/m²], `sun_direction` (time, axis), from `outside`.
    azimuths : sequence of float, one for each group
        Direction that the group faces, from north by east [deg].
    close, reopen : float
        Irradiance at which a group closes, and below which it opens, by default the same [W/m²].
    ground_reflectance : float
        ρ of the ground [–].
    E, time, groups, state
        As for `work_plane`; E is not used.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> case = drcmitsuba.load_case("corner_office.toml")
    >>> groups, weather = controls.groups_of(case), controls.outside(case)
    >>> states = controls.facade_irradiance(
    ...     None, weather, weather["time"], groups=groups, azimuths=[180, 90], close=150, reopen=100
    ... )
    >>> states.dims
    ('time', 'group')
    """
    n = normals(azimuths, groups)
    names, hours = ("sun_direction", "dni", "dhi", "ghi"), {"time": time.values}
    sun, *rest = (in_order(weather[name], hours, "weather") for name in names)
    dni, dhi, ghi = (values[:, None] for values in rest)
    up = sun[:, 2:] > 0
    direct = dni * np.maximum(sun @ n.T, 0) * up
    signal = direct + dhi / 2 + ground_reflectance * ghi / 2
    return _closing(signal, time, groups, close, reopen, state)


def normals(azimuths: Sequence[float], groups: GroupStates) -> np.ndarray:
    """Horizontal normals of façades, (group, 3): x east, y north; azimuths [deg]."""
    if np.shape(azimuths) != (len(groups),) or not np.isfinite(azimuths).all():
        got = f"{np.size(azimuths)} for {len(groups)} groups ({', '.join(groups.names)})"
        raise InputError("control", "azimuths", got, "give degrees from north for each group")
    a = np.radians(np.asarray(azimuths, float))
    return np.stack([np.sin(a), np.cos(a), np.zeros(len(a))], axis=1)


def _closing(
    signal: np.ndarray, time: xr.DataArray, groups: GroupStates, close: float,
    reopen: float | None, state: int | None,
) -> xr.DataArray:  # fmt: skip
    """States by `closed_by`: `state`, or the last one, of closed groups."""
    closed = closed_by(signal, time, close, close if reopen is None else reopen)
    taken = np.array(groups.last, int) if state is None else in_state(state, groups)
    return states_of(closed * taken, time, groups)
