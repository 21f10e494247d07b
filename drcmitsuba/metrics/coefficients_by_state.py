"""Coefficients C of both states of the shade, each with the suns that it was simulated for.

In memory every state is a dataset of its own. On disk the states lie along one dimension `state`: a
sun that was simulated for the open state only is NaN in the shaded state, and reading the file
drops its label there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.surfaces import State

SAMPLED = {"bin": "replicates", "sun": "sun_straight"}
"""Sampled dimensions, each with a variable that is NaN for a label that was not simulated."""
NOT_SIMULATED = {
    "not_simulated": "a sun is NaN in state shaded where the shade stays open whenever it shines; "
    'shaded_state = "all" in [effects] simulates all suns'
}
"""Attribute of the file that explains its NaN."""


@dataclass(frozen=True)
class Coefficients:
    """Coefficients C of a case, ∂E/∂L [sr]."""

    open: xr.Dataset
    """C from `transport.coefficients.compute` for all suns. Its attributes hold for both states:
    the rule of the shade, the place of the suns, the origin of C."""
    shaded: xr.Dataset | None = None
    """C for the suns of all hours in which the shade may close; None where it never closes."""

    @classmethod
    def of(cls, joined: xr.Dataset) -> Coefficients:
        """Split the dataset of `joined`, or of `coefficients.zarr`, into its states.

        Without a state `open`, or with a single replicate, it raises InputError.
        """
        states = [str(state) for state in joined["state"].values]
        if "open" not in states or joined.sizes["replicate"] < 2:
            got = "no state open, or a single replicate"
            raise InputError("coefficients", "state, replicate", got, "compute them anew")
        shaded = _simulated(joined, "shaded") if "shaded" in states else None
        return cls(_simulated(joined, "open"), shaded)

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of both states."""
        return self.open.attrs

    @property
    def states(self) -> dict[State, xr.Dataset]:
        """Coefficients by state, the open one first."""
        if self.shaded is None:
            return {"open": self.open}
        return {"open": self.open, "shaded": self.shaded}

    def assign_attrs(self, **attributes: Any) -> Coefficients:
        """Coefficients with further attributes."""
        return replace(self, open=self.open.assign_attrs(attributes))

    def map(self, function: Callable[[xr.DataArray], xr.DataArray]) -> Coefficients:
        """Apply a function to all variables of both states."""
        return Coefficients(*(data.map(function) for data in self.states.values()))

    def joined(self) -> xr.Dataset:
        """Both states as on disk, dims (state, replicate, sensor, bin)."""
        return xr.concat(self.parts(), "state", coords="minimal", compat="override", join="exact")

    def parts(self) -> Iterator[xr.Dataset]:
        """Yield the parts of `joined`, one state each: writing them needs no copy of both."""
        labels = {name: self.open[name] for name in SAMPLED if name in self.open.coords}
        for state, data in self.states.items():
            part = data.reindex(labels).expand_dims(state=np.array([state], dtype=object))
            yield schema.describe(part.assign_attrs(self.attrs | NOT_SIMULATED))


def _simulated(joined: xr.Dataset, state: str) -> xr.Dataset:
    """C of one state, with the labels that were simulated for it."""
    data = joined.sel(state=state, drop=True)
    for dim, name in SAMPLED.items():
        if dim in data.dims:
            others = [d for d in data[name].dims if d != dim]
            data = data.isel({dim: np.flatnonzero(data[name].notnull().any(others))})
    return data
