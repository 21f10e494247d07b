"""Straight light by any shares: of all pairs of a bin and a sensor few see each other by a tile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.transport.elements.straight_light import StraightLight

NO_MIRROR = 0xFFFFFFFF
"""In place of an element that mirrors light: none does."""


@dataclass(frozen=True)
class StraightPairs:
    """C by straight light of pairs of a bin and a sensor, once for each element that it passes."""

    element: mi.UInt32
    """Position of the element among the weights, shape (pair,)."""
    mirror: mi.UInt32
    """Position of the element that mirrors the light, `NO_MIRROR` for none."""
    place: mi.UInt32
    """Place of the pair in a flat array (bin, sensor)."""
    C: mi.Float
    """Mean over the results [sr]."""
    shape: tuple[int, int]
    """Numbers of bins and sensors."""
    lower: mi.Float | None = None
    upper: mi.Float | None = None
    """Heights between which light passes the element [m], shape (pair,); NaN where these are not
    asked for."""

    @classmethod
    def of(
        cls, lights: Mapping[tuple[int, int], tuple[np.ndarray, StraightLight]], bins: np.ndarray,
        sensors: int,
    ) -> StraightPairs:  # fmt: skip
        """Join the pairs of elements.

        Parameters
        ----------
        lights : dict of tuple to tuple
            Own bins (own bin,) of every element, and its light, by its position and that of the
            element that mirrors it, or `NO_MIRROR`.
        bins : np.ndarray of int, shape (bin,)
            Bins of the result in rising order, those of all pairs among them.
        sensors : int
        """
        parts = [(*(np.zeros(0, np.uint32),) * 3, np.zeros(0, np.float32))]
        for (number, mirror), (own, light) in lights.items():
            bin_, sensor = light.pairs
            at = np.searchsorted(bins, own)[bin_] * sensors + sensor
            both = np.full(len(at), number), np.full(len(at), mirror)
            parts.append((*both, at, light.C.mean(axis=0)))
        element, mirrors, place, C = map(np.concatenate, zip(*parts, strict=True))
        numbers = flat_indices(element), flat_indices(mirrors), flat_indices(place)
        return cls(*numbers, flat(C), (len(bins), sensors))

    def at(self, bins: np.ndarray) -> StraightPairs:
        """Pairs of some bins, positions in rising order, int, shape (bin,)."""
        own, sensor = np.divmod(self.place.numpy(), np.uint32(self.shape[1]))
        here = np.flatnonzero(np.isin(own, bins))
        place = np.searchsorted(bins, own[here]) * self.shape[1] + sensor[here]
        element, mirror = (each.numpy()[here] for each in (self.element, self.mirror))
        numbers = flat_indices(element), flat_indices(mirror), flat_indices(place)
        shape = len(bins), self.shape[1]
        C, *passed = (
            None if each is None else flat(each.numpy()[here])
            for each in (self.C, self.lower, self.upper)
        )
        return StraightPairs(*numbers, C, shape, *passed)

    def weighed(self, shares: mi.Float, factors: mi.Float) -> mi.Float:
        """Σ share · factor · C, flat (bin, sensor) [sr]; gradients flow to both.

        Light that an element mirrors has its share, too.
        """
        passed = dr.gather(mi.Float, shares * factors, self.element)
        return self.summed(passed * self._share_of_mirror(shares))

    def between(self, low: mi.Float, high: mi.Float, shares: mi.Float) -> mi.Float:
        """Part of the light of each pair that passes between two heights of its element [–].

        Parameters
        ----------
        low, high : mi.Float, shape (element,)
            Heights [m] of the elements whose pairs know where light passes.
        shares : mi.Float, shape (element,)
            Shares of all elements, which are those of other pairs.
        """
        mixed, mirrored = dr.gather(mi.Float, shares, self.element), self._share_of_mirror(shares)
        if self.lower is None or self.upper is None or not dr.width(self.element):
            return mixed * mirrored
        known = dr.isfinite(self.lower)
        bottom = dr.maximum(dr.gather(mi.Float, low, self.element, known), self.lower)
        top = dr.minimum(dr.gather(mi.Float, high, self.element, known), self.upper)
        part = dr.clip((top - bottom) / (self.upper - self.lower), 0, 1)
        return dr.select(known, part, mixed) * mirrored

    def _share_of_mirror(self, shares: mi.Float) -> mi.Float:
        """Share of the element that mirrors each pair's light; 1 where none does."""
        if not dr.width(self.mirror):
            return mi.Float()
        mirrored = self.mirror != NO_MIRROR
        return dr.select(mirrored, dr.gather(mi.Float, shares, self.mirror, mirrored), 1)

    def summed(self, weights: mi.Float) -> mi.Float:
        """Σ weight · C, flat (bin, sensor) [sr], by weights of pairs."""
        total = dr.zeros(mi.Float, self.shape[0] * self.shape[1])
        if dr.width(self.place):
            dr.scatter_add(total, self.C * weights, self.place)
        return total
