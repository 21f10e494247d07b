"""Luminances of what is seen from a place, in a façade whose fills are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drcmitsuba.glare_year.seen import Seen, sparse
from drcmitsuba.glare_year.surface_light import SurfaceLuminances


@dataclass(frozen=True, eq=False)
class Luminances:
    """Luminances of the pixels of a place in the hours of a year."""

    seen: Seen
    sky: np.ndarray
    """Luminance of ground and sky patches [cd/m²], shape (time, bin)."""
    sun: np.ndarray
    """Luminance of the sun [cd/m²], shape (time,)."""
    sun_index: np.ndarray
    """Index of the time stamp's sun among the suns of `seen`, −1 without one, int, (time,)."""
    surfaces: SurfaceLuminances
    shares: np.ndarray
    """Share of its opening that every element takes, and 1 last, of what is seen by none [–],
    shape (time, element + 1)."""

    def may_exceed(self, least: float) -> np.ndarray:
        """Whether a pixel may be brighter than a luminance [cd/m²] at each time, bool (time,)."""
        if len(self.seen.films):
            return np.asarray(self.sky.any(axis=1) | (self.sun > 0))
        ends, lit = np.diff(self.seen.showing.indptr).max(initial=1), self.surfaces
        bright = lit.time[lit.luminance > least / 2 / max(1, ends)]
        of_surfaces = np.bincount(bright, minlength=len(self.sky)) > 0
        return np.asarray((self.sky.max(axis=1) > least / 2) | of_surfaces)

    @cached_property
    def is_whole(self) -> np.ndarray:
        """Whether one fill takes each opening whole, bool, shape (time,)."""
        return np.asarray(((self.shares == 0) | (self.shares == 1)).all(axis=1))

    def elements(self, hours: np.ndarray) -> list[int]:
        """Elements with a share in some hours, `BESIDES` last."""
        some = np.flatnonzero(self.shares[hours].any(axis=0))
        return np.where(some == self.shares.shape[1] - 1, -1, some).tolist()

    def at(self, hours: np.ndarray, only: int | None = None) -> np.ndarray:
        """Luminances in some hours, without the disks of the suns, float32, (pixel, hour).

        With `only` an element, it is what is seen by the whole of this one alone.
        """
        shares = self.shares[hours].astype(np.float32)
        if only is not None:
            shares = np.zeros_like(shares)
            shares[:, only] = 1
        return self._of_sky(hours, shares) + self._of_surfaces(hours, shares) + self._of_films(
            hours, shares
        )  # fmt: skip

    def _of_sky(self, hours: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Luminance of ground and sky behind the panes."""
        sky, always = np.ascontiguousarray(self.sky[hours].T, np.float32), []
        out = np.zeros((len(self.seen.directions), len(hours)), np.float32)
        for element, part in self.seen.sky.items():
            share = shares[:, element]
            if (share == 1).all():
                always.append(part)
            elif share.any():
                some = np.flatnonzero(share)
                out[:, some] += part @ np.ascontiguousarray(sky[:, some] * share[some])
        if always:
            out += sum(always[1:], always[0]) @ sky
        return out

    def _of_surfaces(self, hours: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Luminance of surfaces."""
        lit, surfaces = self.surfaces, self.seen.surfaces
        column = np.full(len(self.sky), -1)
        column[hours] = np.arange(len(hours))
        at = column[lit.time]
        here = np.flatnonzero(at >= 0)
        point, at = lit.point[here], at[here]
        L = np.zeros((len(surfaces.points), len(hours)), np.float32)
        L[point, at] = lit.luminance[here] * shares[at, surfaces.element[point]]
        return np.asarray(self.seen.showing @ L)

    def _of_films(self, hours: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Luminance of films and rough mirrors that glow."""
        seen, lit = self.seen, self.sun_index[hours] >= 0
        shape = len(seen.directions), len(hours)
        some = np.flatnonzero(shares[:, seen.by_films].any(axis=0))
        if not len(some):
            return np.zeros(shape, np.float32)
        shining = seen.glow.sky[some] @ np.ascontiguousarray(self.sky[hours].T, np.float32)
        suns = seen.glow.suns[some][:, self.sun_index[hours][lit]]
        shining[:, lit] += suns * self.sun[hours][lit].astype(np.float32)
        shining *= shares[:, seen.by_films[some]].T
        ones, place = np.ones(len(some), np.float32), (seen.films[some], np.arange(len(some)))
        return np.asarray(sparse.csr_array((ones, place), (shape[0], len(some))) @ shining)
