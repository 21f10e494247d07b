r"""Light of an element on sensors or cells, and what paths gather of that on cells.

A clear pane lights few receivers by each sun. A scattering pane lights all of them, by way of few
parts. So D is a sparse matrix of what comes straight, beside weights K of the parts of panes, which
meet the matrix G of paths before the light E of the parts:

.. math:: G D = G D_{straight} + \sum_{panes} (G K) E
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.transport.elements.marked_light import FULL
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.pane_light import Light

Matrix = Any
"""Matrix of SciPy or NumPy."""

sparse = lazy.module("scipy.sparse")


@dataclass(frozen=True)
class LightOnReceivers:
    """D of receivers in some replicates, before any diffuse reflection."""

    replicates: int
    apart: Irradiance
    """D [sr] but that of `panes`, shape (replicate · receiver, bin) each."""
    panes: tuple[tuple[mi.TensorXf, Light], ...] = ()
    """Weights K of parts of panes (replicate · receiver, part), and their light."""

    @cached_property
    def whole(self) -> Irradiance:
        """D with the light of panes [sr], shape (replicate · receiver, bin) each."""
        light = self.apart
        for K, parts in self.panes:
            light = light.plus(parts.through(K, self.replicates))
        dr.eval(light)
        return light

    @property
    def is_dark(self) -> bool:
        """Whether there is no light at all."""
        return not any(dr.width(_lit(part)) for part in self.whole)

    def less(self, other: LightOnReceivers, suns: np.ndarray) -> LightOnReceivers:
        """Subtract other light, whose suns of these numbers (sun,) are the suns of this one."""
        (sky, sun), theirs = self.whole, other.whole
        rest = Irradiance(sky - theirs.sky, sun - _columns(theirs.sun, flat_indices(suns)))
        return LightOnReceivers(self.replicates, rest)

    def add_to(
        self, outputs: Sequence[np.ndarray], draws: int, paths: Sequence[Matrix] | None = None
    ) -> None:
        """Add the light of these replicates to results, or what paths gather of it.

        Parameters
        ----------
        outputs : sequence of np.ndarray, shape (result, bin, receiver)
            Arrays of light that grow alike [sr]; what is not lit is not written to.
        draws : int
            Number of replicates whose mean is a result. Those of one result stand together; some
            of them may be elsewhere.
        paths : sequence of matrix, shape (receiver, further receiver), optional
            Matrix of the paths of every result.
        """
        results, bins = len(outputs[0]), self.apart.sky.shape[1]
        each = self.replicates // results
        for part, here in zip(self.apart, (slice(bins), slice(bins, None)), strict=True):
            for k, D in enumerate(_by_result(part, results, each, draws)):
                light = D if paths is None else D @ paths[k]
                for out in outputs:
                    _add(out[k, here], light)
        for K, parts in self.panes:
            weights = K.numpy().reshape(self.replicates, -1, K.shape[1]).transpose(0, 2, 1)
            if paths is not None:
                weights = np.stack([K @ paths[r // each] for r, K in enumerate(weights)])
            weights = (weights / np.float32(draws)).reshape(results, each, *weights.shape[1:])
            for k, light in enumerate(parts.by_bin(weights)):
                for out in outputs:
                    out[k] += light

    def entries(
        self, results: int, draws: int
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Yield the number of a result, and bins, receivers and light [sr] of what is lit in it.

        No light of panes is among it. `results` is their number, of `draws` replicates each, as for
        `add_to`; a result may come twice, with different bins.
        """
        each, first = self.replicates // results, 0
        for part in self.apart:
            for k, D in enumerate(_by_result(part, results, each, draws)):
                lit = sparse.coo_matrix(D)
                yield k, lit.row.astype(np.int64) + first, lit.col, lit.data
            first += part.shape[1]


def _by_result(D: mi.TensorXf, results: int, each: int, draws: int) -> Iterator[Matrix]:
    """Yield D (bin, receiver) of every result, of D (replicate · receiver, bin).

    It is the sum of `each` replicates over the number of `draws`, sparse where few entries are lit.
    """
    rows, bins = D.shape
    receivers, lit = rows // (results * each), _lit(D)
    if dr.width(lit) >= max(1, FULL * rows * bins):
        for of_result in D.numpy().reshape(results, each, receivers, bins):
            total = of_result[0] if each == 1 else of_result.sum(axis=0)
            yield (total if draws == 1 else total / np.float32(draws)).T
        return
    values = dr.gather(mi.Float, D.array, lit).numpy() / np.float32(draws)
    row, bin = np.divmod(lit.numpy(), np.uint32(max(1, bins)))
    ends = np.searchsorted(row, np.arange(results + 1) * each * receivers)
    for here in (slice(*pair) for pair in pairwise(ends)):
        place = bin[here], row[here] % np.uint32(receivers)
        yield sparse.csr_matrix((values[here], place), (bins, receivers))


def _lit(D: mi.TensorXf) -> mi.UInt32:
    """Entries with light."""
    return dr.compress(D.array != 0) if D.shape[0] * D.shape[1] else mi.UInt32()


def _add(light: np.ndarray, more: Matrix) -> None:
    """Add a matrix to light."""
    if isinstance(more, np.ndarray):
        light += more
    else:
        entries = more.tocoo()
        light[entries.row, entries.col] += entries.data


def _columns(values: mi.TensorXf, at: mi.UInt32) -> mi.TensorXf:
    """Some columns of a matrix."""
    rows, columns = values.shape[0], dr.width(at)
    if rows * columns == 0:
        return dr.zeros(mi.TensorXf, (rows, columns))
    few, many = (dr.opaque(mi.UInt32, n) for n in (columns, values.shape[1]))
    entry = dr.arange(mi.UInt32, rows * columns)
    column = dr.gather(mi.UInt32, at, entry % few)
    return mi.TensorXf(
        dr.gather(mi.Float, values.array, entry // few * many + column), (rows, columns)
    )
