"""Coefficients of one state to which samples, bins and suns are added."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr

from drcmitsuba.metrics.coefficients_by_state import SAMPLED
from drcmitsuba.schema import positions


class SampleAccumulator:
    """Coefficients of one state, averaged over the rounds in which each entry was sampled.

    Parameters
    ----------
    coefficients : xr.Dataset
        C of the first round from `simulation.transport` [sr]; it is copied, not changed.
    """

    def __init__(self, coefficients: xr.Dataset):
        self.coefficients = coefficients.copy(deep=True)
        self._rounds = {
            dim: np.ones((coefficients.sizes["sensor"], coefficients.sizes[dim]))
            for dim in SAMPLED
            if dim in coefficients.dims
        }

    def missing(self, labels: Iterable[str], dim: str) -> list[str]:
        """Labels of a dim, `bin` or `sun`, that the coefficients lack."""
        known = set(map(str, self.coefficients[dim].values))
        return [label for label in labels if label not in known]

    def extend(self, more: xr.Dataset) -> None:
        """Add the bins and suns of `more`, C for all sensors [sr], that the coefficients lack."""
        for dim, rounds in self._rounds.items():
            new = self.missing(map(str, more[dim].values), dim)
            without = [name for name, v in self.coefficients.items() if dim not in v.dims]
            others = [other for other in self._rounds if other != dim]
            parts = [
                data.drop_vars(without).drop_dims(others)
                for data in (self.coefficients, more.sel({dim: new}))
            ]
            joined = xr.concat(parts, dim, coords="minimal", compat="override")
            self.coefficients = self.coefficients.drop_dims(dim).merge(joined)
            self._rounds[dim] = np.pad(rounds, ((0, 0), (0, len(new))), constant_values=1)

    def add(self, more: xr.Dataset, sensors: np.ndarray) -> None:
        """Average one more round of C [sr], of some sensors and known bins, into its entries.

        `sensors` (n,) are the indices of these sensors among the sensors of the coefficients.
        """
        for dim, rounds in self._rounds.items():
            bins = positions(more[dim].values, self.coefficients[dim].values)
            where = np.ix_(sensors, bins)
            share = 1 / (rounds[where] + 1)
            for name, values in more.items():
                if dim not in values.dims or name == "pane_group":
                    continue
                outer = [d for d in ("replicate", "channel") if d in values.dims]
                order = [*map(str, outer), "sensor", dim]
                into, here = self.coefficients[name].transpose(*order).values, (Ellipsis, *where)
                old, new = into[here], values.transpose(*order).values
                if str(name).endswith("_se"):
                    into[here] = np.hypot((1 - share) * old, share * new)
                else:
                    into[here] = old + share * (new - old)
            rounds[where] += 1
