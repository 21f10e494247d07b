"""View from one place: what its pixels show by every opening and fill, and images of the suns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index

from drcmitsuba.eye.ends import EndRows
from drcmitsuba.eye.paths import EyePaths
from drcmitsuba.glare_year.films import FilmGlow, glow
from drcmitsuba.glare_year.pixels import FINER, EyeRays, merged, rays
from drcmitsuba.glare_year.seen_ends import seen_ends
from drcmitsuba.glare_year.suns import Images, images, shows_by_chance
from drcmitsuba.glare_year.tiles import EyeTiles
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.schema import channel_weights
from drcmitsuba.transport.elements.weights import BESIDES

sparse = lazy.module("scipy.sparse")

FAINT = 0.3
"""Weight up to which what is seen outside, in a pane that mirrors it, may stand for a tile [–]."""
LIFT = 1e-3
"""Distance of a point from its surface [m]."""


@dataclass(frozen=True, eq=False)
class SeenSurfaces:
    """Points of diffuse surfaces that are seen; their luminance is the weighted illuminance."""

    points: np.ndarray
    """Places, off their surface [m], shape (point, 3)."""
    normals: np.ndarray
    """Unit normals, shape (point, 3)."""
    weight: np.ndarray
    """Luminance over illuminance [1/sr], shape (point, channel)."""
    element: np.ndarray
    """Element by which each point is seen, or `BESIDES`, int, shape (point,)."""
    ray: np.ndarray
    """Number of the ray that met each point: what one ray met in one trace is seen together, and
    its points follow one another, int, shape (point,)."""

    @classmethod
    def joined(cls, parts: Sequence[SeenSurfaces]) -> SeenSurfaces:
        """Points of several places or traces, whose rays are told apart."""
        first = np.cumsum([0, *(part.ray.max(initial=-1) + 1 for part in parts)])
        apart = [
            replace(part, ray=part.ray + start) for part, start in zip(parts, first, strict=False)
        ]
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, name) for part in apart]) for name in names))

    def take(self, some: slice | np.ndarray) -> SeenSurfaces:
        """Some of the points."""
        return SeenSurfaces(*(getattr(self, name)[some] for name in self.__dataclass_fields__))

    def luminance(self, E: np.ndarray) -> np.ndarray:
        """Luminance of the points [cd/m²], (point, time), by E (channel, point, time) [lx]."""
        shares = channel_weights(len(E))
        weights = self.weight.astype(np.float32).T
        return sum(share * w[:, None] * e for share, w, e in zip(shares, weights, E, strict=True))


@dataclass(frozen=True, eq=False)
class Seen:
    """View from one place, without the illuminance of the surfaces in it.

    An element is an opening with one of its fills; what is seen by none is `BESIDES`. Everything
    that is seen counts with the share that its element takes of its opening.
    """

    frames: np.ndarray
    """Unit vectors to the right, up and forward of the views, shape (view, 3, 3)."""
    tiles: EyeTiles
    directions: np.ndarray
    """Unit vectors to the pixels, shape (pixel, 3)."""
    sky: Mapping[int, Any]
    """Luminance per unit luminance of ground and sky patches, by element, csr array (pixel, bin)
    [–]."""
    surfaces: SeenSurfaces
    showing: Any
    """1 where a pixel shows a surface point, csr array (pixel, point)."""
    films: np.ndarray
    """Pixels of the rows of `glow`, int, shape (end,)."""
    by_films: np.ndarray
    """Element of each of these rows, int, shape (end,)."""
    glow: FilmGlow
    images: Images
    by_images: np.ndarray
    """Element of every image, int, shape (image,)."""
    starts: tuple[int, ...]
    """First element of every opening, and last the number of all."""
    again: float
    """Sum of the weights of ends beyond two openings, over the number of rays [–]."""

    @cached_property
    def apparent(self) -> np.ndarray:
        """ω / P² of the pixels before each view [sr], shape (view, pixel)."""
        local = np.einsum("pi,vki->vpk", self.directions, self.frames)
        before = local[..., 2] > 0
        return np.asarray(before * self.tiles.by_pixel / position_index(local) ** 2)

    @cached_property
    def of_points(self) -> np.ndarray:
        """ω / P² of the pixels that show each surface point [sr], shape (point, view)."""
        return np.asarray(self.showing.T @ self.apparent.T)

    def of_tiles(self, kept: np.ndarray) -> Seen:
        """View of some tiles, bool (tile,)."""
        tiles, pixels = self.tiles.take(kept)
        number = np.full(len(self.directions), -1)
        number[pixels] = np.arange(len(pixels))
        films = number[self.films] >= 0
        glow = FilmGlow(*(getattr(self.glow, n)[films] for n in FilmGlow.__dataclass_fields__))
        return replace(
            self, tiles=tiles, directions=self.directions[pixels],
            sky={element: part[pixels] for element, part in self.sky.items()},
            showing=self.showing[pixels], films=number[self.films[films]],
            by_films=self.by_films[films], glow=glow,
        )  # fmt: skip

    def with_points(self, kept: np.ndarray) -> Seen:
        """View of some of the surface points, by their indices (point,)."""
        showing = self.showing[:, kept].tocsr()
        return replace(self, surfaces=self.surfaces.take(kept), showing=showing)


@dataclass(frozen=True, eq=False)
class _Trace:
    """Ends of the rays of an eye with one fill in all openings."""

    paths: EyePaths
    elements: np.ndarray
    """Element of every opening, and `BESIDES` last, int, shape (opening + 1,)."""
    outside: EndRows
    films: EndRows
    surfaces: EndRows

    @classmethod
    def of(
        cls, paths: EyePaths, fill: int, place: np.ndarray, directions: np.ndarray,
        channels: tuple[int, ...], seed: int,
    ) -> _Trace:  # fmt: skip
        """Trace rays with one fill; further fills tell nothing new of what is seen by none."""
        openings = paths.openings
        elements = np.array([BESIDES]) if openings is None else openings.elements(fill)
        found = seen_ends(
            paths, place, directions, seed=launch_seed(seed, Stream.EYE_PATHS), samples=FINER**2,
            channels=channels,
        )  # fmt: skip
        every = found.outside, found.glowing, found.surfaces
        trace = cls(paths, elements, *every)
        kept = (ends.take(trace.counts(ends.opening, fill)) for ends in every)
        return cls(paths, elements, *kept)

    def counts(self, opening: np.ndarray, fill: int) -> np.ndarray:
        """Whether ends that are seen by an opening count in the trace of a fill, bool."""
        element = self.elements[opening]
        return (element >= 0) | (element == BESIDES if fill == 0 else False)

    def alone(self, count: int) -> np.ndarray:
        """Whether rays may stand for others of their tile, as they show surfaces, bool (ray,)."""
        out = np.ones(count, bool)
        out[self.outside.ray[self.outside.weight > FAINT]] = out[self.films.ray] = False
        return out

    def surfaces_of(
        self, sent: EyeRays, kept: np.ndarray, channels: int
    ) -> tuple[SeenSurfaces, Any]:
        """Points of surfaces, one for the rays of a tile that meet the same; `Seen.showing`.

        `kept` (pixel,) are the rays of the pixels.
        """
        count = len(sent.directions)
        key = np.where(self.alone(count), _keys([self.surfaces], count), -1)
        standing = merged(sent.tile, key, sent.directions)[kept]
        is_met = np.zeros(count, bool)
        is_met[standing] = True
        ends = self.surfaces.take(is_met[self.surfaces.ray])
        points, pixels = len(ends.ray), len(kept)
        rows = _ones(ends.ray, np.arange(points), (count, points))
        showing = _ones(np.arange(pixels), standing, (pixels, count))
        weight = ends.weight.reshape(-1, channels) / np.pi
        return SeenSurfaces(
            ends.point + LIFT * ends.normal, ends.normal, weight, self.elements[ends.opening],
            ends.ray,
        ), showing @ rows  # fmt: skip

    def outside_of(self, kept: np.ndarray) -> _Trace:
        """Ends outside of the rays of pixels alone."""
        return replace(self, outside=self.outside.take(np.isin(self.outside.ray, kept)))


def seen(
    paths: Sequence[EyePaths], channels: tuple[int, ...], place: np.ndarray, frames: np.ndarray,
    suns: np.ndarray, diameter: float, subdivision: int, seed: int,
) -> Seen:  # fmt: skip
    """Trace what is seen from a place.

    Parameters
    ----------
    paths : sequence of EyePaths
        Those with the first fill in every opening, with the second one, and so on; one where there
        are no openings.
    channels : tuple of int
        Colour channels of the case.
    place : np.ndarray, shape (3,)
        Place of the eye [m].
    frames : np.ndarray, shape (view, 3, 3)
        Unit vectors to the right, up and forward of the views.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    subdivision : int
        Reinhart's factor MF of the sky.
    seed : int
    """
    forward, openings = frames[:, 2], paths[0].openings
    sent = rays(forward)
    count = len(sent.directions)
    traces = [
        _Trace.of(each, fill, place, sent.directions, channels, seed)
        for fill, each in enumerate(paths)
    ]
    alone = np.all([t.alone(count) for t in traces], axis=0)
    key = np.where(alone, _keys([t.surfaces for t in traces], count), -1)
    ray = merged(sent.tile, key, sent.directions)
    kept, pixel = np.unique(ray, return_inverse=True)
    again = sum(_again(ends) for t in traces for ends in (t.outside, t.films, t.surfaces))
    at = np.searchsorted(kept, np.arange(count)).clip(max=len(kept) - 1)
    first = np.flatnonzero(np.r_[True, np.diff(sent.tile) > 0, True])
    tiles = EyeTiles(first, sent.directions, pixel.ravel(), sent.solid_angle, forward)
    surfaces = [t.surfaces_of(sent, kept, len(channels)) for t in traces]
    traces = [t.outside_of(kept) for t in traces]
    glows = [glow(t.paths.scene, t.films, suns, diameter, subdivision, seed) for t in traces]
    shown = []
    for fill, t in enumerate(traces):
        mirroring = np.unique(sent.tile[t.outside.ray[shows_by_chance(t.outside)]])
        own = images(t.paths, place, mirroring, suns, diameter, seed)
        shown.append(own.take(t.counts(own.opening, fill)))
    by_images = [t.elements[own.opening] for t, own in zip(traces, shown, strict=True)]
    return Seen(
        frames, tiles, sent.directions[kept], _of_sky(traces, at, len(kept), subdivision),
        SeenSurfaces.joined([points for points, _ in surfaces]),
        sparse.hstack([showing for _, showing in surfaces]).tocsr(),
        np.concatenate([at[t.films.ray] for t in traces]),
        np.concatenate([t.elements[t.films.opening] for t in traces]), FilmGlow.joined(glows),
        Images.joined(shown), np.concatenate(by_images),
        () if openings is None else openings.starts, float(again) / count,
    )  # fmt: skip


def _ones(row: np.ndarray, column: np.ndarray, shape: tuple[int, int]) -> Any:
    """Matrix with 1 at some places, csr array."""
    return sparse.csr_array((np.ones(len(row), np.float32), (row, column)), shape)


def _keys(surfaces: Sequence[EndRows], count: int) -> np.ndarray:
    """Number of what each ray ends at in all traces, parts and sides in turn, int, (ray,)."""
    rows = []
    for fill, ends in enumerate(surfaces):
        of_fill = np.full(len(ends.ray), fill)
        rows.append(np.column_stack([of_fill, ends.part, ends.opening, ends.normal.round(1)]))
    side = np.unique(np.concatenate(rows), axis=0, return_inverse=True)[1].ravel() + 1
    ray = np.concatenate([ends.ray for ends in surfaces])
    by_ray = np.argsort(ray, kind="stable")
    ray, side = ray[by_ray], side[by_ray]
    before = np.r_[0, np.flatnonzero(np.diff(ray)) + 1] if len(side) else np.zeros(0, int)
    order = np.arange(len(side)) - np.repeat(before, np.diff(np.r_[before, len(side)]))
    by_turn = np.zeros((count, order.max(initial=0) + 1), int)
    by_turn[ray, order] = side
    return np.unique(by_turn, axis=0, return_inverse=True)[1].ravel()


def _again(ends: EndRows) -> float:
    """Sum of the weights of ends that are seen by two openings in turn [–]."""
    weight = ends.weight[ends.again]
    return float(weight.sum() / max(1, weight.shape[-1] if weight.ndim > 1 else 1))


def _of_sky(traces: Sequence[_Trace], at: np.ndarray, pixels: int, subdivision: int) -> dict:
    """Share of each bin's luminance that each pixel has by element, csr arrays (pixel, bin)."""
    shape, by_element = (pixels, len(Patches(subdivision))), {}
    for trace in traces:
        outside = trace.outside
        d = mi.Vector3f(*(flat(outside.direction[:, k]) for k in range(3)))
        bins = patch_index(d, subdivision).numpy() if len(outside.ray) else np.zeros(0, int)
        element, weight = trace.elements[outside.opening], outside.weight.astype(np.float32)
        for e in np.unique(element).tolist():
            mine = element == e
            place = at[outside.ray[mine]], bins[mine]
            by_element[e] = sparse.csr_array((weight[mine], place), shape)
    return by_element
