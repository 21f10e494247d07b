"""Rays that were traced, by kind and by purpose."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import drjit as dr
import mitsuba as mi

KINDS = ("shadow", "path", "pane", "photon")
"""Towards sky and suns; of the gather, from surface to surface; towards panes that scatter; of
photons, from surface to surface."""
Kind = Literal["shadow", "path", "pane", "photon"]
Purpose = tuple[str, ...]


class RayCounter:
    """Counts rays where they are traced, within kernels as well.

    Attributes
    ----------
    lanes : Counter
        Number of lanes that were launched to trace rays, by purpose and kind; a loop counts once.
    """

    def __init__(self) -> None:
        self._purpose: Purpose = ()
        self._counts: dict[Purpose, mi.UInt64] = {}
        self.lanes: Counter[tuple[Purpose, Kind]] = Counter()
        self._open()

    def _open(self) -> None:
        """Begin the counts of the present purpose."""
        if self._purpose not in self._counts:
            counts = dr.zeros(mi.UInt64, len(KINDS))
            dr.make_opaque(counts)  # kernels that are being recorded add to it
            self._counts[self._purpose] = counts

    @contextmanager
    def purpose(self, *names: str) -> Iterator[None]:
        """Count rays that are traced meanwhile under further names, as well as in the whole."""
        before = self._purpose
        self._purpose = (*before, *names)
        self._open()
        try:
            yield
        finally:
            self._purpose = before

    def add(self, kind: Kind, active: mi.Bool, width: int = 1) -> None:
        """Count the rays of lanes that are active; `width` lanes outside of a loop."""
        index = dr.full(mi.UInt32, KINDS.index(kind), width)
        dr.scatter_add(self._counts[self._purpose], mi.UInt64(1), index, active)
        self.lanes[self._purpose, kind] += width

    def take(self, kind: Kind, number: int, lanes: int = 0) -> None:
        """Count rays whose number is known."""
        counts = self._counts[self._purpose]
        dr.scatter_add(counts, mi.UInt64(number), mi.UInt32(KINDS.index(kind)))
        self.lanes[self._purpose, kind] += lanes

    def by_purpose(self) -> dict[Purpose, dict[str, int]]:
        """Number of rays by kind, for each purpose by its names."""
        return {
            purpose: dict(zip(KINDS, map(int, counts.numpy()), strict=True))
            for purpose, counts in self._counts.items()
        }

    def counted(self) -> dict[str, int]:
        """Number of rays by kind, for all purposes together."""
        every = self.by_purpose().values()
        return {kind: sum(counts[kind] for counts in every) for kind in KINDS}
