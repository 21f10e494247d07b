"""Panes of a state of the façade, as light paths of all its fills look them up.

Light paths know the entries of the glow tables of all fills, one table after another. The radiance
of a state is that of its own table; it is laid out by the entries that paths know, patch by patch
at the same place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.eye.openings import NO_OPENING, SeenOpenings
from drcmitsuba.rendering.glow import GlowTable
from drcmitsuba.runtime.flat_arrays import flat, flat_indices


@dataclass(frozen=True, eq=False)
class GlowLayout:
    """Entries of the tables of all fills."""

    entry: mi.UInt32
    """Entry of the state's table at the same place and in the same direction."""
    seen: mi.Float
    """1 where there is one, else 0: what rays of the eye see."""
    looked: mi.Float
    """Share with which it counts for surfaces that look at the panes of each fill."""

    @classmethod
    def of(
        cls, tables: Sequence[GlowTable], table: GlowTable, openings: SeenOpenings,
        by_fill: np.ndarray,
    ) -> GlowLayout:  # fmt: skip
        """Lay out the table of a state for the `tables` of all fills.

        `by_fill` are the shares of every fill by the number of the opening from 1 on, and of what
        is in none, (fill, 1 + opening).
        """
        entry, looked = [np.zeros(0, int)], [np.zeros(0)]
        for shares, own in zip(by_fill, tables, strict=True):
            entry.append(own.entries_in(table))
            looked.append(shares[own.opening_of_entries(openings) - NO_OPENING])
        known = np.concatenate(entry)
        exists = known >= 0
        return cls(
            flat_indices(np.where(exists, known, 0)), flat(exists),
            flat(exists * np.concatenate(looked)),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ViewGlow:
    """Table of the panes' radiance in a state, and how light paths look it up."""

    table: GlowTable
    layout: GlowLayout | None = None
    """None where light paths know the table's own entries."""

    def __len__(self) -> int:
        """Count the entries that light paths know."""
        return len(self.table) if self.layout is None else dr.width(self.layout.entry)

    def of_eye(self, values: mi.Float, each: int = 1) -> mi.Float:
        """Values of the table as rays of the eye see them, flat (replicate, entry, each)."""
        return values if self.layout is None else self._laid_out(values, each, self.layout.seen)

    def of_surfaces(self, values: mi.Float, each: int = 1) -> mi.Float:
        """Values as surfaces get them that look at panes, likewise."""
        return values if self.layout is None else self._laid_out(values, each, self.layout.looked)

    def _laid_out(self, values: mi.Float, each: int, share: mi.Float) -> mi.Float:
        """Values (replicate, entry of the table, each) by the entries of light paths."""
        assert self.layout is not None
        own, count = len(self.table), len(self)
        replicates = dr.width(values) // (own * each)
        lane, stride = dr.arange(mi.UInt32, replicates * count * each), dr.opaque(mi.UInt32, each)
        row, part = lane // stride, lane % stride
        many, few = (dr.opaque(mi.UInt32, n) for n in (count, own))
        replicate, entry = row // many, row % many
        at = replicate * few + dr.gather(mi.UInt32, self.layout.entry, entry)
        out = dr.gather(mi.Float, values, at * stride + part)
        out *= dr.gather(mi.Float, share, entry)
        dr.eval(out)
        return out
