"""Daylight autonomy of single points: DA, continuous cDA, smooth twins; shares of points.

References
----------
.. [1] C. F. Reinhart, O. Walkenhorst, "Validation of dynamic RADIANCE-based daylight simulations
   for a test office with external blinds", Energy and Buildings 33(7), 2001 (DA).
.. [2] Z. Rogers, "Daylighting metric development using daylight autonomy calculations in the sensor
   placement optimization tool", Architectural Energy Corporation, 2006 (cDA).
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.metrics import smooth_step, thresholds
from drcmitsuba.runtime.errors import InputError


def da(illuminance: xr.DataArray, threshold: float = 300.0) -> xr.DataArray:
    """Daylight autonomy, the share of the time stamps at which a point has enough daylight [1].

    DA_j = #{t : E_tj ≥ E₀} / T.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance with the shade applied, at the hours of the evaluation period [lx].
    threshold : float
        E₀, illuminance that counts as reached [lx].

    Returns
    -------
    DataArray (sensor,)
        DA [%].

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, a threshold out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.da(E).values
    array([ 50., 100.])
    """
    E = thresholds.checked(illuminance, "illuminance")
    shares = 100.0 * thresholds.stamps_reached(E, threshold) / len(E)
    return by_sensor(illuminance, shares, "DA", "daylight autonomy")


def cda(illuminance: xr.DataArray, threshold: float = 300.0) -> xr.DataArray:
    """Continuous daylight autonomy: an hour with half of the threshold counts for one half [2].

    cDA_j = mean_t min(E_tj / E₀, 1).

    Parameters and errors are those of `da`; a threshold of 0 raises InputError.

    Returns
    -------
    DataArray (sensor,)
        cDA [%].

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.cda(E).values
    array([ 75., 100.])
    """
    E = thresholds.checked(illuminance, "illuminance")
    limit = _positive(threshold)
    total = np.zeros(E.shape[1])
    for block in thresholds.blocks(E):
        total += np.clip(block, 0, limit).sum(axis=0, dtype=float)
    shares = 100.0 * total / (limit * len(E))
    return by_sensor(illuminance, shares, "cDA", "continuous daylight autonomy")


def share_of_points(values: xr.DataArray, at_least: float) -> float:
    """Share of the points at which a metric of single points is at least a limit.

    With `da` and 50 % this is sDA; with `udi` of one range, the spatial UDI.

    Parameters
    ----------
    values : DataArray (sensor,)
        Metric of single points, in any unit.
    at_least : float
        Limit in the unit of `values`; a tie passes.

    Returns
    -------
    float
        Share of the points [%].

    Raises
    ------
    InputError
        Other dims, no sensor, values that are not finite.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.share_of_points(drcmitsuba.metrics.da(E), at_least=75.0)
    50.0
    """
    if not isinstance(values, xr.DataArray):
        raise InputError("values", "type", type(values).__name__, "give an xarray DataArray")
    if values.dims != ("sensor",) or values.size == 0 or not np.isfinite(values.values).all():
        got = f"dims {', '.join(map(str, values.dims)) or 'none'}, {values.size} values"
        raise InputError("values", "sensor", got, "give a finite value for each sensor")
    return thresholds.share(values.values >= at_least)


def smooth_da(illuminance: mi.TensorXf, threshold: float, *, sharpness: float) -> mi.TensorXf:
    """Twin of `da`: 100 · mean_t s(E_tj; E₀), tensor (sensor,) [%], from (time, sensor) [lx]."""
    stamps = smooth_step.stamps_reached(illuminance, threshold, sharpness)
    return 100 * stamps / illuminance.shape[0]


def smooth_cda(illuminance: mi.TensorXf, threshold: float) -> mi.TensorXf:
    """`cda` with its gradient, which needs no sharpness: tensor (sensor,) [%], from [lx]."""
    limit = _positive(threshold)
    credit = dr.clip(illuminance, 0, limit)
    return 100 * smooth_step.total(credit, axis=0) / (limit * illuminance.shape[0])


def by_sensor(
    illuminance: xr.DataArray, values: np.ndarray, name: str, long_name: str, units: str = "%"
) -> xr.DataArray:
    """Array (sensor,) with the sensors' coordinates of E."""
    at = {k: c for k, c in illuminance.coords.items() if c.dims == ("sensor",)}
    attributes = {"units": units, "long_name": long_name}
    return xr.DataArray(values, at, ("sensor",), name, attributes)


def _positive(threshold: float) -> float:
    limit = thresholds.not_negative("threshold", threshold)
    if limit == 0:
        raise InputError("metrics", "threshold", "0", "give an illuminance above 0")
    return limit
