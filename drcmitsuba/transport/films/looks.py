"""Directions from receivers to films, and their weights in the outgoing cells that they meet."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import first_of_rows
from drcmitsuba.transport.light.products import MOST_SINGLE, add_rows


class Directions(NamedTuple):
    """Directions from receivers to films, sorted by receiver."""

    receiver: mi.UInt32
    patch: mi.UInt32
    row: mi.UInt32
    """Outgoing cell of the direction back, counted within the patch's mount."""
    weight: mi.Float
    """cos θ / density [sr]."""


class Looked(NamedTuple):
    """Directions of two kinds from receivers to films, see `panes.transfer.looks`."""

    receivers: int
    rays: int
    """Number of directions of each kind from a receiver, seen or not."""
    kinds: tuple[Directions, ...]

    def of(self, patches: np.ndarray) -> Looked:
        """Keep the directions to some patches, a mask (patch,)."""
        if patches.all():
            return self
        wanted = mi.Bool(patches)
        kinds = []
        for kind in self.kinds:
            seen = dr.compress(dr.gather(mi.Bool, wanted, kind.patch))
            if dr.width(seen):
                kinds.append(Directions(*(dr.gather(type(x), x, seen) for x in kind)))
                dr.eval(*kinds[-1])
        return self._replace(kinds=tuple(kinds))

    def apart(self, parts: int) -> list[Looked]:
        """Directions of as many parts of the receivers, which stand one after another."""
        size, every = self.receivers // parts, []
        for part in range(parts):
            first, kinds = dr.opaque(mi.UInt32, part * size), []
            for kind in self.kinds:
                own = dr.compress((kind.receiver >= first) & (kind.receiver < first + size))
                if dr.width(own):
                    mine = Directions(*(dr.gather(type(x), x, own) for x in kind))
                    kinds.append(mine._replace(receiver=mine.receiver - first))
                    dr.eval(*kinds[-1])
            every.append(Looked(size, self.rays, tuple(kinds)))
        return every

    def by_row(self, rows: mi.UInt32, of: int) -> mi.TensorXf:
        """Sum of the weights [sr] of each receiver in some outgoing cells `of` all of them.

        The shape is (receiver, cell).
        """
        few, place = dr.width(rows), dr.zeros(mi.UInt32, of)
        dr.scatter(place, dr.arange(mi.UInt32, few), rows)
        kind_of_sums = mi.Float if self.rays <= MOST_SINGLE else mi.Float64
        out = dr.zeros(kind_of_sums, self.receivers * few)
        dr.make_opaque(place, out)  # loops that are being recorded read and add to them
        receiver = dr.arange(mi.UInt32, self.receivers)
        start = receiver * dr.opaque(mi.UInt32, few)
        for kind in self.kinds:
            first = first_of_rows(kind.receiver, self.receivers)
            at, end = (dr.gather(mi.UInt32, first, receiver + k) for k in (0, 1))
            add_rows(out, start, at, end, kind.row, kind.weight, place)
        return mi.TensorXf(mi.Float(out), (self.receivers, few))

    def rows_met(self, rows: int) -> mi.UInt32:
        """Outgoing cells, of a number of `rows`, in which any direction lies."""
        met = dr.zeros(mi.Bool, rows)
        for kind in self.kinds:
            dr.scatter(met, mi.Bool(True), kind.row)
        return dr.compress(met)
