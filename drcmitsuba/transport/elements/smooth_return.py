r"""Light that openings send back, as a function of the shares of fills, with derivatives.

On paths, G_m(w) is a sum over those that met openings. Where light between surfaces is solved on
cells (see `solved_paths`), light on the blocks D becomes that of the sensors by

.. math:: G_m(w) = \big( g(w) + A \, t(w) \big) \big( 1 + O + O^2 + … \big), \qquad O = B \, t(w)

with g and t the rays from sensors and from blocks that meet openings, A and B what sensors and
blocks get, after all bounces, of the light that openings send to blocks: `onto` and `back` of
`solved_paths.SolvedReturn`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.paths import SentBack
from drcmitsuba.transport.elements.solved_paths import SolvedReturn

POWERS = 3
"""Power of O up to which light is sent back: products with it cost little beside those with D."""


class _WeighedRays(NamedTuple):
    """Rays that met openings, of which a matrix (block, receiver) is the sum."""

    entry: mi.UInt32
    """Entry of every ray in the matrix."""
    met: tuple[mi.UInt32, ...]
    """Elements that every ray met; the number of all elements stands for none."""
    passed: mi.UInt32
    """Element through which each ray went, likewise."""
    weight: mi.Float
    shape: tuple[int, int]

    @classmethod
    def of(cls, marked: MarkedLight, elements: int) -> _WeighedRays:
        """Rays of a result."""
        receivers, blocks = marked.shape
        entry = marked.block.astype(np.int64) * receivers + marked.sensor
        met = np.where(marked.met < 0, elements, marked.met).T
        return cls(
            flat_indices(entry), tuple(map(flat_indices, met)),
            flat_indices(marked.passed(elements)), flat(marked.weight), (blocks, receivers),
        )  # fmt: skip

    def weighed(self, shares: mi.Float64, factors: mi.Float64) -> mi.TensorXf:
        """Matrix by shares and factors of what passes elements, (element + 1,) each.

        It is summed in double precision since a gradient is a sum, too.
        """
        weight = mi.Float64(self.weight) * dr.gather(mi.Float64, factors, self.passed)
        for element in self.met:
            weight *= dr.gather(mi.Float64, shares, element)
        blocks, receivers = self.shape
        G = dr.zeros(mi.Float64, blocks * receivers)
        dr.scatter_add(G, weight, self.entry)
        return mi.TensorXf(mi.Float(G), self.shape)


class _Cells(NamedTuple):
    """Light between blocks of cells."""

    rays: _WeighedRays
    """t, shape (target, block)."""
    onto: mi.TensorXf
    """A, shape (block, sensor)."""
    back: mi.TensorXf
    """B, shape (block, target)."""


@dataclass(frozen=True)
class SmoothReturn:
    """Light that openings send back, the mean of all results."""

    rays: _WeighedRays
    """g, or all of G_m on paths, shape (block, sensor)."""
    cells: _Cells | None = None
    """Light between cells where it is solved."""

    @classmethod
    def of(cls, returned: Sequence[SentBack], elements: int) -> SmoothReturn:
        """Average what comes back in all results, by so many elements."""
        on_cells = [each for each in returned if isinstance(each, SolvedReturn)]
        if not on_cells:
            paths = [each for each in returned if isinstance(each, MarkedLight)]
            return cls(_WeighedRays.of(MarkedLight.mean(paths), elements))
        rays, between = (
            _WeighedRays.of(MarkedLight.mean([getattr(each, name) for each in on_cells]), elements)
            for name in ("sensors", "between")
        )
        onto, back = (
            np.mean([getattr(each, name).T for each in on_cells], axis=0, dtype=np.float32)
            for name in ("onto", "back")
        )
        return cls(rays, _Cells(between, mi.TensorXf(onto), mi.TensorXf(back)))

    def added(self, C: mi.Float, D: mi.Float, shares: mi.Float, factors: mi.Float) -> mi.Float:
        """Add to C what comes back of D, flat (bin, sensor), (bin, block), by shares of elements.

        Shares, and factors of light that passes elements, as from surfaces outside, are
        (element + 1,); gradients flow through all.
        """
        blocks, _ = self.rays.shape
        if not blocks or (self.cells is None and not dr.width(self.rays.weight)):
            return C
        light = mi.TensorXf(D, (dr.width(D) // blocks, blocks))
        return C + (light @ self._weighed(mi.Float64(shares), mi.Float64(factors))).array

    def _weighed(self, shares: mi.Float64, factors: mi.Float64) -> mi.TensorXf:
        """G_m, shape (block, sensor)."""
        G = self.rays.weighed(shares, factors)
        if self.cells is None:
            return G
        t = self.cells.rays.weighed(shares, factors)
        first = G = G + t @ self.cells.onto
        once = t @ self.cells.back
        for _ in range(POWERS):
            G = first + once @ G
        return G
