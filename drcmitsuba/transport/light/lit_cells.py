"""Cells that get light, and bins that send it: products leave out all others.

A sun lights few cells, and its neighbours in the sky much the same ones. Tiles of neighbouring bins
therefore have products of their own, of the cells that they light.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat_indices, row_and_column


class Tile(NamedTuple):
    """Bins that light much the same cells."""

    bins: mi.UInt32
    lit: mi.UInt32
    """Places of the cells with light among all `LitCells.lit`."""


class LitCells(NamedTuple):
    """Where D has light."""

    lit: mi.UInt32
    """Cells that get light from any bin."""
    shining: mi.UInt32
    """Bins that reach any cell; with tiles, all bins of a tile that does."""
    tiles: tuple[Tile, ...] = ()
    """Parts of the shining bins, where their cells are told apart."""

    @classmethod
    def by(cls, d: mi.TensorXf, replicates: int = 1, tiles: Sequence[np.ndarray] = ()) -> LitCells:
        """Find the lit cells and the shining bins of D (replicate · cell, bin).

        `tiles` hold the indices of neighbouring bins; without them, all bins are apart.
        """
        rows, bins = d.shape
        entry = dr.compress(d.array > 0) if rows * bins else mi.UInt32()
        if not dr.width(entry):
            return cls(mi.UInt32(), mi.UInt32())
        cells = rows // replicates
        row, bin = row_and_column(entry, bins)
        _, cell = row_and_column(row, cells)
        if len(tiles) > 1:
            return cls._of_tiles(cell, bin, cells, tiles)
        lit, shining = dr.zeros(mi.Bool, cells), dr.zeros(mi.Bool, bins)
        dr.scatter(lit, mi.Bool(True), cell)
        dr.scatter(shining, mi.Bool(True), bin)
        dr.eval(lit, shining)
        return cls(dr.compress(lit), dr.compress(shining))

    @classmethod
    def _of_tiles(
        cls, cell: mi.UInt32, bin: mi.UInt32, cells: int, tiles: Sequence[np.ndarray]
    ) -> LitCells:
        tile_of = np.empty(sum(map(len, tiles)), np.uint32)
        for i, bins in enumerate(tiles):
            tile_of[bins] = i
        tile = dr.gather(mi.UInt32, flat_indices(tile_of), bin)
        of_tile = dr.zeros(mi.Bool, len(tiles) * cells)
        dr.scatter(of_tile, mi.Bool(True), tile * dr.opaque(mi.UInt32, cells) + cell)
        is_lit = of_tile.numpy().reshape(-1, cells)
        lit = np.flatnonzero(is_lit.any(axis=0))
        parts = [
            (bins, np.flatnonzero(own)) for bins, own in zip(tiles, is_lit[:, lit], strict=True)
        ]
        some = [(bins, places) for bins, places in parts if len(places)]
        shining = np.sort(np.concatenate([np.zeros(0, int), *(bins for bins, _ in some)]))
        every = tuple(Tile(*map(flat_indices, part)) for part in some)
        return cls(flat_indices(lit), flat_indices(shining), every)
