"""Luminances of what is seen from a place, in a façade whose fills are known.

The luminance of a pixel is a weighted sum of rows: those of surface points, of patches of ground
and sky by the shares of openings, and of films.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.glare_year.seen import Seen, sparse
from drcmitsuba.glare_year.surface_light import SurfaceLuminances
from drcmitsuba.runtime.flat_arrays import flat, flat_indices


@dataclass(frozen=True, eq=False)
class PixelRows:
    """Luminances of pixels as sums over rows."""

    pixel: np.ndarray
    """Pixel of every summand, in rising order, int, shape (summand,)."""
    row: np.ndarray
    """Its row, int, shape (summand,)."""
    weight: np.ndarray
    """Its weight [–], float32, shape (summand,)."""
    values: mi.Float
    """Luminances of the rows [cd/m²], flat (row, hour)."""
    pixels: int
    """Number of pixels."""
    hours: int
    """Number of hours."""

    def luminance(self) -> np.ndarray:
        """Luminances of the pixels [cd/m²], float32, shape (pixel, hour)."""
        rows = self.values.numpy().reshape(-1, self.hours)
        place = self.pixel, self.row
        return np.asarray(sparse.csr_array((self.weight, place), (self.pixels, len(rows))) @ rows)


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

    def at(self, hours: np.ndarray) -> np.ndarray:
        """Luminances in some hours, without the disks of the suns, float32, (pixel, hour)."""
        return self.rows(hours).luminance()

    def rows(self, hours: np.ndarray, only: int | None = None) -> PixelRows:
        """Luminances in some hours, without the disks of the suns.

        With `only` an element, it is what is seen by the whole of this one alone.
        """
        shares = self.shares[hours].astype(np.float32)
        if only is not None:
            shares = np.zeros_like(shares)
            shares[:, only] = 1
        seen, counts, points = self.seen, shares.any(axis=0), len(self.seen.surfaces.points)
        (pixel, point), weight = seen.showing.tocoo().coords, seen.showing.data
        shown = counts[seen.surfaces.element[point]]
        summands = [(pixel[shown], point[shown], weight[shown])]
        sky = np.ascontiguousarray(self.sky[hours].T, np.float32)
        blocks, row = [sky], points + len(sky)
        for element, part in seen.sky.items():
            if not counts[element]:
                continue
            start, share = points, shares[:, element]
            if not (share == 1).all():
                blocks.append(sky * share)
                start, row = row, row + len(sky)
            pixel, patch = part.tocoo().coords
            summands.append((pixel, start + patch, part.data))
        some = np.flatnonzero(counts[seen.by_films])
        if len(some):
            blocks.append(self._of_films(hours, shares, some))
            ones = np.ones(len(some), np.float32)
            summands.append((seen.films[some], row + np.arange(len(some)), ones))
        pixels, rows, weights = (np.concatenate(column) for column in zip(*summands, strict=True))
        order = np.argsort(pixels, kind="stable")
        values = self._with_surfaces(np.concatenate(blocks), hours, shares)
        size = len(seen.directions), len(hours)
        return PixelRows(pixels[order], rows[order], weights[order], values, *size)

    def _with_surfaces(self, others: np.ndarray, hours: np.ndarray, shares: np.ndarray) -> mi.Float:
        """Rows of the surface points, as far as elements show them, and others (row, hour)."""
        lit, count = self.surfaces, len(hours)
        points, elements = len(self.seen.surfaces.points), shares.shape[1]
        values = dr.zeros(mi.Float, (points + len(others)) * count)
        start = dr.opaque(mi.UInt32, points * count)
        dr.scatter(values, flat(others), start + dr.arange(mi.UInt32, others.size))
        if not len(lit.time):
            return values
        column = np.full(len(self.sky), count)
        column[hours] = np.arange(count)
        at = dr.gather(mi.UInt32, flat_indices(column), flat_indices(lit.time))
        point, width = flat_indices(lit.point), dr.opaque(mi.UInt32, count)
        by = dr.gather(mi.UInt32, flat_indices(self.seen.surfaces.element % elements), point)
        active = at < width
        share = dr.gather(mi.Float, flat(shares.T), by * width + at, active)
        dr.scatter(values, share * flat(lit.luminance), point * width + at, active)
        dr.eval(values)
        return values

    def _of_films(self, hours: np.ndarray, shares: np.ndarray, some: np.ndarray) -> np.ndarray:
        """Luminance of some films and rough mirrors that glow, shape (end, hour)."""
        seen, lit = self.seen, self.sun_index[hours] >= 0
        shining = seen.glow.sky[some] @ np.ascontiguousarray(self.sky[hours].T, np.float32)
        suns = seen.glow.suns[some][:, self.sun_index[hours][lit]]
        shining[:, lit] += suns * self.sun[hours][lit].astype(np.float32)
        return np.asarray(shining * shares[:, seen.by_films[some]].T)
