"""Pairs of elements, of which one mirrors into the room what comes in by the other.

A pair is lit with the product of the shares of its elements, as a path that meets two openings.
Light that two elements mirror in turn is left out, and so are a film's narrow peaks in glass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.model import areas
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.materials import is_mirroring_glass, lets_through
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.transport.mirrors.mirror_planes import COPLANAR

MOST_PAIRS = 256
"""Largest number of pairs, those of the largest and nearest panes; the others are left out."""


@dataclass(frozen=True)
class MirroredPairs:
    """Elements that mirror light, and those by which it comes in."""

    mirrors: tuple[int, ...] = ()
    passed: tuple[int, ...] = ()
    """Number of the mirroring element of every pair, and of the one that light passes."""
    left_out: int = 0
    """Number of pairs beyond `MOST_PAIRS`, or beyond what memory holds."""
    sizes: tuple[float, ...] = field(default=(), compare=False)
    """Size of every pair [m²], by which its light goes."""

    @classmethod
    def of(cls, panes: Sequence[GroupedPanes], first: Sequence[int]) -> MirroredPairs:
        """Find the pairs.

        Parameters
        ----------
        panes : sequence of GroupedPanes
        first : sequence of int, shape (opening,)
            First element of every opening.
        """
        found: dict[tuple[int, int], float] = {}
        for mirror, lit in product(panes, panes):
            if not _faces(mirror.quads, lit.quads):
                continue
            size = _size(mirror.quads, lit.quads)
            for (m, glass), (k, fill) in product(
                enumerate(mirror.materials), enumerate(lit.materials)
            ):
                # An opening has one fill at a time; its shares are those of fills side by side.
                if mirror.group == lit.group and m != k:
                    continue
                if is_mirroring_glass(glass) and _passes(fill):
                    pair = first[mirror.group] + m, first[lit.group] + k
                    found[pair] = found.get(pair, 0.0) + size
        mirrors, passed = zip(*sorted(found), strict=True) if found else ((), ())
        sizes = tuple(round(found[pair], 6) for pair in sorted(found))
        every = cls(mirrors, passed, sizes=sizes)
        return every.at(every.largest(MOST_PAIRS))

    def largest(self, most: int) -> list[int]:
        """Positions of at most so many pairs, those of the largest and nearest panes.

        They are all pairs of equal panes or none: else a search would favour some of its tiles.
        """
        falling = sorted(self.sizes, reverse=True)
        least = falling[most] if len(falling) > most else 0.0
        return [k for k, size in enumerate(self.sizes) if size > least]

    def at(self, places: Sequence[int]) -> MirroredPairs:
        """Pairs at some positions; the others are left out."""
        mirrors, passed, sizes = (
            tuple(self.mirrors[k] for k in places),
            tuple(self.passed[k] for k in places),
            tuple(self.sizes[k] for k in places),
        )
        return MirroredPairs(mirrors, passed, self.left_out + len(self) - len(places), sizes)

    def __len__(self) -> int:
        """Count the pairs."""
        return len(self.mirrors)

    def joined(self, shares: np.ndarray) -> np.ndarray:
        """Shares (…, element) of all elements, followed by those of the pairs."""
        if not len(self):
            return shares
        of_pairs = shares[..., list(self.mirrors)] * shares[..., list(self.passed)]
        return np.concatenate([shares, of_pairs], axis=-1)


def _size(mirror: np.ndarray, lit: np.ndarray) -> float:
    """Areas of panes over the square of the distance of their centres [m²], as light goes."""
    apart = mirror.mean(axis=(0, 1)) - lit.mean(axis=(0, 1))
    return float(areas(mirror).sum() * areas(lit).sum() / max(float(apart @ apart), 1e-6))


def _passes(fill: SurfaceMaterial | None) -> bool:
    return fill is None or isinstance(fill, DiffuserMaterial | BsdfMaterial) or lets_through(fill)


def _faces(mirror: np.ndarray, lit: np.ndarray) -> bool:
    """Whether light by some of the quads `lit` may reach the front of some of another opening."""
    n, m = normals(mirror), normals(lit)
    p, q = mirror.reshape(-1, 3), lit.reshape(-1, 3)
    before_mirror = np.einsum("qi,pi->qp", n, q) - np.einsum("qi,qi->q", n, mirror[:, 0])[:, None]
    before_lit = np.einsum("qi,pi->qp", m, p) - np.einsum("qi,qi->q", m, lit[:, 0])[:, None]
    seen = (before_mirror.reshape(len(n), -1, 4) > COPLANAR).any(axis=2)
    shown = (before_lit.reshape(len(m), -1, 4) > COPLANAR).any(axis=2)
    return bool((seen & shown.T).any())
