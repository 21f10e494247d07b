"""Arrays that users give with labels of their own, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from drcmitsuba.runtime.errors import InputError


def in_order(given: Any, labels: Mapping[str, Sequence | np.ndarray], source: str) -> np.ndarray:
    """Values of an array whose dims, and the labels along them, are put in a given order.

    Parameters
    ----------
    given : array_like, xr.DataArray, or frame or series of pandas
        Array; one without labels is taken as it is, and so is a dim without labels, or whose labels
        are 0, 1, … in this order.
    labels : mapping of str to sequence
        Labels by dim, the dims in their order; further dims come after these.
    source : str
        Name of the array in error messages.

    Raises
    ------
    InputError
        The array has a label twice, or lacks one that is asked for.
    """
    if isinstance(given, pd.DataFrame | pd.Series):
        dims = [*labels, *(f"axis {i}" for i in range(given.ndim))]
        given = xr.DataArray(given.values, given.axes, dims[: given.ndim])
    if not isinstance(given, xr.DataArray):
        return np.asarray(given)
    given = given.transpose(*(dim for dim in labels if dim in given.dims), ...)
    for dim, wanted in labels.items():
        if dim in given.dims and dim in given.coords:
            index = pd.Index(given[dim].values)
            if index.equals(pd.RangeIndex(len(wanted))):  # numbers in place of names
                continue
            if not index.is_unique:
                got = f"{index[index.duplicated()][0]} comes twice"
                raise InputError(source, dim, got, "name each once")
            at = index.get_indexer(pd.Index(wanted))
            if (at < 0).any():
                got = f"none for {np.asarray(wanted)[np.argmax(at < 0)]}"
                raise InputError(source, dim, got, "give values for each")
            given = given.isel({dim: at})
    return np.asarray(given.values)
