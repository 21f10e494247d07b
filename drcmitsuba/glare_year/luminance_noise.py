r"""Noise of bright surfaces' luminances, and what it does to the sums of glare.

To first order the sum S over glare sources of L_s² ω_s / P_s² changes with pixels' luminances by

.. math:: \delta S = \sum_p 2 L_p \omega_p \delta L_p / P_p^2 ,

where a pixel of a source stands for the source's mean L_s and position index P_s. So a pixel that
is brighter than the rest of its source counts with too much noise.

Limits: it is not counted that noise lifts a luminance above the threshold or pushes it below, and
that sources so join or part; nor the noise of films, and of the visible part of the sun's disk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.glare_year.seen import Seen, sparse

DIM = 1000.0
"""Luminance up to which the noise of a surface is left out [cd/m²]: half of the threshold."""


@dataclass(frozen=True, eq=False)
class LuminanceNoise:
    """Deviations of bright luminances from their mean, by each replicate of C."""

    point: np.ndarray
    """Surface point of every bright luminance, int, shape (bright,)."""
    time: np.ndarray
    """Its time stamp, in rising order, int, shape (bright,)."""
    luminance: np.ndarray
    """Mean luminance [cd/m²], float32, shape (bright,)."""
    deviation: np.ndarray
    """Luminance by each replicate, less the mean [cd/m²], float32, shape (replicate, bright)."""

    def of_sums(self, seen: Seen, shares: np.ndarray, least: float) -> np.ndarray:
        """Deviations of Σ L² ω / P² by each replicate, float32, (replicate, time, view).

        Parameters
        ----------
        seen : Seen
            View whose surfaces these are.
        shares : np.ndarray, shape (time, element + 1)
            Shares of elements by which surfaces are seen, as of `Luminances`.
        least : float
            Luminance above which a pixel is bright [cd/m²].
        """
        slopes = (2 * seen.of_points).astype(np.float32)
        share = shares[self.time, seen.surfaces.element.take(self.point)].astype(np.float32)
        some = np.flatnonzero((least < self.luminance) & (share > 0))
        first = np.searchsorted(self.time.take(some), np.arange(len(shares) + 1))
        bright, point = (share * self.luminance).take(some), self.point.take(some)
        out = np.zeros((len(self.deviation), len(shares), slopes.shape[1]), np.float32)
        steps = sparse.csr_array((bright, point, first), (len(shares), len(slopes)))
        for own, deviation in zip(out, self.deviation, strict=True):
            steps.data = bright * deviation.take(some)
            own[:] = steps @ slopes
        return out
