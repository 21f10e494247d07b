"""Coefficients C of the states of a façade, each with the suns that it was simulated for.

In memory every state is a dataset of its own. On disk the states lie along one dimension `state`: a
sun that was simulated for some states only is NaN in the others, and reading the file drops its
label there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, cast

import numpy as np
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.case.groups import OPEN, VARYING, State
from drcmitsuba.runtime.aligned_arrays import aligned
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.zarr_folder import widened

SAMPLED = {"bin": "replicates", "sun": "sun_straight"}
"""Sampled dimensions, each with a variable that is NaN for a label that was not simulated."""
NOT_SIMULATED = {
    "not_simulated": "a sun is NaN in a state that the façade does not take when it shines; "
    'shaded_state = "all" in [effects] simulates all suns in the state shaded'
}
"""Attribute of the file that explains its NaN."""


@dataclass(frozen=True)
class Coefficients:
    """Coefficients C of a case, ∂E/∂L [sr]."""

    open: xr.Dataset
    """C from `transport.coefficients.compute` for all suns. Its attributes hold for all states: the
    groups of panes and their rule, the place of the suns, the origin of C."""
    others: Mapping[State, xr.Dataset] = field(default_factory=dict)
    """C of every other state for the suns of all hours in which the façade may take it; of the
    state `VARYING`, which is not on disk, `illuminance` (replicate, time, sensor) [lx]."""

    @classmethod
    def of(cls, joined: xr.Dataset) -> Coefficients:
        """Split the dataset of `joined`, or of `coefficients.zarr`, into its states.

        Without replicates, a state `open`, or with a single replicate, it raises InputError.
        """
        known = {*joined.dims, *joined.data_vars} if isinstance(joined, xr.Dataset) else set()
        if not known >= {"state", "replicate", "replicates"}:
            got = "what has no state, replicate or replicates"
            raise InputError("coefficients", "state, replicate", got, "give those of an evaluation")
        states = [str(state) for state in joined["state"].values]
        if OPEN not in states or joined.sizes["replicate"] < 2:
            got = "no state open, or a single replicate"
            raise InputError("coefficients", "state, replicate", got, "compute them anew")
        others = {state: _simulated(joined, state) for state in states if state != OPEN}
        return cls(_simulated(joined, OPEN), others)

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of all states."""
        return self.open.attrs

    @property
    def states(self) -> dict[State, xr.Dataset]:
        """Coefficients by state, the open one first."""
        return {OPEN: self.open, **self.others}

    def assign_attrs(self, **attributes: Any) -> Coefficients:
        """Coefficients with further attributes."""
        return Coefficients(self.open.assign_attrs(attributes), self.others)

    def by_luminance(self) -> Coefficients:
        """Coefficients of all states by luminance, without colour channels."""
        others = {state: schema.by_luminance(data) for state, data in self.others.items()}
        return Coefficients(schema.by_luminance(self.open), others)

    def joined(self) -> xr.Dataset:
        """All states as on disk, dims (state, replicate, sensor, bin)."""
        labels = {name: self.open[name].values for name in SAMPLED if name in self.open.coords}
        parts = []
        for part in self.parts():
            for dim, of_all in labels.items():
                part = _with_labels(part, dim, of_all)
            parts.append(part)
        return xr.concat(parts, "state", coords="minimal", compat="override", join="exact")

    def parts(self) -> Iterator[xr.Dataset]:
        """Yield the parts of `joined`, one state each; the open one is first and has all labels."""
        for state, data in self.states.items():
            if state == VARYING:
                continue
            if "pane_group" in self.open and "pane_group" not in data:
                data = data.assign(pane_group=xr.full_like(self.open["pane_group"], np.nan))
            part = data.expand_dims(state=np.array([state], dtype=object))
            yield schema.describe(part.assign_attrs(self.attrs | NOT_SIMULATED))


class LaterCoefficients(Coefficients):
    """Coefficients that are made when they are first asked for.

    Parameters
    ----------
    attributes : mapping
        Attributes of all states.
    make : callable
        Function that makes the coefficients, which have the same attributes.
    """

    def __init__(self, attributes: Mapping[str, Any], make: Callable[[], Coefficients]) -> None:
        vars(self).update(attributes=dict(attributes), make=make)

    @cached_property
    def _made(self) -> Coefficients:
        return cast(Coefficients, vars(self)["make"]())

    @property
    def open(self) -> xr.Dataset:
        """C of the open state."""
        return self._made.open

    @property
    def others(self) -> Mapping[State, xr.Dataset]:
        """C of every other state."""
        return self._made.others

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of all states, which are known before."""
        return cast(dict[str, Any], vars(self)["attributes"])

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.attrs.get('case')!r}>"


def _with_labels(data: xr.Dataset, dim: str, labels: np.ndarray) -> xr.Dataset:
    """Arrays at further labels of their last dim, NaN where they have none; `reindex` is slow."""
    own = data[dim].values
    if np.array_equal(own, labels):
        return data
    at, wider = schema.positions(own, labels), {}
    for name, array in data.data_vars.items():
        if dim in array.dims:
            assert array.dims[-1] == dim
            wider[name] = (array.dims, widened(array.values, at, len(labels)), array.attrs)
    return data.drop_dims(dim).assign(wider).assign_coords({dim: labels})[list(data.data_vars)]


def _simulated(joined: xr.Dataset, state: str) -> xr.Dataset:
    """C of one state, with the labels that were simulated for it.

    The device takes the replicates as they lie: each sum over a file's would copy them.
    """
    data = joined.sel(state=state, drop=True)
    for dim, name in SAMPLED.items():
        if dim in data.dims:
            others = [d for d in data[name].dims if d != dim]
            known = data[name].notnull().any(others).values
            if not known.all():  # a selection copies C
                data = data.isel({dim: np.flatnonzero(known)})
    own = data["replicates"].variable
    data = data.assign(replicates=own.copy(deep=False, data=aligned(own.values)))
    return data.drop_vars("pane_group", errors="ignore") if state != OPEN else data
