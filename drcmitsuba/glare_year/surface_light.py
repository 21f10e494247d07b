"""Luminance of the surfaces that eyes see, by the element whose light they get.

Points that are dim at all hours, whatever fills there are, can neither be sources nor make noise:
they get but the `FIRST` replicates. Of those that are known to be no part of a source, nothing is
kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np

from drcmitsuba.glare_year.luminance_noise import DIM, LuminanceNoise
from drcmitsuba.glare_year.seen import Seen, SeenSurfaces
from drcmitsuba.transport.elements.weights import BESIDES

FIRST = 2
"""Number of replicates that tell which points of surfaces are bright at any hour."""
NEARLY = 0.75
"""Luminance of the first replicates that counts as bright, over that of a source."""
POINTS = 128
"""Number of points whose luminances by each replicate are in memory at once."""


class TracedSurfaces(Protocol):
    """Luminances of points by element, in some replicates."""

    def mean(self) -> np.ndarray:
        """Mean over the replicates [cd/m²], shape (row, point, time)."""

    def each(self, points: np.ndarray) -> np.ndarray:
        """Luminance of some points by each replicate [cd/m²], (row, replicate, point, time)."""


Tracer = Callable[[SeenSurfaces, int, bool], TracedSurfaces]
"""Traces the light of surfaces in some replicates, the further ones or the first."""


@dataclass(frozen=True)
class LightRows:
    """Elements whose light is told apart, and which of them exclude one another."""

    elements: tuple[int, ...] = (BESIDES,)
    """Element of every row, `BESIDES` first."""
    openings: tuple[slice, ...] = ()
    """Rows of the fills of each opening."""

    @classmethod
    def of(cls, starts: Sequence[int]) -> LightRows:
        """Rows of openings of several fills; what has one fill is beside them."""
        elements, openings = [BESIDES], []
        for first, end in pairwise(starts):
            if end - first > 1:
                openings.append(slice(len(elements), len(elements) + end - first))
                elements += range(first, end)
        return cls(tuple(elements), tuple(openings))

    def most(self, L: np.ndarray) -> np.ndarray:
        """Luminance that no façade exceeds [cd/m²], (…), by that of every row (row, …)."""
        return L[0] + sum(L[rows].max(axis=0) for rows in self.openings)


@dataclass(frozen=True, eq=False)
class SurfaceLuminances:
    """Luminances of surfaces in a façade."""

    point: np.ndarray
    """Surface point of every luminance that is known, int, shape (entry,)."""
    time: np.ndarray
    """Its time stamp, int, shape (entry,)."""
    luminance: np.ndarray
    """[cd/m²], shape (entry,); of all other points and hours it is too low to count."""
    light: SurfacesByElement
    """Light of the surfaces by element, from which the luminances are summed."""
    shares: np.ndarray
    """Shares of the elements, as of `SurfacesByElement.in_facade`."""

    @cached_property
    def noise(self) -> LuminanceNoise:
        """Noise of those that are bright."""
        return self.light.noise(self.shares, self.luminance)


@dataclass(frozen=True, eq=False)
class SurfacesByElement:
    """Luminances of surfaces by the element whose light they get."""

    rows: LightRows
    point: np.ndarray
    """As of `SurfaceLuminances`, in the order of `time`."""
    time: np.ndarray
    luminance: np.ndarray
    """Mean by every row [cd/m²], float32, shape (row, entry)."""
    noisy: np.ndarray
    """Entries whose noise is known, int, shape (bright,)."""
    deviation: np.ndarray
    """Their luminance by each replicate, less the mean [cd/m²], (row, replicate, bright)."""

    @classmethod
    def joined(cls, parts: Sequence[SurfacesByElement]) -> SurfacesByElement:
        """Light of several sets of points."""
        ends = np.cumsum([0, *(len(part.point) for part in parts)])
        noisy = np.concatenate(
            [part.noisy + start for part, start in zip(parts, ends, strict=False)]
        )
        time = np.concatenate([part.time for part in parts])
        by_time, place = np.argsort(time, kind="stable"), np.empty(len(time), int)
        place[by_time] = np.arange(len(time))
        in_turn = np.argsort(place[noisy])
        return cls(
            parts[0].rows,
            np.concatenate([part.point for part in parts])[by_time],
            time[by_time],
            np.concatenate([part.luminance for part in parts], axis=1).take(by_time, axis=1),
            place[noisy][in_turn],
            np.concatenate([part.deviation for part in parts], axis=2).take(in_turn, axis=2),
        )

    def of_points(self, number: np.ndarray) -> SurfacesByElement:
        """Light of some points, by their new numbers (point,), −1 for all others."""
        mine = number[self.point] >= 0
        place = np.cumsum(mine) - 1
        noisy = mine[self.noisy]
        return replace(
            self, point=number[self.point[mine]], time=self.time[mine],
            luminance=self.luminance.compress(mine, axis=1), noisy=place[self.noisy[noisy]],
            deviation=self.deviation.compress(noisy, axis=2),
        )  # fmt: skip

    def in_facade(self, shares: np.ndarray) -> SurfaceLuminances:
        """Luminances with shares (time, element + 1), the last of which is 1."""
        light = self._weighed(shares, self.time, self.luminance)
        return SurfaceLuminances(self.point, self.time, light, self, shares)

    def noise(self, shares: np.ndarray, light: np.ndarray) -> LuminanceNoise:
        """Noise of bright entries, whose luminances are `light` (entry,) with these shares."""
        some = np.flatnonzero(light.take(self.noisy) > DIM)
        bright = self.noisy.take(some)
        time = self.time.take(bright)
        deviation = self._weighed(shares, time, self.deviation, some)
        return LuminanceNoise(self.point.take(bright), time, light.take(bright), deviation)

    def _weighed(
        self, shares: np.ndarray, time: np.ndarray, values: np.ndarray,
        some: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Σ over the rows of values (row, …, entry), or of some entries, whose shares count."""
        out = values[0].copy() if some is None else values[0].take(some, axis=-1)
        for element, of_row in zip(self.rows.elements[1:], values[1:], strict=True):
            share = shares[:, element]
            if share.any():
                part = of_row if some is None else of_row.take(some, axis=-1)
                out += part if (share == 1).all() else share[time].astype(np.float32) * part
        return np.asarray(out)


def cuts(shown: Seen, least: float) -> np.ndarray:
    """Luminance that a ray's points have to exceed together to be in a source [cd/m²], (point,).

    It is `NEARLY` that of a bright pixel, where these points are all that their pixels show in a
    façade; else 0.
    """
    showing = shown.showing.tocoo()
    pixel, point = showing.coords
    pixels, elements, rays = [pixel], [shown.surfaces.element[point]], [shown.surfaces.ray[point]]
    others = [(shown.films, shown.by_films)]
    for element, part in shown.sky.items():
        bright = np.flatnonzero(np.diff(part.indptr))
        others.append((bright, np.full(len(bright), element)))
    for i, (own, of_own) in enumerate(others, 1):
        pixels.append(own)
        elements.append(of_own)
        rays.append(np.full(len(own), -i))
    ends = np.stack([np.concatenate(column) for column in (pixels, elements, rays)])
    several = ~_alone(ends, shown.starts, len(shown.directions))
    return np.where(shown.showing.T @ several > 0, 0.0, NEARLY * least)


def _alone(ends: np.ndarray, starts: tuple[int, ...], pixels: int) -> np.ndarray:
    """Whether pixels show what one ray met in every façade, bool (pixel,).

    `ends` are rows of pixels, elements and rays, each (end,).
    """
    of_element = np.unique(ends, axis=1)
    pairs, rays = np.unique(of_element[:2], axis=1, return_counts=True)
    several = np.bincount(pairs[0], rays > 1, pixels) > 0
    opening = np.searchsorted(starts, pairs[1], side="right")
    openings = np.unique(np.stack([pairs[0], opening]), axis=1)
    return ~several & (np.bincount(openings[0], minlength=pixels) <= 1)


def light_of_surfaces(
    tracer: Tracer, rows: LightRows, surfaces: SeenSurfaces, least: np.ndarray, replicates: int,
    together: int,
) -> SurfacesByElement:  # fmt: skip
    """Trace the light of surfaces.

    Parameters
    ----------
    tracer : callable
    rows : LightRows
        Rows that the tracer tells apart.
    surfaces : SeenSurfaces
    least : np.ndarray, shape (point,)
        Luminance up to which nothing of a ray's points is kept [cd/m²], from `cuts`.
    replicates : int
        Number of replicates of bright points.
    together : int
        Number of points that are traced at once.
    """
    first = FIRST if replicates - FIRST >= 2 else replicates
    count, rest = len(rows.elements), replicates - first
    nothing = np.zeros(0, int)
    parts = [
        SurfacesByElement(
            rows, nothing, nothing, np.zeros((count, 0), np.float32), nothing,
            np.zeros((count, replicates, 0), np.float32),
        )
    ]  # fmt: skip
    for some in _of_whole_rays(surfaces.ray, together):
        own = surfaces.take(some)
        traced = tracer(own, first, False)
        L = traced.mean()
        most = rows.most(L)
        counts = _of_rays(most, own.ray) > least[some, None]
        bright = np.flatnonzero((most > DIM / 2).any(axis=1))
        size = together if rest <= first else max(1, together * first // rest)
        for begin in range(0, len(bright), size):
            points = bright[begin : begin + size]
            further = tracer(own.take(points), rest, True) if rest else None
            for k in range(0, len(points), POINTS):
                here = points[k : k + POINTS]
                each = traced.each(here)
                if further is not None:
                    others = further.each(np.arange(k, k + len(here)))
                    each = np.concatenate([each, others], axis=1)
                    L[:, here] = each.mean(axis=1)
                parts.append(_entries(rows, L[:, here], some.start + here, counts[here], each))
        dim = np.setdiff1d(np.arange(len(own.points)), bright)
        none = np.zeros((count, replicates, 0, L.shape[2]), np.float32)
        parts.append(_entries(rows, L[:, dim], some.start + dim, counts[dim], none))
    return SurfacesByElement.joined(parts)


def _of_whole_rays(ray: np.ndarray, together: int) -> Iterator[slice]:
    """Yield points of whole rays (point,), about so many together."""
    ends = np.append(np.flatnonzero(np.diff(ray)) + 1, len(ray))
    start = 0
    while start < len(ray):
        following = ends[ends > start]
        fit = following[following <= start + together]
        end = int(fit[-1] if len(fit) else following[0])
        yield slice(start, end)
        start = end


def _of_rays(values: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Sum over the points that each point's ray (point,) met of values (point, time)."""
    if not len(ray):
        return values
    first = np.flatnonzero(np.r_[True, np.diff(ray) != 0])
    number = np.cumsum(np.r_[0, np.diff(ray) != 0])
    return np.asarray(np.add.reduceat(values, first, axis=0)[number])


def _entries(
    rows: LightRows, L: np.ndarray, points: np.ndarray, counts: np.ndarray, each: np.ndarray
) -> SurfacesByElement:
    """Light of some points where it `counts` (point, time): L (row, point, time), by replicates.

    Points that are dim have none of these.
    """
    at, time = np.nonzero(counts)
    noisy = np.flatnonzero(rows.most(L)[at, time] > DIM) if each.shape[2] else np.zeros(0, int)
    deviation = np.zeros((*each.shape[:2], 0), np.float32)
    if len(noisy):
        deviation = each[:, :, at[noisy], time[noisy]]
        deviation = deviation - deviation.mean(axis=1, keepdims=True)
    return SurfacesByElement(rows, points[at], time, L[:, at, time], noisy, deviation)
