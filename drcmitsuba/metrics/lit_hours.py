"""Hours in which a room is lit: by the mean of its points, and at its worst-lit point.

References
----------
.. [1] BRE Global, "BREEAM UK New Construction", Hea 01 Visual comfort: average and minimum point
   daylight illuminance.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.metrics import smooth_step, thresholds


def mean_hours(
    illuminance: xr.DataArray, threshold: float = 300.0, step_hours: float = 1.0
) -> float:
    """Hours in which the mean illuminance of all points reaches a threshold [1].

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance of one room [lx].
    threshold : float
        Mean illuminance that counts as reached [lx].
    step_hours : float
        Length of the interval that one time stamp stands for [h].

    Returns
    -------
    float
        Hours [h].

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
    >>> drcmitsuba.metrics.mean_hours(E, threshold=400.0)
    3.0
    """
    E = thresholds.checked(illuminance, "illuminance")
    limit = thresholds.not_negative("threshold", threshold)
    step = thresholds.not_negative("step_hours", step_hours)
    return int(np.count_nonzero(E.mean(axis=1, dtype=float) >= limit)) * step


def worst_point_hours(
    illuminance: xr.DataArray, threshold: float = 90.0, step_hours: float = 1.0
) -> float:
    """Hours in which the point that is lit for the fewest hours reaches a threshold [1].

    Parameters and errors are those of `mean_hours`.

    Returns
    -------
    float
        min_j #{t : E_tj ≥ threshold} · step_hours [h].

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[100.0, 400.0], [300.0, 500.0], [350.0, 600.0], [200.0, 700.0]]
    >>> E = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.worst_point_hours(E, threshold=300.0)
    2.0
    """
    E = thresholds.checked(illuminance, "illuminance")
    step = thresholds.not_negative("step_hours", step_hours)
    return int(thresholds.stamps_reached(E, threshold).min()) * step


def smooth_mean_hours(
    illuminance: mi.TensorXf, threshold: float = 300.0, step_hours: float = 1.0, *, sharpness: float
) -> mi.Float:
    """Twin of `mean_hours`: step · Σ_t s(mean_j E_tj; threshold) [h], from (time, sensor) [lx]."""
    mean = dr.mean(illuminance, axis=1)
    series = dr.reshape(mi.TensorXf, mean, (illuminance.shape[0], 1))
    return step_hours * smooth_step.stamps_reached(series, threshold, sharpness).array


def smooth_worst_point_hours(
    illuminance: mi.TensorXf, threshold: float = 90.0, step_hours: float = 1.0, *, sharpness: float
) -> mi.Float:
    """Twin of `worst_point_hours`: step · min_j Σ_t s(E_tj; threshold) [h]; the worst point's.

    The minimum keeps its kink: the gradient is that of the worst-lit point.
    """
    stamps = smooth_step.stamps_reached(illuminance, threshold, sharpness)
    return step_hours * dr.min(stamps.array)
