"""Positions on a film, drawn from its reconstruction filter."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np


class FilterSampling:
    """Draw a sample's offset from the middle of its pixel in proportion to the filter.

    Each sample then counts for one pixel alone. Filters with negative lobes are drawn by their
    absolute value, and samples in these lobes count negative.

    Parameters
    ----------
    rfilter : mi.ReconstructionFilter
        Separable filter f(x) f(y).
    """

    STEPS = 2048
    """Steps of the filter's table along an axis; within each, the density is constant."""

    def __init__(self, rfilter):
        self.radius = 0.5 if rfilter.is_box_filter() else float(rfilter.radius())
        if rfilter.is_box_filter():
            values = np.ones(1)
        else:
            x = ((np.arange(self.STEPS) + 0.5) / self.STEPS * 2 - 1) * self.radius
            values = rfilter.eval(mi.Float(x)).numpy().astype(float)
        magnitude = np.abs(values)
        self.steps = len(values)
        self.cumulated = mi.Float64(np.cumsum(magnitude) / magnitude.sum())
        self.share = mi.Float(np.sign(values) * magnitude.sum() / values.sum())

    def sample(self, uv):
        """Offset from the pixel's middle, and the sample's weight.

        Parameters
        ----------
        uv : mi.Point2f
            Uniform random numbers in [0, 1)².

        Returns
        -------
        offset : mi.Point2f
            [pixels].
        share : mi.Float
            Weight with mean 1; 1 everywhere for a filter without negative lobes.
        """
        (x, share_x), (y, share_y) = (self._along(u) for u in (uv.x, uv.y))
        return mi.Point2f(x, y), share_x * share_y

    def _along(self, u):
        """Offset along an axis [pixels], and the sample's weight."""
        if self.steps == 1:
            return u - 0.5, mi.Float(1)
        u = mi.Float64(u)
        step = dr.binary_search(
            0, self.steps - 1, lambda i: dr.gather(mi.Float64, self.cumulated, i) <= u
        )
        high = dr.gather(mi.Float64, self.cumulated, step)
        low = dr.select(step > 0, dr.gather(mi.Float64, self.cumulated, step - 1, step > 0), 0)
        within = mi.Float((u - low) / dr.maximum(high - low, 1e-30))
        x = (mi.Float(step) + dr.clip(within, 0, 1)) * (2 / self.steps) - 1
        return x * self.radius, dr.gather(mi.Float, self.share, step)
