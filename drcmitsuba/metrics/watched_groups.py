"""Groups of panes that belong to a space: the rule of the shade asks its own sensors alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.metrics.space_rows import read_rows


def spaces_of_groups(attributes: Mapping[Any, Any]) -> dict[str, set[str]]:
    """Names of the spaces that each group belongs to; groups of no space are left out.

    Raises
    ------
    InputError
        The attribute `spaces` is no list of spaces.
    """
    out: dict[str, set[str]] = {}
    for space, groups in read_rows(attributes, lambda row: (row["name"], row.get("groups") or ())):
        for group in groups:
            out.setdefault(group, set()).add(space)
    return out


def outside_of(groups: GroupStates, sensors: xr.Dataset) -> np.ndarray:
    """Whether each group belongs to spaces in which a sensor does not lie, bool, (group, sensor).

    `sensors` are C, E or coordinates of sensors: with several spaces the coordinate `space`
    (sensor,), and the attribute `spaces`.
    """
    out = np.zeros((len(groups), sensors.sizes["sensor"]), bool)
    own = spaces_of_groups(sensors.attrs)
    if own and "space" in sensors.coords:
        at = sensors["space"].values.astype(str)
        for index, name in enumerate(groups.names):
            out[index] = name in own and ~np.isin(at, list(own[name]))
    return out


def watched(sun_group: xr.DataArray, sensors: xr.Dataset) -> xr.DataArray:
    """Group of panes through which the direct sun comes, −1 for a group of other spaces.

    Parameters
    ----------
    sun_group : DataArray (time, sensor)
        Index of the group, −1 for none.
    sensors : xr.Dataset
        As for `outside_of`, with the attribute `groups`, too.

    Returns
    -------
    DataArray (time, sensor)
    """
    outside = outside_of(GroupStates.of_attributes(sensors.attrs), sensors)
    for group in np.flatnonzero(outside.any(axis=1)):
        others = xr.DataArray(outside[group], dims="sensor")
        sun_group = sun_group.where((sun_group != group) | ~others, -1)
    return sun_group
