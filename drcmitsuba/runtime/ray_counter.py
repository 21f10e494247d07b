"""Rays that were traced, by kind."""

from __future__ import annotations

from typing import Literal

import drjit as dr
import mitsuba as mi

KINDS = ("shadow", "path", "pane", "photon")
"""Towards sky and suns; of the gather, from surface to surface; towards panes that scatter; of
photons, from surface to surface."""
Kind = Literal["shadow", "path", "pane", "photon"]


class RayCounter:
    """Counts rays where they are traced, within kernels as well."""

    def __init__(self) -> None:
        self._counts = dr.zeros(mi.UInt64, len(KINDS))
        dr.make_opaque(self._counts)  # kernels that are being recorded add to it

    def add(self, kind: Kind, active: mi.Bool, width: int = 1) -> None:
        """Count the rays of lanes that are active; `width` lanes outside of a loop."""
        index = dr.full(mi.UInt32, KINDS.index(kind), width)
        dr.scatter_add(self._counts, mi.UInt64(1), index, active)

    def take(self, kind: Kind, number: int) -> None:
        """Count rays whose number is known."""
        dr.scatter_add(self._counts, mi.UInt64(number), mi.UInt32(KINDS.index(kind)))

    def counted(self) -> dict[str, int]:
        """Number of rays by kind."""
        return dict(zip(KINDS, map(int, self._counts.numpy()), strict=True))
