"""Light by element of a case whose openings bring surfaces: light of its own for each set of them.

A sum over elements knows light by pane, and no surfaces that come and go with a fill: a shelf that
turns, snow, leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.transport.elements.light import LightByElement
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs
from drcmitsuba.transport.elements.weights import different_rows

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MOST_SETS = 32
"""Largest number of sets of surfaces whose light is kept."""

Fills = tuple[int, ...]
"""Fills of the openings that bring surfaces, by which one set of these stands."""


@dataclass(frozen=True, eq=False)
class LightOfSurfaces:
    """Light by element of every set of surfaces, made when asked for; named as `LightByElement`."""

    source: str
    """Name of the case in error messages."""
    openings: tuple[int, ...]
    """Openings whose fills bring surfaces."""
    make: Callable[[Fills, int, Progress], LightByElement]
    """Function that simulates the light with a set of surfaces in so much memory [bytes]."""
    most_bytes: int
    """Largest memory of the light of all sets [bytes]."""
    known: dict[Fills, LightByElement] = field(default_factory=dict)
    """Light of the sets that were asked for."""

    @property
    def drawn(self) -> LightByElement:
        """Light with the surfaces that the case draws; sensors and bins are those of all sets."""
        return self.of((0,) * len(self.openings))

    @property
    def positions(self) -> np.ndarray:
        """Positions of the sensors [m], shape (sensor, 3)."""
        return self.drawn.positions

    @property
    def sky_bins(self) -> int:
        """Number of bins of ground and sky, which come first."""
        return self.drawn.sky_bins

    @property
    def labels(self) -> tuple[str, ...]:
        """Bins: ground, sky patches, suns."""
        return self.drawn.labels

    @property
    def pairs(self) -> MirroredPairs:
        """Pairs of elements, one of which mirrors light of the other one, as the case is drawn."""
        return self.drawn.pairs

    @property
    def replicates(self) -> int:
        """Number of independent results."""
        return self.drawn.replicates

    def shares(self, indices: np.ndarray) -> np.ndarray:
        """Shares (…, element) of openings with one fill each, `indices` (…, opening)."""
        return self.drawn.shares(indices)

    def of(self, fills: Fills, progress: Progress = lambda share: None) -> LightByElement:
        """Light with a set of surfaces.

        Raises
        ------
        InputError
            There are too many sets, or they are larger than memory.
        """
        if fills not in self.known:
            self.make_room([fills, *self.known])
            left = self.most_bytes - sum(light.nbytes for light in self.known.values())
            self.known[fills] = self.make(fills, left, progress)
        return self.known[fills]

    def make_room(self, wanted: Sequence[Fills]) -> None:
        """Drop the light of sets that are not `wanted` where these would be too many with them."""
        drawn = (0,) * len(self.openings)
        if len({drawn, *wanted}) > MOST_SETS:
            got = f"more than {MOST_SETS} sets of the surfaces that fills bring"
            remedy = "name the state in which some groups stay: states in [model]"
            raise InputError(self.source, "groups", got, remedy)
        if len({*self.known, *wanted}) > MOST_SETS:
            for fills in {*self.known} - {drawn, *wanted}:
                del self.known[fills]

    def fills(self, shares: np.ndarray) -> Fills:
        """Set of surfaces that stands by the shares of all elements (element,).

        Raises
        ------
        InputError
            An opening that brings surfaces has several fills at once.
        """
        known, fills = self.drawn.openings, []
        for opening in self.openings:
            row = shares[known.starts[opening] : known.starts[opening + 1]]
            if np.count_nonzero(row) != 1:
                got = "shares of fills that have surfaces of their own"
                raise InputError(self.source, known.names[opening], got, "name one at a time")
            fills.append(int(row.argmax()))
        return tuple(fills)

    def standing(self, shares: np.ndarray) -> LightByElement:
        """Light by the surfaces that stand by the shares of all elements (element,)."""
        return self.of(self.fills(shares))

    def scaled(self, factors: np.ndarray) -> LightOfSurfaces:
        """Light with factors of each element, as `LightByElement.scaled`."""

        def made(fills: Fills, most: int, progress: Progress) -> LightByElement:
            return self.of(fills, progress).scaled(factors)

        known = {fills: light.scaled(factors) for fills, light in self.known.items()}
        return replace(self, make=made, known=known)

    def illuminance(self, L: csr_matrix, shares: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the illuminance (time, sensor) [lx] of a year by each replicate."""
        rows, row = different_rows(shares, len(shares))
        sets = [self.fills(each) for each in rows]
        parts = []
        for fills in dict.fromkeys(sets):
            mine = [k for k, each in enumerate(sets) if each == fills]
            hours = np.flatnonzero(np.isin(row, mine))
            parts.append((hours, self.of(fills).illuminance(L[hours], shares[hours])))
        for _ in range(self.replicates):
            E = np.empty((len(shares), len(self.positions)), np.float32)
            for hours, years in parts:
                E[hours] = next(years)
            yield E


AnyLight = LightByElement | LightOfSurfaces
