"""Sums of light by bin, to which the paths of `coefficient` add within their loops."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


class BinSums:
    """Sums in Float64 for every row (a sensor or a pixel) and bin.

    Light that met no diffuse surface and light that met one are kept apart: a lane adds at `base`
    plus the bin, and after its first diffuse surface at `base + part` plus the bin.

    Parameters
    ----------
    rows, bins : int
    factor : float or mi.Float, one for each lane
        Multiplies the lane's light; may be negative, as a reconstruction filter may be.
    """

    def __init__(self, rows: int, bins: int, factor=1.0):
        self.rows, self.bins, self.factor = rows, bins, factor
        self.part = rows * bins
        self.values = dr.zeros(mi.Float64, 2 * self.part)

    def base(self, row):
        """Index of a row's first entry, for light before any diffuse surface."""
        return row * self.bins

    def add(self, base, bin, light, active):
        """Add light to a bin; callable in symbolic loops."""
        dr.scatter_add(self.values, mi.Float64(light * self.factor), base + bin, active)

    def tensor(self):
        """Sums as mi.TensorXd, shape (2, row, bin): light before and after a diffuse surface."""
        return mi.TensorXd(self.values, (2, self.rows, self.bins))


class RowSums(BinSums):
    """Sums for every row, all bins together; shape (2, row, 1)."""

    def __init__(self, rows: int):
        super().__init__(rows, 1)

    def add(self, base, bin, light, active):
        super().add(base, 0, light, active)
