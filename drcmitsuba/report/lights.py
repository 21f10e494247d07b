"""Light of chosen points by where it comes from, as `annual.lights` writes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.metrics.stored_arrays import loaded, open_dataset
from drcmitsuba.runtime.errors import InputError

MOST_STATES = 12
"""Largest number of states of the façade, those of the most hours."""
REMEDY = "run drcmitsuba lights again"


def read_lights(
    path: Path, E: xr.Dataset, dims: Mapping[str, tuple[str, ...]], most: Mapping[str, int],
    *coordinates: str,
) -> xr.Dataset:  # fmt: skip
    """Read arrays by their dims; InputError where they are damaged, too large, or not E's."""
    data = open_dataset(path, *dims, "window", "source", "sensor", *coordinates)
    for name, own in dims.items():
        if data[name].dims != own or data[name].dtype.kind != "f":
            raise InputError(path, name, f"dims {data[name].dims}", REMEDY)
    if large := [d for d, n in most.items() if not 0 < data.sizes[d] <= n]:
        raise InputError(path, large[0], f"{data.sizes[large[0]]} entries", REMEDY)
    data = loaded(path, data[[*dims]])
    if data.attrs.get("settings") != E.attrs.get("settings"):
        got = "it is of another evaluation than illuminance.nc"
        raise InputError(path, "settings", got, REMEDY)
    fits = {*data["source"].values} == {"ground", "sky", "sun"}
    fits &= data.attrs.get("by_evaluation") in (0, 1)
    if not fits or not all(np.isfinite(data[name].values).all() for name in dims):
        raise InputError(path, "exposure", "it holds no light of sensors", REMEDY)
    return data


def hours_left_out(lights: xr.Dataset) -> float:
    """Time in which the façade is in states that were not traced, since there are many [h]."""
    return float(lights.attrs.get("hours_left_out", 0))


def of_period(lights: xr.Dataset) -> xr.DataArray:
    """Light exposure of the period (window, source, bounces, …) [lx h].

    The states of the façade count by their hours in an evaluation. Without one each state would
    count all the time: only the first one is taken.
    """
    light = lights["exposure"]
    return light.sum("state") if lights.attrs["by_evaluation"] else light.isel(state=0, drop=True)
