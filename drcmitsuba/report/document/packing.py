"""Arrays in a page: differences of neighbours, deflated, as text that browsers decompress.

A browser undoes it with `DecompressionStream("deflate")` and a running sum; bytes of equal weight
stand together, because the high ones hardly change.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

DARK = 1.0
"""Least illuminance that has a level [lx]; what is darker has level 0."""
STEPS = (0.02, 0.05, 0.1, 0.2)
"""Ratios by which neighbouring levels may differ, less 1; the error is half of it [–]."""

SAMPLE, SMALL = 8, 4096
"""Every nth row tells whether a scale may fit; the content of a small text tells little."""


class Packed(TypedDict):
    """Array as a page holds it."""

    bytes: int
    """Bytes of an entry: 1, 2 or 4."""
    row: int
    """Number of entries after which differences begin anew."""
    low: int
    """Number to add to every entry."""
    text: str
    """Deflated bytes in base 64."""


def packed(values: np.ndarray) -> Packed:
    """Pack whole numbers, exactly.

    Parameters
    ----------
    values : np.ndarray of int or bool, any shape
        Numbers that span less than 2³²; neighbours along the last axis should be alike.
    """
    whole = np.atleast_1d(np.asarray(values)).astype(np.int64)
    lowest, highest = (int(end) for end in (whole.min(initial=0), whole.max(initial=0)))
    low = lowest if lowest < 0 else 0
    if highest - low >= 1 << 32:  # as coordinates of a map in millimetres
        low = int(whole.min())
    whole -= low
    size = next(n for n in (1, 2, 4) if int(whole.max(initial=0)) < 1 << 8 * n)
    row = whole.shape[-1]
    differences = np.diff(whole, axis=-1, prepend=0).astype(f"<i{size}", casting="unsafe")
    planes = differences.reshape(-1, 1).view(np.uint8).T
    text = base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode("ascii")
    return {"bytes": size, "row": row, "low": low, "text": text}


def unpacked(array: Packed) -> np.ndarray:
    """Undo `packed`, shape (…, row), as the page's script does."""
    size = array["bytes"]
    planes = np.frombuffer(zlib.decompress(base64.b64decode(array["text"])), np.uint8)
    whole = np.ascontiguousarray(planes.reshape(size, -1).T).view(f"<u{size}")
    rows = np.cumsum(whole.reshape(-1, array["row"]), axis=1, dtype=whole.dtype)
    return np.asarray(rows.astype(np.int64) + array["low"])


@dataclass(frozen=True)
class Levels:
    """Illuminance on a logarithmic scale of levels."""

    light: Packed
    step: float
    """Ratio of neighbouring levels, less 1 [–]."""

    @property
    def error(self) -> float:
        """Largest relative error of an illuminance above 1 lx [–]."""
        return self.step / 2


def levels(illuminance: np.ndarray, most: int) -> Levels | None:
    """Pack illuminances with the finest scale that fits.

    Parameters
    ----------
    illuminance : np.ndarray, shape (time, sensor)
        E [lx].
    most : int
        Largest number of characters.

    Returns
    -------
    Levels or None
        Level n > 0 is DARK · (1 + step)ⁿ⁻¹ [lx]. None where no scale fits.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        decades = np.log(np.asarray(illuminance, np.float32) / DARK)

    def at(step: float, rows: slice) -> Packed:
        number = np.rint(decades[rows] / np.log1p(step)) + 1
        return packed(np.where(decades[rows] >= 0, number, 0))

    for step in STEPS:
        sample = slice(None, None, SAMPLE)
        if len(at(step, sample)["text"]) * SAMPLE > 1.2 * most + SMALL:
            continue
        light = at(step, slice(None))
        if len(light["text"]) <= most:
            return Levels(light, step)
    return None
