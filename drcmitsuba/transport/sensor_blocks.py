"""Coefficients of all sensors from those of blocks of sensors."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr


def joined(blocks: Iterable[tuple[slice, xr.Dataset]], sensors: int) -> xr.Dataset:
    """Coefficients of all sensors, filled in block by block: no copy of all of them is made."""
    out: xr.Dataset | None = None
    for here, block in blocks:
        if block.sizes["sensor"] == sensors:
            return block
        if out is None:
            out = _of_sensors(block, sensors)
        for name, part in block.variables.items():
            if "sensor" in part.dims:
                at = tuple(here if dim == "sensor" else slice(None) for dim in part.dims)
                out[name].values[at] = part.values
    assert out is not None
    return out


def _of_sensors(block: xr.Dataset, sensors: int) -> xr.Dataset:
    """Dataset like a block with another number of sensors, of which nothing is known yet.

    Memory that is written for the first time in one go is there sooner than block by block.
    """

    def grown(variable: xr.Variable) -> xr.Variable:
        sizes = {**variable.sizes, "sensor": sensors}
        values = np.full([sizes[dim] for dim in variable.dims], np.nan, variable.dtype)
        return xr.Variable(variable.dims, values, variable.attrs)

    variables = {
        name: grown(part) if "sensor" in part.dims else part
        for name, part in block.variables.items()
    }
    out = xr.Dataset({name: variables[name] for name in block.data_vars}, attrs=block.attrs)
    return out.assign_coords({name: variables[name] for name in block.coords})
