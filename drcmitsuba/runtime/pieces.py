"""Pieces of arrays that stay in a core's cache, and views in place of copies."""

from __future__ import annotations

import numpy as np

CACHED = 1 << 15
"""Numbers of a piece: arrays of it, of four bytes each, fit several times into a core's cache."""


def pieces(rows: int, width: int) -> list[slice]:
    """Cut so many rows of an array, each of `width` numbers, into pieces of some rows."""
    step = max(1, CACHED // max(1, width))
    return [slice(start, min(start + step, rows)) for start in range(0, rows, step)]


def run(places: np.ndarray) -> slice | np.ndarray:
    """Places in rising order, as a slice, which makes no copy, where none is left out."""
    if len(places) == 0:
        return slice(0, 0)
    first, last = int(places[0]), int(places[-1])
    return slice(first, last + 1) if last - first + 1 == len(places) else places
