"""Weighted sums of many arrays, with gradients by the weights."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.threads import in_threads, one_blas_thread

Rows = tuple[Any, ...]
"""Arrays (mi.Float) of equal length, one for each element."""
AT_ONCE = (64, 32, 16, 8, 4, 2, 1)
"""Numbers of arrays that one kernel reads: few, since each number is a kernel of its own."""


def mixed(arrays: Rows, weights: mi.Float) -> mi.Float:
    """Compute Σ weight · array in one pass over the arrays; gradients flow to the weights."""
    return dr.custom(_Mixed, lambda: arrays, weights)


class _Mixed(dr.CustomOp):
    """Weighted sum of arrays, whose derivative by a weight is a product of two arrays.

    A matrix product, or a loop over one long array, takes six times as long (Dr.Jit 1.5, LLVM), and
    sums of the products by Dr.Jit four times as long as those by BLAS.
    """

    def eval(self, arrays: Callable[[], Rows], weights: mi.Float) -> mi.Float:
        """Sum the arrays, which a function gives: nothing flows to them.

        Those of weight 0 are not read: the sum takes as long as memory takes to give the arrays.
        """
        self.arrays = arrays()
        used = np.flatnonzero(weights.numpy()).tolist()
        total = dr.zeros(mi.Float, dr.width(self.arrays[0]) if self.arrays else 1)
        while used:
            count = next(n for n in AT_ONCE if n <= len(used))
            some, used = used[:count], used[count:]
            own = dr.gather(mi.Float, weights, flat_indices(np.array(some)))
            for i, array in enumerate(self.arrays[k] for k in some):
                total += dr.gather(mi.Float, own, i) * array
            dr.eval(total)
        return total

    def forward(self) -> None:
        """Sum by the weights' derivatives."""
        self.set_grad_out(mixed(self.arrays, self.grad_in("weights")))

    def backward(self) -> None:
        """Multiply the derivative by every array."""
        slope = self.grad_out()
        if mi.variant().startswith("llvm"):
            own, arrays = slope.numpy(), [array.numpy() for array in self.arrays]
            products = np.zeros(len(arrays), np.float32)

            def multiply(i: int) -> None:
                products[i] = arrays[i] @ own

            with one_blas_thread():
                in_threads(multiply, range(len(products)))
            of_weights = flat(products)
        else:
            of_weights = dr.concat([dr.sum(slope * array) for array in self.arrays])
        self.set_grad_in("weights", of_weights)
