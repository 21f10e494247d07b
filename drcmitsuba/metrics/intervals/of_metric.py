"""Interval of any metric of E, by draws from the replicates of E."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from drcmitsuba.metrics.intervals.autonomy import multipliers
from drcmitsuba.metrics.intervals.rules import DRAWS, TAIL
from drcmitsuba.runtime.errors import InputError

FEWEST = 40
"""Fewest draws: an end of an interval has one draw beyond it."""


def interval_of(
    metric: Callable[[xr.DataArray], float | xr.DataArray],
    replicates: xr.DataArray,
    draws: int = 200,
    seed: int = 0,
) -> xr.Dataset:
    """Value and 95 % interval of a metric of E.

    Each draw moves all of E together, E* = Ē + q Σ_r w_r (E_r − Ē) / √(n (n − 1)); the interval
    holds the percentiles of the draws and their mirror images about the value, as that of sDA does.

    Parameters
    ----------
    metric : callable
        Function of a DataArray (time, sensor) [lx], such as `metrics.cda`.
    replicates : DataArray (replicate, time, sensor)
        E of two or more independent replicates [lx], as `illuminance.replicates` and
        `ChosenFacade.illuminance` give it.
    draws : int
        Number of draws, 40 to 600; each computes the metric once.
    seed : int
        The same seed gives the same draws.

    Returns
    -------
    xr.Dataset
        `value`, `low` and `high`, with the dims and in the unit of the metric.

    Raises
    ------
    InputError
        A single replicate, or a number of draws out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba.metrics.intervals import interval_of
    >>> noise = np.random.default_rng(1).normal(500.0, 20.0, (6, 10, 3))
    >>> E = xr.DataArray(noise, dims=("replicate", "time", "sensor"))
    >>> found = interval_of(lambda E: E.mean(), E)
    >>> bool(found.low < found.value < found.high)
    True
    """
    n = replicates.sizes.get("replicate", 0)
    if n < 2:
        got = f"{n} replicates"
        raise InputError("replicates", "replicate", got, "give two or more replicates")
    if not FEWEST <= draws <= DRAWS:
        got = f"{draws}"
        raise InputError("interval", "draws", got, f"give a number from {FEWEST} to {DRAWS}")
    mean = replicates.mean("replicate")
    off = (replicates - mean).transpose("replicate", *mean.dims).values
    weights = multipliers(n, seed).replicates
    value = xr.DataArray(metric(mean))
    drawn = np.empty((draws, *value.shape))
    for i in range(draws):
        E = mean.values + np.tensordot(weights[:, i], off, 1)
        drawn[i] = metric(mean.copy(data=np.maximum(E, 0)))
    low = np.quantile(drawn, TAIL, axis=0, method="lower")
    high = np.quantile(drawn, 1 - TAIL, axis=0, method="higher")
    v = value.values
    ends = np.stack([v, low, high, 2 * v - low, 2 * v - high])
    parts = {"value": v, "low": ends.min(axis=0), "high": ends.max(axis=0)}
    return xr.Dataset({name: value.copy(data=part) for name, part in parts.items()})
