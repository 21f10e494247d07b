"""Daylight autonomy, of a year and by month: sDA, msDA, smooth twins; [1], [2] in `metrics`."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.metrics import smooth_step, thresholds


def autonomy_stamps(fraction: float, stamps: int) -> int:
    """Time stamps, out of `stamps`, at which a sensor needs enough daylight: ⌈τ·t⌉."""
    return math.ceil(thresholds.exact_fraction("fraction", fraction) * stamps)


def sda(illuminance: xr.DataArray, threshold: float = 300.0, fraction: float = 0.5) -> float:
    """Spatial daylight autonomy, the share of sensors with enough daylight for enough hours.

    sDA = Σ_j S(j) / N with S(j) = 1 where s_j ≥ τ·t_y [2], equation 1.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance with the shade applied, at the hours of the evaluation period [lx].
    threshold : float
        Illuminance that counts as reached [lx].
    fraction : float
        τ, fraction of the time stamps at which it has to be reached, 0 to 1.

    Returns
    -------
    float
        sDA [%].

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
    >>> drcmitsuba.metrics.sda(E, threshold=300.0, fraction=0.5)
    100.0
    >>> drcmitsuba.metrics.sda(E, threshold=300.0, fraction=0.75)
    50.0
    """
    E = thresholds.checked(illuminance, "illuminance")
    stamps = thresholds.stamps_reached(E, threshold)
    return thresholds.share(stamps >= autonomy_stamps(fraction, len(E)))


def msda(
    illuminance: xr.DataArray, threshold: float = 300.0, fraction: float = 0.5
) -> xr.DataArray:
    """Monthly spatial daylight autonomy: `sda` with τ relative to the stamps of each month.

    msDA_m = Σ_j S(j, m) / N with S(j, m) = 1 where s_{j,m} ≥ τ·t_m [2], equation 3.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        As for `sda`. The month of a stamp is that of the coordinate `clock` where there is one,
        else that of `time`.
    threshold, fraction : float
        As for `sda`.

    Returns
    -------
    DataArray (month,)
        msDA [%] of the months 1 to 12, NaN for a month without time stamps.

    Raises
    ------
    InputError
        As `sda`; stamps that are not dates.

    Examples
    --------
    >>> import drcmitsuba
    >>> import pandas as pd
    >>> import xarray as xr
    >>> time = pd.to_datetime(["2015-01-05 12:00", "2015-01-05 13:00", "2015-02-05 12:00"])
    >>> E = xr.DataArray([[100.0], [400.0], [200.0]], {"time": time}, ("time", "sensor"))
    >>> drcmitsuba.metrics.msda(E, threshold=300.0).sel(month=[1, 2]).values
    array([100.,   0.])
    """
    shares = thresholds.monthly_share(
        illuminance, "illuminance", threshold, lambda t_m, t_y: autonomy_stamps(fraction, t_m)
    )
    shares.attrs["long_name"] = "monthly spatial daylight autonomy"
    return shares.rename("msDA")


def smooth_sda(
    illuminance: mi.TensorXf, threshold: float = 300.0, fraction: float = 0.5, *, sharpness: float
) -> mi.Float:
    """Twin of `sda`: 100 · mean_j s(Σ_t s(E_tj; threshold); n − ½).

    Parameters
    ----------
    illuminance : mi.TensorXf (time, sensor)
        Illuminance with the shade applied, see `metrics.smooth.applied` [lx].
    threshold, fraction, sharpness : float
        As for `sda`; n is the count of time stamps by `autonomy_stamps`; k of both steps.

    Returns
    -------
    mi.Float
        Smooth sDA [%].

    Raises
    ------
    InputError
        No time stamp or sensor, a threshold or a sharpness out of range.
    """
    stamps = smooth_step.stamps_reached(illuminance, threshold, sharpness)
    return smooth_step.share(stamps, autonomy_stamps(fraction, illuminance.shape[0]), sharpness)


def smooth_msda(
    illuminance: mi.TensorXf,
    months: np.ndarray,
    threshold: float = 300.0,
    fraction: float = 0.5,
    *,
    sharpness: float,
) -> mi.TensorXf:
    """Twin of `msda`, of the months that have time stamps; arguments as for `smooth_sda`, and:

    Parameters
    ----------
    months : np.ndarray, shape (time,)
        Month of each time stamp, 1 to 12, in any order.

    Returns
    -------
    mi.TensorXf (present,)
        Smooth msDA [%] of the months in `np.unique(months)`: none is without hours, so nothing is
        NaN.

    Raises
    ------
    InputError
        As `smooth_sda`; not one month for each time stamp.
    """
    return smooth_step.monthly_share(
        illuminance, months, threshold, lambda t_m, t_y: autonomy_stamps(fraction, t_m), sharpness
    )
