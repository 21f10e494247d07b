"""Sums of the flux of photons: on cells, through the squares of sensors, and by fate."""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

FATES = ("emitted", "landed", "absorbed", "escaped", "others", "lost", "roulette")
"""Flux of photons by fate, see `FluxLedger`."""
COUNTS = ("photons", "segments")
"""Numbers of photons and of their flights."""


class Half(NamedTuple):
    """Numbers of entries of sums, after which come those of photons that have met a pane."""

    cells: mi.UInt32
    squares: mi.UInt32
    fates: mi.UInt32


class FluxSums(NamedTuple):
    """Flux per unit radiance [m² sr] of one kind of bins, in double precision against drift.

    Where panes may change, sums of photons that have met none of them come first, and after them as
    many of the others.
    """

    cells: mi.Float64
    """Flux onto the rows of `CellAreas`, shape (row · bin,)."""
    sensors: mi.Float64
    """Flux through the squares, shape (sensor · bin,)."""
    mirrored: mi.Float64
    """Part of `sensors` that only smooth surfaces have deviated, shape (sensor · bin,)."""
    inner: mi.Float64
    """Flux through the middle quarter of the squares, shape (sensor · bin,)."""
    fates: mi.Float64
    """Sums of `FATES` and `COUNTS`, shape (component · fate · bin,)."""
    half: Half

    @classmethod
    def of(
        cls, cells: int, sensors: int, bins: int, components: int, panes_change: bool
    ) -> FluxSums:
        """Make sums of zero for some cells and sensors, and for photons of some components."""
        rows = (cells, sensors, sensors, sensors, components * (len(FATES) + len(COUNTS)))
        # At least one entry: a kernel takes no empty array.
        sizes = (max(1, (1 + panes_change) * bins * each) for each in rows)
        half = Half(*(dr.opaque(mi.UInt32, rows[i] * bins) for i in (0, 1, 4)))
        return cls._make((*(dr.zeros(mi.Float64, size) for size in sizes), half))

    def by_fate(self, components: int, halves: int, bins: int) -> np.ndarray:
        """Fates, shape (half, component, fate, bin)."""
        shape = halves, components, len(FATES) + len(COUNTS), bins
        return self.fates.numpy()[: prod(shape)].reshape(shape)
