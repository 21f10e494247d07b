"""States as a schedule of the case: CSV with a line for every hour of the year."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.schedule import HOURS
from drcmitsuba.controls.control import states_of
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order
from drcmitsuba.scene.prepared_case import prepared


def groups_of(case: Case) -> GroupStates:
    """Groups of panes of a case, and their states, without simulating it.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> controls.groups_of(drcmitsuba.load_case("corner_office.toml")).names
    ('south', 'east')
    """
    return prepared(case).groups.states


def save_schedule(states: xr.DataArray, groups: GroupStates, path: str | Path) -> None:
    """Write states as a schedule, which `schedule` of `[groups.NAME]` reads.

    Parameters
    ----------
    states : xr.DataArray of int, dims (time, group)
        Index of every group's state, as any control returns it. Hours without a time stamp are
        open; an hour with several takes the highest of their states.
    groups : GroupStates
        Groups of the case; those with a single state have no column.
    path : str or Path
        CSV file to write, whole or not at all.

    Raises
    ------
    InputError
        States of other groups, or no group with several states.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> case = drcmitsuba.load_case("corner_office.toml")
    >>> groups, weather = controls.groups_of(case), controls.outside(case)
    >>> states = controls.facade_irradiance(
    ...     None, weather, weather["time"], groups=groups, azimuths=[180, 90]
    ... )
    >>> controls.save_schedule(states, groups, "states.csv")
    """
    if not isinstance(states, xr.DataArray) or "time" not in states.coords:
        got, remedy = "states without time stamps", "give a DataArray over time and group"
        raise InputError("schedule", "states", got, remedy)
    labels = {"time": states["time"].values, "group": groups.names}
    values = in_order(states, labels, "schedule")
    values = states_of(values, states["time"], groups, "schedule").values
    chosen = [g for g, last in enumerate(groups.last) if last]
    if not chosen:
        got = "no group with several states"
        raise InputError("schedule", "groups", got, "give panes a further state in [groups]")
    if Path(path).is_dir():
        raise InputError(path, "schedule", "it is a folder", "name a file: states.csv")
    time = states["time"].values
    hour = (time - time.astype("datetime64[Y]")).astype("timedelta64[h]").astype(int)
    leap = states["time"].dt.is_leap_year.values & (states["time"].dt.dayofyear.values > 59)
    hour = hour - 24 * leap  # 29 February counts as 28 February
    of_year = np.zeros((HOURS, len(groups)), int)
    np.maximum.at(of_year, hour, values)
    names = [groups.names[g] for g in chosen]
    lines = [",".join(map(_cell, names))]
    lines += [",".join(_cell(groups.states[g][row[g]]) for g in chosen) for row in of_year.tolist()]
    storage.save_text("\n".join(lines) + "\n", Path(path))


def _cell(text: str) -> str:
    """Text as a cell of CSV."""
    quoted = text.replace('"', '""')
    return f'"{quoted}"' if any(c in text for c in ',"\n\r') else text
