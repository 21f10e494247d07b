r"""Illuminance of few façades in a year, from the coefficients that each of them has.

.. math:: E = L\, C(w)

Light by element is added up for the bins that are lit, the luminances L come after. Nothing is kept
of a year by element, as `KnownYear` keeps it for the many façades of a search.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drcmitsuba.runtime.pieces import pieces
from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight
from drcmitsuba.transport.elements.weights import MOST_ROWS, different_rows

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True, eq=False)
class YearByBin:
    """Luminances of a year, and the light by element that they meet."""

    light: AnyLight
    L: csr_matrix
    """Luminances of all bins [cd/m²], shape (time, bin)."""

    def illuminance(self, shares: np.ndarray, hours: np.ndarray | None = None) -> np.ndarray:
        """Illuminance of a façade (replicate, time, sensor) [lx]; as `KnownYear.illuminance`."""
        light, hours = self.light, np.arange(self.L.shape[0]) if hours is None else hours
        E = np.empty((light.replicates, len(hours), len(light.positions)), np.float32)
        rows, of_hour = different_rows(shares, len(hours))
        if len(rows) > MOST_ROWS:
            for r, each in enumerate(light.illuminance(self.L[hours], rows[of_hour])):
                E[r] = each
            return E
        for k, row in enumerate(rows):
            self._of_row(E, row, np.flatnonzero(of_hour == k), hours)
        return E

    def _of_row(self, E: np.ndarray, row: np.ndarray, at: np.ndarray, hours: np.ndarray) -> None:
        """Fill in E at the places `at` among the `hours`, in which one row of shares holds."""
        L, sky = self.L[hours[at]], self.light.sky_bins
        suns = sky + np.flatnonzero(L[:, sky:].getnnz(axis=0))
        C = self.light.standing(row).total(row, np.concatenate([np.arange(sky), suns]))
        by_sky, by_suns = L[:, :sky].toarray(), L[:, suns]

        def of_replicate(r: int) -> None:
            for here in pieces(len(at), E.shape[2]):
                E[r, at[here]] = by_sky[here] @ C[r, :sky] + by_suns[here] @ C[r, sky:]

        in_threads(of_replicate, range(len(E)))
