r"""A basis of groups of panes, and the coefficients of any state of the façade from it.

.. math:: C(s) = S_0 + G_0 D_0 + \sum_g (S_{g,s_g} + G_0 D_{g,s_g})
          + G_m(s) \Big( D_0 + \sum_g D_{g,s_g} \Big)

with S and D the light on sensors and cells that comes in by group g in its state, before any
diffuse reflection; S₀ and D₀ the light that passes no grouped pane; G₀ the paths that met none of
these panes, and G_m those whose marks agree with the state s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates, State
from drcmitsuba.runtime import lazy
from drcmitsuba.schema import describe
from drcmitsuba.transport.group_basis.marks import elements_of
from drcmitsuba.transport.marked_paths import MarkedVertices

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

BESIDES = -1
"""In place of an element: light that passes no grouped pane."""


@dataclass(frozen=True, eq=False)
class ElementLight:
    """Light that comes in by a group of panes in one state: an element."""

    bins: np.ndarray
    """Bins that it has light of, positions among the basis' labels, int, shape (own bin,): ground
    and all sky patches, then some suns."""
    total: np.ndarray
    """C without light that met grouped panes from inside [sr], (replicate, own bin, sensor)."""
    blocks: np.ndarray
    """Mean D of blocks of cells [sr], (replicate, own bin, block)."""


@dataclass(frozen=True, eq=False)
class GroupBasis:
    """Coefficients by group and state."""

    groups: GroupStates
    positions: np.ndarray
    """Positions of the sensors [m], shape (sensor, 3)."""
    labels: tuple[str, ...]
    """Bins: ground, sky patches, suns."""
    sky_bins: int
    """Number of bins of ground and sky, which come first."""
    besides: ElementLight
    """Light that passes no grouped pane."""
    elements: tuple[ElementLight, ...]
    """Light of every group in every state, group by group."""
    marked: MarkedVertices
    """Vertices of the paths that met grouped panes."""

    @property
    def replicates(self) -> int:
        """Number of independent results."""
        return len(self.besides.total)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        light = (a for e in (self.besides, *self.elements) for a in (e.total, e.blocks))
        return sum(a.nbytes for a in (*light, *self.marked))

    @cached_property
    def first(self) -> np.ndarray:
        """First element of every group, int, shape (group,)."""
        return np.cumsum([0, *(len(states) for states in self.groups.states)])[:-1]

    @cached_property
    def _met(self) -> np.ndarray:
        """Elements that the marked paths met, −1 for none, int, shape (vertex, meeting)."""
        return elements_of(self.marked.mark)

    @cached_property
    def _of_replicate(self) -> list[np.ndarray]:
        """Vertices of every replicate."""
        replicate = self.marked.row // len(self.positions)
        return [np.flatnonzero(replicate == r) for r in range(self.replicates)]

    def chosen(self, indices: Sequence[int] | np.ndarray) -> np.ndarray:
        """Elements of states of the groups, int, (…, group); `indices` (…, group)."""
        return self.first + np.asarray(indices)

    def light(self, element: int) -> ElementLight:
        """Light of an element, or the light `BESIDES`."""
        return self.besides if element == BESIDES else self.elements[element]

    def coefficients(self, state: State) -> xr.Dataset:
        """Coefficients of a state of the façade.

        Returns
        -------
        xr.Dataset
            `replicates` (replicate, sensor, bin) [sr].

        Raises
        ------
        InputError
            A group has no such state.
        """
        chosen = [BESIDES, *self.chosen(self.groups.indices(state))]
        sensors, blocks = len(self.positions), self.besides.blocks.shape[2]
        out = np.zeros((self.replicates, len(self.labels), sensors), np.float32)
        agrees = np.all(np.isin(self._met, chosen) | (self._met < 0), axis=1)
        for r, mine in enumerate(self._of_replicate):
            D = np.zeros((len(self.labels), blocks), np.float32)
            for light in map(self.light, chosen):
                out[r, light.bins] += light.total[r]
                D[light.bins] += light.blocks[r]
            at = mine[agrees[mine]]
            place = self.marked.row[at] % sensors, self.marked.block[at]
            G = sparse.csr_matrix((self.marked.weight[at], place), (sensors, blocks)).toarray()
            out[r] += D @ G.T
        coords: dict[str, Any] = {"bin": np.array(self.labels, dtype=object)}
        coords |= {axis: ("sensor", self.positions[:, i]) for i, axis in enumerate("xyz")}
        values = ("replicate", "sensor", "bin"), out.transpose(0, 2, 1)
        return describe(xr.Dataset({"replicates": values}, coords))

    def illuminance(self, L: csr_matrix, indices: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the illuminance of a year by each replicate.

        Parameters
        ----------
        L : csr_matrix, shape (time, bin)
            Luminances of the basis' bins [cd/m²].
        indices : np.ndarray of int, shape (time, group)
            State of every group at every time stamp.

        Yields
        ------
        np.ndarray, shape (time, sensor)
            E [lx].
        """
        chosen = self.chosen(indices)
        hours = {e: np.flatnonzero((chosen == e).any(axis=1)) for e in np.unique(chosen).tolist()}
        hours[BESIDES] = np.arange(len(indices))
        suns, sky = L[:, self.sky_bins :], L[:, : self.sky_bins].toarray()
        # Every element has the bins of ground and sky, and those of some suns.
        sources = [
            (self.light(element), at, sky[at], suns[at][:, bins - self.sky_bins])
            for element, at in hours.items()
            for bins in [self.light(element).bins[self.sky_bins :]]
        ]
        for r in range(self.replicates):
            E = np.zeros((len(indices), len(self.positions)), np.float32)
            D = np.zeros((len(indices), self.besides.blocks.shape[2]), np.float32)
            for light, at, by_sky, by_sun in sources:
                for out, values in ((E, light.total[r]), (D, light.blocks[r])):
                    out[at] += by_sky @ values[: self.sky_bins] + by_sun @ values[self.sky_bins :]
            self._add_marked(E, D, hours, chosen, self._of_replicate[r])
            yield E

    def _add_marked(
        self, E: np.ndarray, D: np.ndarray, hours: dict[int, np.ndarray], chosen: np.ndarray,
        mine: np.ndarray,
    ) -> None:  # fmt: skip
        """Add the light of marked paths, E (time, sensor), of the light D on blocks (time, block).

        `mine` are the vertices of a replicate.
        """
        met, sensors = self._met[mine], len(self.positions)
        sensor, block = self.marked.row[mine] % sensors, self.marked.block[mine]
        weight = self.marked.weight[mine]
        for element, at in hours.items():
            here = met[:, 0] == element  # the last meeting; no path has the mark of `BESIDES`
            if not here.any():
                continue
            once = here & (met[:, 1] < 0)
            G = sparse.csr_matrix(
                (weight[once], (sensor[once], block[once])), (sensors, D.shape[1])
            )
            E[at] += D[at] @ G.toarray().T
            more = np.flatnonzero(here & (met[:, 1] >= 0))
            if not len(more):
                continue
            agrees = np.ones((len(at), len(more)), bool)
            for meeting in range(1, met.shape[1]):
                others = met[more, meeting]
                taken = (chosen[at][:, :, None] == others).any(axis=1)
                agrees &= taken | (others < 0)
            share = agrees * D[np.ix_(at, block[more])] * weight[more]
            entries = np.ones(len(more), np.float32), (sensor[more], np.arange(len(more)))
            to = sparse.csr_matrix(entries, (sensors, len(more)))
            E[at] += (to @ share.T).T
