"""G₁·H of many cells: sums over paths that end at their first diffuse vertex, without a matrix.

A sensor's paths meet a few of the cells. Where these are many, a sum over the paths is faster than
a product by G₁, of which almost all entries are 0; the values of four bins are read at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import IO

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import row_and_column
from drcmitsuba.transport.gather.blocks import Met
from drcmitsuba.transport.light.irradiance import Irradiance

Bins = tuple[int, int]

MANY = 40
"""Number of cells per path of a sensor from which on the paths are summed."""
WIDE = 4
"""Number of bins that are read at once."""


@dataclass(frozen=True)
class CellLight:
    """Light H on the cells after all bounces."""

    values: mi.Float | IO[bytes]
    """H [sr] of every cell, with room for a multiple of `WIDE` bins; or a file that holds it."""
    bins: int
    """Number of bins of sky and suns together."""

    @classmethod
    def of(cls, light: Irradiance) -> CellLight:
        """Put the light of sky and suns (replicate · cell, bin) [sr] side by side."""
        rows, sky = light.sky.shape
        bins = sky + light.sun.shape[1]
        wide = -(-bins // WIDE) * WIDE
        cell, bin = row_and_column(dr.arange(mi.UInt32, rows * wide), wide)
        values = mi.Float(0)
        for part, first in ((light.sky, 0), (light.sun, sky)):
            if part.shape[1] == 0:
                continue
            count, start = (dr.opaque(mi.UInt32, n) for n in (part.shape[1], first))
            own = (bin >= start) & (bin < start + count)
            values += dr.gather(mi.Float, part.array, cell * count + bin - start, own)
        dr.eval(values)
        return cls(values, bins)

    @property
    def nbytes(self) -> int:
        """Memory of the values [bytes]."""
        return 0 if not isinstance(self.values, mi.Float) else 4 * dr.width(self.values)

    def parked(self, file: IO[bytes]) -> CellLight:
        """Light whose values wait in a file, which is open as long as it is used."""
        self._here().numpy().tofile(file)
        return replace(self, values=file)

    def _here(self) -> mi.Float:
        """Values in memory."""
        if isinstance(self.values, mi.Float):
            return self.values
        self.values.seek(0)
        return mi.Float(np.fromfile(self.values, np.float32))

    def gathered(self, met: Met, replicates: int, paths: int, bins: Bins) -> list[mi.TensorXf]:
        """Sum over `paths` vertices of each row, one after another.

        Returns
        -------
        list of mi.TensorXf, shape (replicate · sensor, bin)
            Light of the first and of the second number of `bins` [sr].
        """
        values, wide = self._here(), -(-self.bins // WIDE)
        if dr.width(met.weight) == 0:
            return [dr.zeros(mi.TensorXf, (0, n)) for n in bins]
        each = dr.opaque(mi.UInt32, dr.width(values) // (WIDE * wide * replicates))
        vertex = dr.arange(mi.UInt32, dr.width(met.cell))
        replicate, _ = row_and_column(vertex, dr.width(vertex) // replicates)
        cell = met.cell + replicate * each
        rows = dr.width(met.weight) // paths
        total = _summed(values, cell, met.weight, rows, paths, wide)
        dr.eval(total)
        parts, first = [], 0
        for count in bins:
            if not count:
                parts.append(dr.zeros(mi.TensorXf, (rows, 0)))
                continue
            row, bin = row_and_column(dr.arange(mi.UInt32, rows * count), count)
            at = row * dr.opaque(mi.UInt32, WIDE * wide) + bin
            part = dr.gather(mi.Float, total, at + dr.opaque(mi.UInt32, first))
            parts.append(mi.TensorXf(part, (rows, count)))
            first += count
        return parts


@symbolic
def _summed(
    values: mi.Float, cell: mi.UInt32, weight: mi.Float, sensors: int, paths: int, wide: int
) -> mi.Float:
    """Sum in double precision, flat (sensor, bin)."""
    stride, each = dr.opaque(mi.UInt32, wide), dr.opaque(mi.UInt32, paths)
    sensor, column = row_and_column(dr.arange(mi.UInt32, sensors * wide), wide)
    vertex = sensor * each
    end, total = vertex + each, mi.Vector4d(0)
    while vertex < end:
        at = dr.gather(mi.UInt32, cell, vertex) * stride + column
        total += mi.Vector4d(dr.gather(mi.Vector4f, values, at)) * mi.Float64(
            dr.gather(mi.Float, weight, vertex)
        )
        vertex += 1
    return dr.ravel(mi.Vector4f(total))
