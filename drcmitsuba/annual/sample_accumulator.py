"""Coefficients to which samples, bins and suns are added."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr

from drcmitsuba.scene.surfaces import State
from drcmitsuba.schema import positions

_KINDS = {"bin": "replicates", "sun": "sun_straight"}
"""Dimensions of what is sampled, and what tells whether it was."""


class SampleAccumulator:
    """Coefficients of one state, averaged over the rounds that each entry was sampled in.

    Parameters
    ----------
    found : xr.Dataset
        From `simulation.transport`; it is not changed.
    """

    def __init__(self, found: xr.Dataset):
        self.found = found.copy(deep=True)
        self._rounds = {
            kind: np.ones((found.sizes["sensor"], found.sizes[kind]))
            for kind in _KINDS
            if kind in found.dims
        }

    def missing(self, labels: Iterable[str], kind: str) -> list[str]:
        """Labels that are not known."""
        known = set(map(str, self.found[kind].values))
        return [label for label in labels if label not in known]

    def extend(self, more: xr.Dataset) -> None:
        """Take bins or suns, of all sensors, that are not known so far."""
        for kind, rounds in self._rounds.items():
            new = self.missing(map(str, more[kind].values), kind)
            beside = [n for n, v in self.found.items() if kind not in v.dims]
            parts = [part.drop_vars(beside) for part in (self.found, more.sel({kind: new}))]
            others = [k for k in self._rounds if k != kind]
            parts = [part.drop_dims(others) for part in parts]
            joined = xr.concat(parts, kind, coords="minimal", compat="override")
            self.found = self.found.drop_dims(kind).merge(joined)
            self._rounds[kind] = np.pad(rounds, ((0, 0), (0, len(new))), constant_values=1)

    def add(self, more: xr.Dataset, sensors: np.ndarray) -> None:
        """Average one more round into the entries that it has."""
        for kind, rounds in self._rounds.items():
            bins = positions(more[kind].values, self.found[kind].values)
            where = np.ix_(sensors, bins)
            share = 1 / (rounds[where] + 1)
            for name, values in more.items():
                if kind not in values.dims:
                    continue
                of_all = [d for d in ("replicate", "channel") if d in values.dims]
                order = [*map(str, of_all), "sensor", kind]
                into, here = self.found[name].transpose(*order).values, (Ellipsis, *where)
                old, new = into[here], values.transpose(*order).values
                if str(name).endswith("_se"):
                    into[here] = np.hypot((1 - share) * old, share * new)
                else:
                    into[here] = old + share * (new - old)
            rounds[where] += 1


def by_state(found: xr.Dataset) -> dict[State, SampleAccumulator]:
    """Coefficients of each state, without the suns that it was not asked for.

    Parameters
    ----------
    found : xr.Dataset
        From `simulation.coefficients`: one state's suns that another has not are NaN there.
    """
    pools: dict[State, SampleAccumulator] = {}
    states: tuple[State, ...] = ("open", "shaded")
    for state in states[: found.sizes["state"]]:
        part = found.sel(state=state, drop=True)
        for kind, name in _KINDS.items():
            if kind in part.dims:
                others = [d for d in part[name].dims if d != kind]
                part = part.isel({kind: np.flatnonzero(part[name].notnull().all(others))})
        pools[state] = SampleAccumulator(part)
    return pools
