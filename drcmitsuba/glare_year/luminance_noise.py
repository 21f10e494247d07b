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
from drcmitsuba.picture.position_index import position_index

DIM = 1000.0
"""Luminance up to which the noise of a surface is left out [cd/m²]: half of the threshold."""


@dataclass(frozen=True, eq=False)
class LuminanceNoise:
    """Deviations of bright luminances from their mean, by each replicate of C."""

    point: np.ndarray
    """Surface point of every bright luminance, int, shape (bright,)."""
    time: np.ndarray
    """Its time stamp, int, shape (bright,)."""
    luminance: np.ndarray
    """Mean luminance [cd/m²], float32, shape (bright,)."""
    deviation: np.ndarray
    """Luminance by each replicate, less the mean [cd/m²], float32, shape (replicate, bright)."""

    def of_sums(
        self, seen: Seen, shares: np.ndarray, frames: np.ndarray, least: float
    ) -> np.ndarray:
        """Deviations of Σ L² ω / P² of some views by each replicate, (replicate, time, view).

        Parameters
        ----------
        seen : Seen
            View whose surfaces these are.
        shares : np.ndarray, shape (time, element + 1)
            Shares of elements by which surfaces are seen, as of `Luminances`.
        frames : np.ndarray, shape (view, 3, 3)
            Unit vectors to the right, up and forward of the views.
        least : float
            Luminance above which a pixel is bright [cd/m²].
        """
        times = len(shares)
        local = np.einsum("pi,vki->vpk", seen.directions, frames)
        weights = 2 * seen.tiles.by_pixel / position_index(local) ** 2 * (local[..., 2] > 0)
        of_points = np.asarray((seen.showing.T @ weights.T).T)
        share = shares[self.time, seen.surfaces.element[self.point]]
        counts = np.flatnonzero((least < self.luminance) & (share > 0))
        time, point = self.time[counts], self.point[counts]
        bright, deviation = (share * self.luminance)[counts], self.deviation[:, counts].T.copy()
        out = np.zeros((len(self.deviation), times, len(frames)))
        for v, slope in enumerate(of_points[:, point] * bright):
            place = time, np.arange(len(counts))
            sums = sparse.csr_array((slope.astype(np.float32), place), (times, len(counts)))
            out[..., v] = (sums @ deviation).T
        return out
