"""Sums of a film's answers over the directions from a receiver to it."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import row_and_column

WIDE = 4
"""Number of bins that are read at once."""


def widened(table: mi.Float, columns: int) -> mi.Float:
    """Table (row, column) whose columns are filled up with zeros to a multiple of `WIDE`."""
    if columns % WIDE == 0:
        dr.eval(table)
        return table
    few, many = dr.opaque(mi.UInt32, columns), -(-columns // WIDE) * WIDE
    entry = dr.arange(mi.UInt32, dr.width(table) // columns * many)
    row, column = row_and_column(entry, many)
    out = dr.gather(mi.Float, table, row * few + column, column < few)
    dr.eval(out)
    return out


@symbolic
def summed(
    first: mi.UInt32, weight: mi.Float, row: mi.UInt32, table: mi.Float,
    patch: mi.UInt32 | None, shone: mi.Float | None, bins: int,
) -> mi.Float:  # fmt: skip
    """Σ weight · table[row, bin] (· shone[patch, bin]) over the entries of every receiver.

    `WIDE` bins are read at once, of tables from `widened`.
    """
    wide = -(-bins // WIDE)
    lane = dr.arange(mi.UInt32, (dr.width(first) - 1) * wide)
    count = dr.opaque(mi.UInt32, wide)
    receiver, column = row_and_column(lane, wide)
    at = dr.gather(mi.UInt32, first, receiver)
    end = dr.gather(mi.UInt32, first, receiver + 1)
    total = mi.Vector4d(0)
    while dr.hint(at < end, exclude=[first, weight, row, table, patch, shone, count]):
        value = dr.gather(mi.Vector4f, table, dr.gather(mi.UInt32, row, at) * count + column)
        value *= dr.gather(mi.Float, weight, at)
        if dr.hint(shone is not None, mode="scalar"):
            of_patch = dr.gather(mi.UInt32, patch, at) * count + column
            value *= dr.gather(mi.Vector4f, shone, of_patch)
        total += mi.Vector4d(value)
        at += 1
    values = dr.ravel(mi.Vector4f(total))
    dr.eval(values)
    entry = dr.arange(mi.UInt32, (dr.width(first) - 1) * bins)
    receiver, bin = row_and_column(entry, bins)
    return dr.gather(mi.Float, values, receiver * dr.opaque(mi.UInt32, WIDE * wide) + bin)
