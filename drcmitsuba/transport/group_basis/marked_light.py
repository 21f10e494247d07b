"""Light by paths that met grouped panes, which counts where their marks agree with the state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.transport.group_basis.marks import elements_of
from drcmitsuba.transport.marked_paths import MarkedVertices, quick

sparse = lazy.module("scipy.sparse")


@dataclass(frozen=True, eq=False)
class MarkedLight:
    """Marked vertices of one replicate."""

    sensor: np.ndarray
    """Sensor whose path met each vertex, int, shape (vertex,)."""
    block: np.ndarray
    """Block of cells that it lies in, int."""
    weight: np.ndarray
    """Throughput."""
    met: np.ndarray
    """Elements that its path met, the last one first, −1 for none, int, shape (vertex, meeting)."""
    shape: tuple[int, int]
    """Number of sensors and of blocks."""

    @classmethod
    def by_replicate(
        cls, marked: MarkedVertices, replicates: int, shape: tuple[int, int]
    ) -> list[MarkedLight]:
        """Vertices of every replicate."""
        replicate, sensor = np.divmod(marked.row, shape[0])
        met = elements_of(marked.mark)
        each = (np.flatnonzero(replicate == r) for r in range(replicates))
        return [cls(sensor[at], marked.block[at], marked.weight[at], met[at], shape) for at in each]

    def in_state(self, chosen: np.ndarray) -> np.ndarray:
        """G_m of the sensors from the blocks (sensor, block), with the elements `chosen`."""
        agrees = np.all(np.isin(self.met, chosen) | (self.met < 0), axis=1)
        place = self.sensor[agrees], self.block[agrees]
        return np.asarray(sparse.csr_matrix((self.weight[agrees], place), self.shape).toarray())

    def add(
        self, E: np.ndarray, D: np.ndarray, hours: Mapping[int, np.ndarray], chosen: np.ndarray
    ) -> None:
        """Add the light of a year to E.

        Parameters
        ----------
        E : np.ndarray, shape (time, sensor)
            Illuminance that grows [lx].
        D : np.ndarray, shape (time, block)
            Mean illuminance of the blocks before any diffuse reflection [lx].
        hours : mapping of int to np.ndarray of int
            Time stamps at which each element is chosen.
        chosen : np.ndarray of int, shape (time, group)
            Elements of every time stamp.
        """
        for element, at in hours.items():
            here = self.met[:, 0] == element  # no path has the mark of `BESIDES`
            if not here.any():
                continue
            once = here & (self.met[:, 1] < 0)
            place = self.sensor[once], self.block[once]
            G = quick(sparse.csr_matrix((self.weight[once], place), self.shape))
            E[at] += (G @ D[at].T).T
            more = np.flatnonzero(here & (self.met[:, 1] >= 0))
            if not len(more):
                continue
            agrees = np.ones((len(at), len(more)), bool)
            for others in self.met[more, 1:].T:
                taken = (chosen[at][:, :, None] == others).any(axis=1)
                agrees &= taken | (others < 0)
            share = agrees * D[np.ix_(at, self.block[more])] * self.weight[more]
            entries = np.ones(len(more), np.float32), (self.sensor[more], np.arange(len(more)))
            E[at] += (sparse.csr_matrix(entries, (self.shape[0], len(more))) @ share.T).T
