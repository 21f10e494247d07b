"""Light by paths that met openings, which counts with the shares of the fills that they met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.transport.elements.weights import Year

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

FULL = 1 / 32
"""Share of entries from which on products with a full matrix are the faster ones."""


def quick(G: csr_matrix) -> csr_matrix | np.ndarray:
    """Matrix in the form whose products are the faster ones."""
    return G if G.nnz < FULL * G.shape[0] * G.shape[1] else G.toarray()


@dataclass(frozen=True, eq=False)
class MarkedLight:
    """Marked vertices of one result, the mean over one or several replicates."""

    sensor: np.ndarray
    """Sensor whose path met each vertex, or block of cells from which its ray came, int, (vertex,).
    """
    block: np.ndarray
    """Block of cells that it lies in, or target of its ray, see `solved_paths`, int."""
    weight: np.ndarray
    """Throughput."""
    met: np.ndarray
    """Elements that its path met, the last one first, −1 for none, int, shape (vertex, meeting)."""
    passes: np.ndarray
    """Whether its path went through the last opening, between a room and the outside, and was not
    sent back, bool, shape (vertex,)."""
    shape: tuple[int, int]
    """Number of sensors, or blocks that rays come from, and of blocks, or targets."""

    @classmethod
    def mean(cls, parts: Sequence[MarkedLight]) -> MarkedLight:
        """Mean over results."""
        sensor, block, weight, met, passes = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("sensor", "block", "weight", "met", "passes")
        )
        return cls(sensor, block, weight / np.float32(len(parts)), met, passes, parts[0].shape)

    def passed(self, elements: int) -> np.ndarray:
        """Element that light of each vertex passes, the number of all for none, int, (vertex,)."""
        return np.where(self.passes, self.met[:, 0], elements)

    def scaled(self, factors: np.ndarray) -> MarkedLight:
        """Light with factors (element,) of what passes openings; what they send back stays."""
        own = np.append(factors, 1).astype(np.float32)[self.passed(len(factors))]
        return replace(self, weight=self.weight * own)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return sum(a.nbytes for a in (self.sensor, self.block, self.weight, self.met, self.passes))

    def weighed(self, shares: np.ndarray) -> np.ndarray:
        """G_m of the sensors from the blocks (sensor, block), with shares (element,)."""
        factor = np.append(shares, np.float32(1))[self.met].prod(axis=1)
        sensors, blocks = self.shape
        place = self.sensor.astype(np.int64) * blocks + self.block
        G = np.bincount(place, self.weight * factor, sensors * blocks)
        return G.astype(np.float32).reshape(self.shape)

    def add(self, E: np.ndarray, D: np.ndarray, year: Year) -> None:
        """Add the light of a year to E.

        Parameters
        ----------
        E : np.ndarray, shape (time, sensor)
            Illuminance that grows [lx].
        D : np.ndarray, shape (time, block)
            Mean illuminance of the blocks before any diffuse reflection [lx].
        year : Year
        """
        for element, at in year.hours.items():
            here = self.met[:, 0] == element  # no path has the mark of `BESIDES`
            if element < 0 or not here.any():
                continue
            lit = year.share(element) * D[at]
            once = here & (self.met[:, 1] < 0)
            place = self.sensor[once], self.block[once]
            G = quick(sparse.csr_matrix((self.weight[once], place), self.shape))
            E[at] += (G @ lit.T).T
            more = np.flatnonzero(here & (self.met[:, 1] >= 0))
            if not len(more):
                continue
            by_vertex = lit[:, self.block[more]] * self.weight[more]
            for others in self.met[more, 1:].T:
                by_vertex *= np.where(others < 0, 1, year.shares[np.ix_(at, others)])
            entries = np.ones(len(more), np.float32), (self.sensor[more], np.arange(len(more)))
            E[at] += (sparse.csr_matrix(entries, (self.shape[0], len(more))) @ by_vertex.T).T
