"""Paths that gather the light of elements: those that met no opening, and those that did.

On paths that follow all bounces, G₀ and G_m are sums over them. Where light between surfaces is
solved on cells, `solved_paths` has both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.weights import Year
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.gather.marked_paths import MarkedPaths

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")


class SentBack(Protocol):
    """Light that openings send back into the room, in one replicate."""

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""

    @property
    def met(self) -> np.ndarray:
        """Elements that paths met, int, shape (vertex, meeting), −1 for none."""

    def weighed(self, shares: np.ndarray) -> np.ndarray:
        """Light that sensors get of light on blocks (sensor, block), with shares (element,)."""

    def add(self, E: np.ndarray, D: np.ndarray, year: Year) -> None:
        """Add to E (time, sensor) [lx] what returns of light D (time, block) [lx] in a year."""


class ElementPaths(Protocol):
    """Paths of all sensors."""

    @property
    def gathered(self) -> Gathered:
        """Paths as they were traced, and the cells that they met."""

    @property
    def blocks(self) -> int:
        """Number of blocks of cells of which openings may send light back."""

    def matrix(self, result: int) -> csr_matrix | np.ndarray:
        """G₀ of the sensors from the cells, shape (sensor, cell)."""

    def onto_blocks(self, result: int) -> csr_matrix | np.ndarray:
        """Light of blocks from D of the cells, without openings, shape (block, cell)."""

    def returned(self, result: int) -> SentBack:
        """Light that openings send back."""


@dataclass(frozen=True)
class FollowedPaths:
    """Paths that follow all bounces."""

    gathered: Gathered
    sensors: int
    results: int
    """Number of results, each of `draws` replicates."""
    draws: int

    @cached_property
    def _marked(self) -> MarkedPaths:
        return MarkedPaths(self.gathered, self.sensors, self.draws)

    @cached_property
    def _returned(self) -> list[MarkedLight]:
        shape = self.sensors, self.blocks
        return MarkedLight.by_result(self._marked.marked(), self.results, shape)

    @property
    def blocks(self) -> int:
        """Number of blocks of all cells."""
        return self._marked.blocks

    def matrix(self, result: int) -> csr_matrix | np.ndarray:
        """G₀, see `ElementPaths`."""
        return self._marked.matrix(result)

    def onto_blocks(self, result: int) -> csr_matrix:
        """Shares of cells in the means over blocks, the same in all results."""
        return self._marked.means

    def returned(self, result: int) -> MarkedLight:
        """Paths with marks."""
        return self._returned[result]
