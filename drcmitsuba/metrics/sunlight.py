"""Sunlight exposure, of a year and by month: ASE, MSE, smooth twins; [1], [2] in `metrics`."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.metrics import smooth_step, thresholds
from drcmitsuba.runtime.errors import InputError


def exposure_stamps(hours: float, step_hours: float, t_m: int = 1, t_y: int = 1) -> int:
    """Fewest time stamps in the sun at which a sensor counts (a tie does): ⌈hours/step · t_m/t_y⌉.

    `hours` of exposure in the whole period and the `step_hours` of a time stamp are in h; the month
    has t_m of t_y time stamps. Hours below 0 or infinite, and a step of 0, raise InputError.
    """
    step = thresholds.exact(thresholds.not_negative("step_hours", step_hours))
    if step == 0:
        raise InputError("metrics", "step_hours", f"{step_hours}", "give hours above 0")
    return math.ceil(thresholds.exact(thresholds.not_negative("hours", hours)) / step * t_m / t_y)


def ase(
    direct: xr.DataArray, threshold: float = 1000.0, hours: float = 250.0, step_hours: float = 1.0
) -> float:
    """Annual sunlight exposure, the share of sensors in direct sun for too many hours.

    ASE = Σ_j A(j) / N with A(j) = 1 where a_j ≥ T_y [2], equation 2.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        Illuminance by direct sun without shade, at the hours of the evaluation period [lx].
    threshold : float
        Illuminance that counts as exposed [lx].
    hours : float
        T_y, hours of exposure at which a sensor counts [h]: 250 h of a whole year. They are taken
        as they come, also where `direct` covers part of a year.
    step_hours : float
        Length of the interval that one time stamp stands for [h].

    Returns
    -------
    float
        ASE [%].

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, a threshold out of range.

    Examples
    --------
    >>> import drcmitsuba
    >>> import xarray as xr
    >>> values = [[0.0, 1000.0], [0.0, 2500.0], [1200.0, 900.0]]
    >>> direct = xr.DataArray(values, dims=("time", "sensor"))
    >>> drcmitsuba.metrics.ase(direct, threshold=1000.0, hours=2)
    50.0
    """
    a_j = thresholds.stamps_reached(thresholds.checked(direct, "direct"), threshold)
    return thresholds.share(a_j >= exposure_stamps(hours, step_hours))


def mse(
    direct: xr.DataArray, threshold: float = 1000.0, hours: float = 250.0, step_hours: float = 1.0
) -> xr.DataArray:
    """Monthly sunlight exposure: `ase` with its hours relative to the stamps of each month.

    MSE_m = Σ_j A(j, m) / N with A(j, m) = 1 where a_{j,m} ≥ T_m [2], equation 4. The paper gives
    no number for T_m but says that it is relative to the month's time stamps: T_m = hours·t_m/t_y.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        As for `ase`. The month of a stamp is that of the coordinate `clock` where there is one,
        else that of `time`.
    threshold, hours, step_hours : float
        As for `ase`; `hours` are those of the whole of `direct`.

    Returns
    -------
    DataArray (month,)
        MSE [%] of the months 1 to 12, NaN for a month without time stamps.

    Raises
    ------
    InputError
        As `ase`; stamps that are not dates.

    Examples
    --------
    >>> import drcmitsuba
    >>> import pandas as pd
    >>> import xarray as xr
    >>> time = pd.to_datetime(["2015-01-05 12:00", "2015-01-05 13:00", "2015-02-05 12:00"])
    >>> direct = xr.DataArray([[0.0], [2000.0], [0.0]], {"time": time}, ("time", "sensor"))
    >>> drcmitsuba.metrics.mse(direct, hours=1.0).sel(month=[1, 2]).values
    array([100.,   0.])
    """
    shares = thresholds.monthly_share(
        direct, "direct", threshold, lambda t_m, t_y: exposure_stamps(hours, step_hours, t_m, t_y)
    )
    shares.attrs["long_name"] = "monthly sunlight exposure"
    return shares.rename("MSE")


def smooth_ase(
    direct: mi.TensorXf,
    threshold: float = 1000.0,
    hours: float = 250.0,
    step_hours: float = 1.0,
    *,
    sharpness: float,
) -> mi.Float:
    """Twin of `ase`: 100 · mean_j s(Σ_t s(E_tj; threshold); n − ½).

    Parameters
    ----------
    direct : mi.TensorXf (time, sensor)
        Illuminance by direct sun without shade [lx].
    threshold, hours, step_hours, sharpness : float
        As for `ase`; n is the count of time stamps by `exposure_stamps`; k of both steps.

    Returns
    -------
    mi.Float
        Smooth ASE [%].

    Raises
    ------
    InputError
        No time stamp or sensor, a threshold or a sharpness out of range.
    """
    stamps = smooth_step.stamps_reached(direct, threshold, sharpness)
    return smooth_step.share(stamps, exposure_stamps(hours, step_hours), sharpness)


def smooth_mse(
    direct: mi.TensorXf,
    months: np.ndarray,
    threshold: float = 1000.0,
    hours: float = 250.0,
    step_hours: float = 1.0,
    *,
    sharpness: float,
) -> mi.TensorXf:
    """Twin of `mse`, of the months that have time stamps; arguments as for `smooth_ase`, and:

    Parameters
    ----------
    months : np.ndarray, shape (time,)
        Month of each time stamp, 1 to 12, in any order.

    Returns
    -------
    mi.TensorXf (present,)
        Smooth MSE [%] of the months in `np.unique(months)`.

    Raises
    ------
    InputError
        As `smooth_ase`; not one month for each time stamp.
    """
    return smooth_step.monthly_share(
        direct, months, threshold,
        lambda t_m, t_y: exposure_stamps(hours, step_hours, t_m, t_y), sharpness,
    )  # fmt: skip
