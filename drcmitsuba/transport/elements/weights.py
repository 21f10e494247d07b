"""Weights of elements: shares that fills take of their openings, and the luminances of the sky."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

HOURS = 64
"""Number of time stamps whose light is summed at once."""
BESIDES = -1
"""In place of an element: light that passes no opening."""
MOST_ROWS = 16
"""Number of different shares of a year up to which the paths G_m(w) become a matrix for each."""


def chosen(first: np.ndarray, indices: np.ndarray, elements: int) -> np.ndarray:
    """Shares of openings that one fill takes whole, (…, element), 0 or 1.

    Parameters
    ----------
    first : np.ndarray of int, shape (opening,)
        First element of every opening.
    indices : np.ndarray of int, shape (…, opening)
        Fill of every opening, an index.
    elements : int
        Number of elements.
    """
    shares = np.zeros((*indices.shape[:-1], elements), np.float32)
    np.put_along_axis(shares, first + indices, 1, axis=-1)
    return shares


def different_rows(shares: np.ndarray, hours: int) -> tuple[np.ndarray, np.ndarray]:
    """Different shares (row, element) of a year, and the row of every hour, int, shape (time,).

    `shares` are those of every time stamp (time, element), or of all of them (element,).
    """
    if shares.ndim == 1:
        return shares[None], np.zeros(hours, int)
    rows, of_hour = np.unique(shares, axis=0, return_inverse=True)
    return rows, of_hour.reshape(-1)


@dataclass(frozen=True, eq=False)
class Year:
    """Luminances and shares of elements at every time stamp."""

    sky: np.ndarray
    """Luminances of ground and sky patches [cd/m²], shape (time, sky bin)."""
    suns: csr_matrix
    """Luminances of the suns [cd/m²], shape (time, sun)."""
    shares: np.ndarray
    """Share of its opening that every element takes [–], shape (time, element)."""

    @classmethod
    def of(cls, L: csr_matrix, shares: np.ndarray, sky_bins: int) -> Year:
        """Year of the luminances L (time, bin) [cd/m²], of which `sky_bins` come first."""
        return cls(L[:, :sky_bins].toarray(), L[:, sky_bins:].tocsr(), shares)

    @cached_property
    def hours(self) -> dict[int, np.ndarray]:
        """Time stamps of every element that has a share, `BESIDES` first, int, shape (hour,)."""
        some = np.flatnonzero(self.shares.any(axis=0)).tolist()
        of_elements = {e: np.flatnonzero(self.shares[:, e]) for e in some}
        return {BESIDES: np.arange(len(self.shares)), **of_elements}

    def share(self, element: int) -> np.ndarray:
        """Shares of an element at its `hours`, 1 of `BESIDES`, shape (hour, 1)."""
        at = self.hours[element]
        whole = np.ones(len(at), np.float32)
        return (whole if element == BESIDES else self.shares[at, element])[:, None]

    def suns_of(self, element: int) -> np.ndarray:
        """Whether each sun shines while an element has a share, bool, shape (sun,)."""
        return np.asarray(self.suns[self.hours[element]].getnnz(axis=0) > 0)

    def dark(self, receivers: int) -> np.ndarray:
        """Illuminance of receivers to which light is added, 0 lx, shape (time, receiver)."""
        return np.zeros((len(self.shares), receivers), np.float32)

    def add(self, E: np.ndarray, element: int, bins: np.ndarray, C: np.ndarray) -> None:
        """Add the light of an element to E (time, receiver) [lx].

        Parameters
        ----------
        E : np.ndarray, shape (time, receiver)
        element : int
        bins : np.ndarray of int, shape (own bin,)
            Its bins: ground and all sky patches, and some suns.
        C : np.ndarray, shape (own bin, receiver)
            Light of these bins on the receivers [sr].
        """
        patches = self.sky.shape[1]
        self.add_sky(E, element, C[:patches])
        self.add_suns(E, element, bins, C[patches:])

    def add_sky(self, E: np.ndarray, element: int, C: np.ndarray) -> None:
        """Add the light of ground and sky by an element, C (sky bin, receiver) [sr]."""
        at, lit = self.hours[element], np.flatnonzero(C.any(axis=1))
        if len(lit):
            E[at] += (self.share(element) * self.sky[np.ix_(at, lit)]) @ C[lit]

    def add_suns(self, E: np.ndarray, element: int, bins: np.ndarray, C: np.ndarray) -> None:
        """Add the light of the suns among the `bins` of an element, C (own sun, receiver) [sr]."""
        patches, at, share = self.sky.shape[1], self.hours[element], self.share(element)
        suns = self.suns[at][:, bins[patches:] - patches]
        shines = np.flatnonzero(np.diff(suns.indptr))
        for start in range(0, len(shines), HOURS):  # so many that their sums stay in the cache
            here = shines[start : start + HOURS]
            E[at[here]] += share[here] * (suns[here] @ C)
