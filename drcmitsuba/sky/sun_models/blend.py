"""Suns with their labels, and how they are blended into the sun of each time stamp.

The functions that blend take unit vectors `directions` (time, 3) to the suns, and `up` (time,):
whether each is above the horizon; elsewhere a time stamp has no bins. The angle across the sun is
the `diameter` [deg]. They return a `Blend`, with its `Suns` where these are not patches of the sky.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from drcmitsuba.sky import sun_labels


@dataclass(frozen=True)
class Suns:
    """Suns whose coefficients are computed."""

    labels: tuple[str, ...]
    directions: np.ndarray
    """Unit vectors towards them, shape (sun, 3)."""
    diameter: float = 0.5
    """Angle across a sun [deg]."""
    straight: bool = True
    """Whether sensors receive light straight from the suns; surfaces always do."""

    @classmethod
    def of(cls, sun: xr.Dataset, diameter: float) -> Suns:
        """All suns above the horizon, from the result of `sky.sun_position`."""
        labels = sun_labels(sun)
        up = labels != ""
        return cls(tuple(map(str, labels[up])), sun["direction"].values[up], diameter)

    @classmethod
    def none(cls) -> Suns:
        """No sun at all."""
        return cls((), np.zeros((0, 3)))

    def where(self, mask: np.ndarray) -> Suns:
        """Suns where a mask of bool, shape (sun,), is true."""
        labels = tuple(label for label, kept in zip(self.labels, mask, strict=True) if kept)
        return replace(self, labels=labels, directions=self.directions[mask])

    def only(self, labels: Iterable[str]) -> Suns:
        """Suns with these labels."""
        wanted = set(map(str, labels))
        return self.where(np.array([label in wanted for label in self.labels], bool))


@dataclass(frozen=True)
class Blend:
    """Bins that stand together for the sun of each time stamp.

    With a sun of luminance L, the bin has w·L: E = L Σ_k w[k] C[bin[k]].
    """

    bins: np.ndarray
    """Labels, shape (time, k); "" where fewer bins are blended."""
    weights: np.ndarray
    """0 where there is no bin, shape (time, k)."""

    @classmethod
    def own(cls, labels: np.ndarray) -> Blend:
        """Blend in which each time stamp has its own sun, or none where its label is ""."""
        return cls(labels.astype(object)[:, None], (labels != "").astype(float)[:, None])
