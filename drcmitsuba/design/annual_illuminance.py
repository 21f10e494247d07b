"""E = D·L: illuminance E of receivers over a year, from their deposits D and luminances L."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.schema import positions
from drcmitsuba.sky import daylight as lights
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.sun_models import Blend
from drcmitsuba.transport.deposit import Irradiance


@dataclass(frozen=True)
class AnnualIlluminance:
    """Luminances L of every time stamp, and the bins of its suns.

    Parameters
    ----------
    sky : np.ndarray, shape (time, bin)
        L of sky patches and ground [cd/m²]; the suns' bins follow.
    sun, column : np.ndarray, shape (time, k)
        Luminances of up to k suns [cd/m²], and their bins.
    """

    sky: np.ndarray
    sun: np.ndarray
    column: np.ndarray

    @classmethod
    def of(cls, daylight: Daylight) -> AnnualIlluminance:
        """L and the suns of a case's daylight."""
        sky = daylight.sky
        # An adaptive sun model has no blend: each time stamp's own sun takes its place.
        known = "blend_bin" in sky
        blend = lights.blended(sky) if known else Blend.own(sky["sun_bin"].values)
        labels = [*map(str, sky["bin"].values), *daylight.suns.labels]
        column = positions(blend.bins, labels, missing=0).astype(np.uint32)
        sun = blend.weights * sky["sun"].values[:, None]
        return cls(sky["sky"].values.astype(np.float32), sun.astype(np.float32), column)

    def by_sun(self, d: Irradiance) -> mi.TensorXf:
        """Illuminance E by the suns [lx], shape (time, receiver)."""
        shape = len(self.sky), d.sky.shape[0]
        entry, width = dr.arange(mi.UInt32, shape[0] * shape[1]), dr.opaque(mi.UInt32, shape[1])
        time, receiver = entry // width, entry % width
        out = dr.zeros(mi.Float, dr.width(entry))
        first = dr.opaque(mi.UInt32, d.sky.shape[1])
        for columns, values in zip(self.column.T, self.sun.T, strict=True):
            column = dr.gather(mi.UInt32, mi.UInt32(np.ascontiguousarray(columns)), time)
            value = dr.gather(mi.Float, mi.Float(np.ascontiguousarray(values)), time)
            here = column < first
            for part, at, mine in ((d.sky, column, here), (d.sun, column - first, ~here)):
                if part.shape[1]:
                    index = receiver * dr.opaque(mi.UInt32, part.shape[1]) + at
                    out += value * dr.gather(mi.Float, part.array, index, mine)
        dr.eval(out)
        return mi.TensorXf(out, shape)

    def by_all(self, d: Irradiance) -> mi.TensorXf:
        """Illuminance E by sky and suns [lx], shape (time, receiver)."""
        E = mi.TensorXf(self.sky) @ _transposed(d.sky) + self.by_sun(d)
        dr.eval(E)
        return E


def _transposed(matrix: mi.TensorXf) -> mi.TensorXf:
    """Transpose a matrix."""
    rows, columns = matrix.shape
    entry, width = dr.arange(mi.UInt32, rows * columns), dr.opaque(mi.UInt32, rows)
    index = entry % width * dr.opaque(mi.UInt32, columns) + entry // width
    return mi.TensorXf(dr.gather(mi.Float, matrix.array, index), (columns, rows))
