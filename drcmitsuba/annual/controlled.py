"""A year whose groups of panes follow a control: E of its states, without tracing again."""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.annual.elements import Elements
from drcmitsuba.controls.control import Control, called
from drcmitsuba.schema import describe, luminance


def controlled(year: Elements, control: Control, weather: xr.Dataset) -> xr.Dataset:
    """Illuminance of a year with the groups of panes in the states that a control states.

    Parameters
    ----------
    year : Elements
        From `drcmitsuba.elements`.
    control : callable
        Function of (E, weather, time) that gives the state of every group, int, (time, group), see
        `drcmitsuba.controls`. E is by luminance, all groups open: `total_open` (time, sensor) [lx].
    weather : xr.Dataset
        What the control sees of the weather, from `controls.outside`.

    Returns
    -------
    xr.Dataset
        `total`, `total_open` and their standard errors (time, sensor) [lx], with the coordinates
        `clock` (time,), `facade_state` (time, group) and `group`.

    Raises
    ------
    InputError
        The control returns another shape, or a state that a group does not have.

    Examples
    --------
    >>> import drcmitsuba
    >>> from functools import partial
    >>> from drcmitsuba import controls
    >>> light = drcmitsuba.elements("corner_office.toml")
    >>> control = partial(controls.work_plane, groups=light.groups, close=3000, reopen=1500)
    >>> E = drcmitsuba.controlled(light, control, controls.outside(light.case, light.daylight))
    >>> E["total"].dims
    ('time', 'sensor')
    """
    sky, groups = year.daylight.sky, year.groups
    is_open = year.in_states(np.zeros((sky.sizes["time"], len(groups)), int))
    is_open = is_open.rename(total="total_open", total_se="total_open_se")
    is_open = is_open.assign_coords(clock=sky["clock"])
    seen = xr.Dataset({"total_open": luminance(is_open["total_open"])})
    states = called(control, seen, weather, sky["time"], groups)
    out = year.in_states(states.values).merge(is_open, compat="override", join="exact")
    of_group = (("time", "group"), states.values.astype(np.float32))
    out = out.assign_coords(group=states["group"], facade_state=of_group)
    out.attrs = {"step_hours": year.daylight.step_hours, **groups.attributes()}
    return describe(out)
