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
from drcmitsuba.schema import describe
from drcmitsuba.transport.group_basis.marked_light import MarkedLight
from drcmitsuba.transport.group_basis.year import BESIDES, Year
from drcmitsuba.transport.marked_paths import MarkedVertices

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


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
    def _marked(self) -> list[MarkedLight]:
        """Marked vertices of every replicate."""
        shape = len(self.positions), self.besides.blocks.shape[2]
        return MarkedLight.by_replicate(self.marked, self.replicates, shape)

    def chosen(self, indices: Sequence[int] | np.ndarray) -> np.ndarray:
        """Elements of states of the groups, int, (…, group); `indices` (…, group)."""
        return np.array(self.groups.starts[:-1]) + np.asarray(indices)

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
        chosen = np.array([BESIDES, *self.chosen(self.groups.indices(state))])
        sensors, blocks = len(self.positions), self.besides.blocks.shape[2]
        out = np.zeros((self.replicates, len(self.labels), sensors), np.float32)
        for r, marked in enumerate(self._marked):
            D = np.zeros((len(self.labels), blocks), np.float32)
            for light in map(self.light, chosen.tolist()):
                out[r, light.bins] += light.total[r]
                D[light.bins] += light.blocks[r]
            out[r] += D @ marked.in_state(chosen).T
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
        year = Year.of(L, self.chosen(indices), self.sky_bins)
        for r, marked in enumerate(self._marked):
            E, D = (year.dark(n) for n in marked.shape)
            for number in year.hours:
                light = self.light(number)
                year.add(E, number, light.bins, light.total[r])
                year.add(D, number, light.bins, light.blocks[r])
            marked.add(E, D, year.hours, year.chosen)
            yield E
