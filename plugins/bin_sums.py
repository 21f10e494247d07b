"""Sums of light by bin, to which the paths of `coefficient` add within their loops."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


class BinSums:
    """Sums in Float64 for every row (a sensor or a pixel) and bin.

    Light that met no diffuse surface and light that met one are kept apart: a lane adds from `base`
    on, its row's first entry, and from `base + part` on after its first diffuse surface.

    Parameters
    ----------
    rows, bins : int
    factor : float or mi.Float, one for each lane
        Multiplies what the lane adds: paths have positive weights, a film's filter may not.
    """

    def __init__(self, rows: int, bins: int, factor=1.0):
        self.rows, self.bins, self.factor = rows, bins, factor
        self.part = rows * bins
        self.values = dr.zeros(mi.Float64, 2 * self.part)

    def base(self, row):
        """First entry of a row, before any diffuse surface."""
        return row * self.bins

    def add(self, base, bin, light, active):
        """Add light to a bin; callable in symbolic loops."""
        dr.scatter_add(self.values, mi.Float64(light * self.factor), base + bin, active)

    def tensor(self):
        """Sums, mi.TensorXd of shape (2, row, bin): before and after a diffuse surface."""
        return mi.TensorXd(self.values, (2, self.rows, self.bins))


class RowSums(BinSums):
    """Sums for every row, all bins together; shape (2, row, 1)."""

    def __init__(self, rows: int):
        super().__init__(rows, 1)

    def add(self, base, bin, light, active):
        super().add(base, 0, light, active)
