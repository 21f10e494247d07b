"""Irradiance D of receivers by sky, ground and suns of unit radiance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.transport.light.products import by_replicate


class Irradiance(NamedTuple):
    """D [sr] of receivers: by ground and sky patches (receiver, bin), by suns (receiver, sun)."""

    sky: mi.TensorXf
    sun: mi.TensorXf

    def plus(self, other: Irradiance | None) -> Irradiance:
        """Sum of two irradiances; None adds nothing."""
        return self if other is None else Irradiance(self.sky + other.sky, self.sun + other.sun)

    def through(self, weights: mi.TensorXf, replicates: int) -> Irradiance:
        """Light that receivers get, by their weights (replicate · receiver, part) of this light."""
        return Irradiance(*(by_replicate(weights, part, replicates) for part in self))

    def by_bin(self, weights: np.ndarray) -> Iterator[np.ndarray]:
        """Yield sums (bin, receiver) of this light over the replicates of each result.

        `weights` are those of the light for receivers, (result, replicate, part, receiver).
        """
        results, each, parts, receivers = weights.shape
        every = self.numpy().reshape(results, each * parts, -1)
        W = weights.reshape(results, each * parts, receivers)  # there may be no receivers
        return (light.T @ of_light for light, of_light in zip(every, W, strict=True))

    def numpy(self) -> np.ndarray:
        """All bins in one array (receiver, bin)."""
        return np.concatenate([self.sky.numpy(), self.sun.numpy()], axis=1)


def under(D: mi.TensorXf, L: np.ndarray) -> mi.TensorXf:
    """Irradiance (receiver, 1) [lx] by D (receiver, bin) [sr] and luminances L (bin,) [cd/m²]."""
    if D.shape[1] == 0:
        return dr.zeros(mi.TensorXf, (D.shape[0], 1))
    return D @ mi.TensorXf(flat(L), (len(L), 1))
