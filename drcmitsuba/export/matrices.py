"""C and L of a result as two matrices whose product is E, the shade applied.

Every state of the façade has bins of its own: the state of a bin stands in `bins.txt`, and L of a
time stamp is 0 in the bins of the other states. One product so gives E = C·L as it is in
`illuminance.nc`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.sparse import csr_matrix, diags, hstack

from drcmitsuba.case.groups import VARYING
from drcmitsuba.export.mtx import write_mtx
from drcmitsuba.metrics.bin_luminances import factors
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.illuminance import check_suns, direct_sun
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError


@dataclass(frozen=True)
class Matrices:
    """Factors of E = C·L."""

    C: np.ndarray
    """Coefficients [sr], shape (sensor, bin), or (sensor, bin, channel) of a coloured case."""
    L: csr_matrix
    """Luminances [cd/m²], shape (bin, time)."""
    bins: tuple[str, ...]
    """State of the façade and label of every bin."""


def matrices(coefficients: Coefficients, sky: xr.Dataset) -> Matrices:
    """Coefficients and luminances of all states of the façade, side by side.

    Parameters
    ----------
    coefficients : Coefficients
    sky : xr.Dataset
        `Daylight.sky`, or from `sky.luminances.from_luminances`.

    Returns
    -------
    Matrices

    Raises
    ------
    InputError
        A bin has no coefficients, or the suns of C stand elsewhere than those of the sky.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.export.matrices import matrices
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> made = matrices(result.by_state, result.daylight.sky)
    >>> made.C.shape[1] == len(made.bins)
    True
    """
    check_suns(coefficients.attrs, sky)
    taken = FacadeStates.of(coefficients.attrs, direct_sun(coefficients, sky))
    C, L, bins = [], [], []
    for i, state in enumerate(taken.states):
        here = taken.index == i
        if not here.any():
            continue
        if state not in coefficients.states:
            got = f"no state {state}; {int(here.sum())} time stamps take it"
            remedy = "compute the coefficients of this state, or evaluate the case"
            if state == VARYING:
                got = (
                    "E of this year is a sum over groups of panes, of which no state has its own C"
                )
                remedy = "export --ill, or a case whose groups take few states"
            raise InputError("coefficients", "state", got, remedy)
        data = coefficients.states[state]
        at = np.flatnonzero(here)
        select = diags(here.astype(np.float32)).tocsr()[:, at]  # (time, time of this state)
        for values, light in factors(data, sky.isel(time=at)):
            C.append(_finite(values).transpose("sensor", "bin", ...).values)
            L.append(select @ light)
            bins += [f"{state} {label}" for label in values["bin"].values]
    return Matrices(np.concatenate(C, axis=1), hstack(L).T.tocsr(), tuple(bins))


def _finite(values: xr.DataArray) -> xr.DataArray:
    """Refuse coefficients that are NaN: 0 · NaN is NaN at all time stamps."""
    if not np.isfinite(values.values).all():
        remedy = "compute them anew"
        raise InputError("coefficients", "replicates", "some numbers are missing", remedy)
    return values


def save_matrices(coefficients: Coefficients, sky: xr.Dataset, folder: str | Path) -> Matrices:
    """Write `matrices` to a new folder: `C.mtx`, `L.mtx` and what their rows and columns are."""
    made = matrices(coefficients, sky)
    at = np.stack([coefficients.open[axis].values for axis in "xyz"], axis=-1)
    times = np.datetime_as_string(sky["time"].values, unit="m")
    with storage.new_folder(folder) as files:
        write_mtx(files / "C.mtx", made.C)
        write_mtx(files / "L.mtx", made.L)
        storage.save_lines((f"{label}\n" for label in made.bins), files / "bins.txt")
        storage.save_lines((f"{time}\n" for time in times), files / "times.txt")
        points = (" ".join(f"{v:.9g}" for v in point) + "\n" for point in at)
        storage.save_lines(points, files / "sensors.txt")
    return made
