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

from drcmitsuba.glare_year.seen import Luminances
from drcmitsuba.picture.position_index import position_index

DIM = 1000.0
"""Luminance up to which the noise of a surface is left out [cd/m²]: half of the threshold."""
POINTS = 128
"""Number of points whose luminances by each replicate are in memory at once."""


@dataclass(frozen=True, eq=False)
class LuminanceNoise:
    """Deviations of luminances above `DIM` from their mean, by each replicate of C."""

    point: np.ndarray
    """Surface point of every bright luminance, int, shape (bright,)."""
    time: np.ndarray
    """Its time stamp, int, shape (bright,)."""
    deviation: np.ndarray
    """Luminance by each replicate, less the mean [cd/m²], float32, shape (replicate, bright)."""

    @classmethod
    def joined(cls, parts: list[LuminanceNoise], replicates: int) -> LuminanceNoise:
        """Noise of several sets of points, which may be none."""
        nothing = np.zeros(0, int)
        every = [cls(nothing, nothing, np.zeros((replicates, 0), np.float32)), *parts]
        return cls(
            np.concatenate([part.point for part in every]),
            np.concatenate([part.time for part in every]),
            np.concatenate([part.deviation for part in every], axis=1),
        )

    def of_points(self, some: slice) -> LuminanceNoise:
        """Noise of some of the points, which are numbered anew."""
        mine = (self.point >= some.start) & (self.point < some.stop)
        return LuminanceNoise(
            self.point[mine] - some.start, self.time[mine], self.deviation[:, mine]
        )

    def of_sums(self, known: Luminances, frames: np.ndarray, least: float) -> np.ndarray:
        """Deviations of Σ L² ω / P² of some views by each replicate, (replicate, time, view).

        Parameters
        ----------
        known : Luminances
            Luminances that the deviations belong to.
        frames : np.ndarray, shape (view, 3, 3)
            Unit vectors to the right, up and forward of the views.
        least : float
            Luminance above which a pixel is bright [cd/m²].
        """
        pixel, times = known.seen.surfaces.pixel, known.surfaces.shape[1]
        local = np.einsum("pi,vki->vpk", known.seen.directions[pixel], frames)
        weights = 2 * known.seen.tiles.by_pixel[pixel] / position_index(local) ** 2
        L = known.surfaces[self.point, self.time]
        bright = np.where(least < L, L, 0)
        slopes = (weights * (local[..., 2] > 0))[:, self.point] * bright
        out = np.zeros((len(self.deviation), times, len(frames)))
        for r, deviation in enumerate(self.deviation):
            for v, slope in enumerate(slopes):
                out[r, :, v] = np.bincount(self.time, slope * deviation, times)
        return out
