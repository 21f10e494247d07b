"""Useful daylight illuminance, UDI, and its smooth twin.

References
----------
.. [1] J. Mardaljevic, M. Andersen, N. Roy, J. Christoffersen, "Daylighting metrics: is there a
   relation between useful daylight illuminance and daylight glare probability?", BSO 2012.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.metrics import smooth_step, thresholds
from drcmitsuba.metrics.point_autonomy import by_sensor
from drcmitsuba.runtime.errors import InputError

RANGES = ("fell short", "supplementary", "autonomous", "exceeded")
"""Ranges of illuminance, from the lowest."""
LIMITS = (100.0, 300.0, 3000.0)
"""Illuminances between the ranges [lx]."""


def udi(illuminance: xr.DataArray, limits: Sequence[float] = LIMITS) -> xr.DataArray:
    """Useful daylight illuminance, the share of the time stamps in each range of illuminance [1].

    The ranges are E < 100 lx, 100 lx ≤ E < 300 lx, 300 lx ≤ E ≤ 3000 lx and E > 3000 lx: a tie
    passes to the useful side. The sum of `supplementary` and `autonomous` is UDI combined.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance with the shade applied, at the hours of the evaluation period [lx].
    limits : sequence of 3 floats
        Rising illuminances between the ranges [lx].

    Returns
    -------
    DataArray (range, sensor)
        Shares of the time stamps [%], whose sum over `range` is 100 %.

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, limits that do not rise.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.udi(E).sum("range").values
    array([100., 100.])
    """
    low, useful, high = _rising(limits)
    E = thresholds.checked(illuminance, "illuminance")
    reached = [thresholds.stamps_reached(E, limit) for limit in (low, useful)]
    above = np.zeros(E.shape[1], np.int64)
    for block in thresholds.blocks(E):
        above += np.count_nonzero(block > high, axis=0)
    stamps = len(E)
    counts = (stamps - reached[0], reached[0] - reached[1], reached[1] - above, above)
    parts = [by_sensor(illuminance, 100.0 * n / stamps, "UDI", "") for n in counts]
    out = xr.concat(parts, xr.Variable("range", np.array(RANGES, dtype=object)))
    out.attrs = {"units": "%", "long_name": "useful daylight illuminance"}
    return out


def smooth_udi(
    illuminance: mi.TensorXf, limits: Sequence[float] = LIMITS, *, sharpness: float
) -> mi.TensorXf:
    """Twin of `udi`: differences of 100 · mean_t s(E_tj; limit), tensor (range, sensor) [%].

    Parameters
    ----------
    illuminance : mi.TensorXf (time, sensor)
        Illuminance with the shade applied [lx].
    limits, sharpness
        As for `udi`; k of the steps.
    """
    stamps = illuminance.shape[0]
    reached = [
        smooth_step.stamps_reached(illuminance, limit, sharpness) for limit in _rising(limits)
    ]
    low, useful, high = (100 * n / stamps for n in reached)
    rows = (100 - low, low - useful, useful - high, high)
    return mi.TensorXf(dr.concat([row.array for row in rows]), (len(rows), low.shape[0]))


def _rising(limits: Sequence[float]) -> tuple[float, float, float]:
    """Three limits that rise, else an InputError."""
    values = tuple(thresholds.not_negative("limits", limit) for limit in limits)
    if len(values) != 3 or not values[0] < values[1] < values[2]:
        got = f"{tuple(limits)}"
        raise InputError("metrics", "limits", got, "give three that rise, such as 100, 300, 3000")
    return values
