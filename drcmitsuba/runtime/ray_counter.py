"""Number of rays, by kind and by purpose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import drjit as dr
import mitsuba as mi

KINDS = ("shadow", "path", "pane", "photon")
"""Kinds of rays: shadow rays towards sky and suns; paths of the gather G from surface to surface;
rays towards panes that scatter; photons from surface to surface."""
Kind = Literal["shadow", "path", "pane", "photon"]
Purpose = tuple[str, ...]


class RayCounter:
    """Counts rays where they are traced, within kernels as well."""

    def __init__(self) -> None:
        self._purpose: Purpose = ()
        self._counts: dict[Purpose, mi.UInt64] = {}
        self._open()

    def _open(self) -> None:
        """Begin the counts of the present purpose."""
        if self._purpose not in self._counts:
            counts = dr.zeros(mi.UInt64, len(KINDS))
            dr.make_opaque(counts)  # kernels that are being recorded add to these counts
            self._counts[self._purpose] = counts

    @contextmanager
    def purpose(self, *names: str) -> Iterator[None]:
        """Count the rays of a block under further names of the purpose."""
        before = self._purpose
        self._purpose = (*before, *names)
        self._open()
        try:
            yield
        finally:
            self._purpose = before

    def add(self, kind: Kind, active: mi.Bool, width: int = 1) -> None:
        """Count one ray for each active lane; a launch outside of a loop has `width` lanes."""
        index = dr.full(mi.UInt32, KINDS.index(kind), width)
        dr.scatter_add(self._counts[self._purpose], mi.UInt64(1), index, active)

    def take(self, kind: Kind, number: int) -> None:
        """Count `number` rays."""
        counts = self._counts[self._purpose]
        dr.scatter_add(counts, mi.UInt64(number), mi.UInt32(KINDS.index(kind)))

    def by_purpose(self) -> dict[Purpose, dict[str, int]]:
        """Number of rays by purpose and kind."""
        return {
            purpose: dict(zip(KINDS, map(int, counts.numpy()), strict=True))
            for purpose, counts in self._counts.items()
        }

    def counted(self) -> dict[str, int]:
        """Number of rays by kind, for all purposes together."""
        every = self.by_purpose().values()
        return {kind: sum(counts[kind] for counts in every) for kind in KINDS}
