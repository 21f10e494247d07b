"""Daylight for the tasks of spaces: autonomy at the target of each in its hours.

A space without a target of its own has the threshold of sDA, one without hours of its own has all
time stamps; sDA itself keeps its threshold and its hours whatever the uses are.
"""

from __future__ import annotations

from collections.abc import Sequence

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
    first, last = space.hours
    after, before = hour >= first, hour < last
    kept = after & before if first < last else after | before  # past midnight
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
