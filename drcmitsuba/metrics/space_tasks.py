"""Daylight for the tasks of spaces: autonomy at the target of each in its hours, mean illuminance.

A space without a target of its own has the threshold of sDA, one without hours of its own has all
time stamps; sDA itself keeps its threshold and its hours whatever the uses are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.metrics import thresholds
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.spaces import SensorsOfSpace
from drcmitsuba.schema import luminance


def in_use(space: SensorsOfSpace, times: xr.Dataset, step_hours: float) -> np.ndarray:
    """Time stamps in the hours of a space, bool (time,); all, where none lies in them."""
    if space.hours is None:
        return np.ones(times.sizes["time"], bool)
    hour = thresholds.hour_of_day(times, step_hours)
    kept = (hour >= space.hours[0]) & (hour < space.hours[1])
    return kept if kept.any() else ~kept


def at_target(
    illuminance: xr.Dataset, spaces: Sequence[SensorsOfSpace], rules: Rules
) -> xr.Dataset:
    """Daylight autonomy of the sensors at the targets of their spaces, in the hours of these.

    Parameters
    ----------
    illuminance : xr.Dataset
        `total`, and with errors `total_se`, (time, sensor) [lx].
    spaces : sequence of SensorsOfSpace
        Spaces of its sensors.
    rules : Rules
        Rules with the threshold of spaces without a target, and the length of an interval.

    Returns
    -------
    xr.Dataset (sensor,)
        `DA` [%], `DA_low` and `DA_high` with all errors of E in one direction; 0 in no space.
    """
    total = luminance(illuminance["total"]).transpose("time", "sensor")
    E, half = thresholds.checked(total, "illuminance"), None
    if "total_se" in illuminance:
        error = luminance(illuminance["total_se"]).transpose("time", "sensor").values
        half = float(illuminance.attrs.get("interval_factor", 1.96)), error
    shares = np.zeros((3, E.shape[1]))
    for space in spaces:
        hours, sensors = in_use(space, illuminance, rules.step_hours), space.sensors
        here = np.ix_(hours, sensors)
        own = E if hours.all() and len(sensors) == E.shape[1] else E[here]
        limit = thresholds.not_negative("target", space.target or rules.metrics.sda_threshold)
        off = 0.0 if half is None else half[0] * (half[1] if own is E else half[1][here])
        for row, sign in enumerate((0, -1, 1)):
            moved = own if sign == 0 or half is None else own + sign * off
            count = thresholds.stamps_reached(moved, limit)
            shares[row, sensors] = 100.0 * count / len(own)
    names = ("DA", "DA_low", "DA_high")
    units = {"units": "%"}
    return xr.Dataset({n: ("sensor", row, units) for n, row in zip(names, shares, strict=True)})


def tasks(
    autonomy: xr.Dataset, spaces: Sequence[SensorsOfSpace], rules: Rules
) -> dict[str, dict[str, Any]]:
    """`target` [lx], `hours` and `DA` [%] of every space, its sensors' mean by floor area.

    `autonomy` is from `at_target` of all sensors. `hours` is None where all time stamps count.
    """
    out = {}
    for space in spaces:
        value, low, high = (
            float(autonomy[name].values[space.sensors] @ space.shares)
            for name in ("DA", "DA_low", "DA_high")
        )
        out[space.name] = {
            "target": space.target or rules.metrics.sda_threshold,
            "hours": None if space.hours is None else list(space.hours),
            "DA": {"value": value, "low": low, "high": high},
        }
    return out


def summed_daylight(
    illuminance: xr.Dataset, spaces: Sequence[SensorsOfSpace], here: slice = slice(None)
) -> np.ndarray:
    """Mean illuminance of spaces by floor area, or what a block of sensors adds to it.

    Parameters
    ----------
    illuminance : xr.Dataset
        `total` (time, sensor) of all sensors, or of the block `here` of them [lx].
    spaces : sequence of SensorsOfSpace
        Spaces of all sensors.
    here : slice
        Sensors of the block among all.

    Returns
    -------
    np.ndarray, shape (time, space)
        Σ share · E over the sensors of the block [lx].
    """
    E = luminance(illuminance["total"]).transpose("time", "sensor").values
    first, stop = here.start or 0, here.stop
    out = np.zeros((len(E), len(spaces)))
    for k, space in enumerate(spaces):
        inside = space.sensors >= first
        if stop is not None:
            inside &= space.sensors < stop
        if inside.any():
            out[:, k] = E[:, space.sensors[inside] - first] @ space.shares[inside]
    return out
