"""Light of chosen points by where it comes from, as `annual.lights` writes it."""

from __future__ import annotations

import xarray as xr


def of_period(lights: xr.Dataset) -> xr.DataArray:
    """Light exposure of the period (window, source, bounces, …) [lx h].

    The states of the façade count by their hours in an evaluation. Without one each state would
    count all the time: only the first one is taken.
    """
    light = lights["exposure"]
    return light.sum("state") if lights.attrs["by_evaluation"] else light.isel(state=0, drop=True)
