"""View from one place of eyes, and the sums over its glare sources in any façade."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.eye.openings import SeenOpenings
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.luminance_noise import DIM
from drcmitsuba.glare_year.luminances import Luminances, PixelRows
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.seen import Seen, SeenSurfaces, seen
from drcmitsuba.glare_year.seen_ends import eye_paths
from drcmitsuba.glare_year.sources import bright_light, contrast_sums
from drcmitsuba.glare_year.surface_light import (
    LightRows,
    SurfacesByElement,
    Tracer,
    cuts,
    light_of_surfaces,
)
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import Daylight

LUMINANCES = 1 << 25
"""Largest number of luminances of pixels, or of points of several places, in hours at once."""


@dataclass(frozen=True, eq=False)
class PlaceInFacade:
    """View from one place in a façade, and its luminances."""

    views: np.ndarray
    """Indices of the views, int, shape (view,)."""
    known: Luminances

    def deviations(self, rule: Rule) -> np.ndarray:
        """Deviations of the sums of `sums` from their means by each replicate of C.

        Returns
        -------
        np.ndarray, shape (replicate, time, view)
        """
        known, least = self.known, max(rule.least, DIM)
        return known.surfaces.noise.of_sums(known.seen, known.shares, least)

    def sums(self, rule: Rule, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Σ L² ω / P² of the views at some time stamps, and that of peaks as sharp as suns.

        Where fills share an opening, the sum is that of the sources seen by each element, which
        count with its share.

        Returns
        -------
        by_file, sharp : np.ndarray, shape (time, view)
            Sums with film peaks as wide as the cells of their BSDF, and as wide as a sun's disk.
        """
        known, frames = self.known, self.known.seen.frames
        out = np.zeros((len(self.views), len(times)))
        tiles = known.seen.tiles.opened(rule.opening)
        for here in self._at_once(rule, times):
            hours = times[here]
            L = known.rows(hours)
            limit, parts = self._limit(L, frames, rule), [(1.0, L)]
            if not known.is_whole[hours[0]]:
                parts = [(known.shares[hours, e], known.rows(hours, e))
                         for e in known.elements(hours)]  # fmt: skip
            for share, part in parts:
                own = contrast_sums(part, tiles, frames, limit, rule.peak)
                out[:, here] += share * own
        out += self._of_suns(times, rule.least)
        return out.T, (out + self._sharp(times)).T

    def light(self, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
        """Light of all that is bright, in a façade of one fill in each opening.

        Returns
        -------
        light : np.ndarray, shape (5, view, time)
            As from `bright_light`.
        peaks : np.ndarray, shape (view, time)
            Σ L² ω / P² of peaks and suns [cd²/m⁴ sr].
        """
        known, times = self.known, np.arange(len(self.known.sky))
        tiles, frames = known.seen.tiles.opened(rule.opening), known.seen.frames
        light, peaks = np.zeros((5, len(frames), len(times))), self._of_suns(times, rule.least)
        for hours in self._at_once(rule, times):
            L = known.rows(hours)
            light[..., hours] = bright_light(L, tiles, self._limit(L, frames, rule), rule.peak)
            above = np.full(len(hours), rule.peak)
            peaks[:, hours] += contrast_sums(L, tiles, frames, above, np.inf)
        return light, peaks

    def _at_once(self, rule: Rule, times: np.ndarray) -> Iterator[np.ndarray]:
        """Positions of time stamps at which something may be bright, some of them at once.

        Those at which fills share openings come by themselves.
        """
        known, count = self.known, len(self.known.seen.directions)
        shining = known.may_exceed(rule.least)[times] & (len(known.seen.tiles) > 0)
        step, whole = max(64, LUMINANCES // max(1, count)), known.is_whole[times]
        for some in (np.flatnonzero(shining & whole), np.flatnonzero(shining & ~whole)):
            yield from (some[start : start + step] for start in range(0, len(some), step))

    def _limit(self, L: PixelRows, frames: np.ndarray, rule: Rule) -> np.ndarray:
        """Luminance above which a pixel is bright [cd/m²], (hour,) or (view, hour)."""
        if rule.least:
            return np.full(L.hours, rule.threshold)
        return rule.threshold * (_weights(self.known.seen, frames) @ L.luminance())

    @property
    def _suns(self) -> np.ndarray:
        """Luminance of every sun [cd/m²], shape (sun,)."""
        index, lit = self.known.sun_index, self.known.sun_index >= 0
        out = np.zeros(int(index.max(initial=-1)) + 1)
        out[index[lit]] = self.known.sun[lit]
        return out

    def _of_suns(self, times: np.ndarray, least: float) -> np.ndarray:
        """Σ L² ω / P² of the suns' disks, shape (view, time)."""
        images, L = self.known.seen.images, self._suns

        def by_sun(some: np.ndarray) -> np.ndarray:
            mine = images.take(some)
            shown = L[mine.sun] * mine.transmittance
            local = np.einsum("mi,vki->vmk", mine.direction, self.known.seen.frames)
            parts = shown**2 * mine.solid_angle / position_index(local) ** 2
            parts *= (local[..., 2] > 0) & (shown > least)
            return np.stack([np.bincount(mine.sun, values, len(L)) for values in parts])

        return self._weighed(self.known.seen.by_images, by_sun, times)

    def _sharp(self, times: np.ndarray) -> np.ndarray:
        """Growth of Σ L² ω / P² where peaks of films are as narrow as a sun, (view, time)."""
        seen, L = self.known.seen, self._suns

        def by_sun(some: np.ndarray) -> np.ndarray:
            narrow = np.maximum(seen.glow.sharpness[some] - 1, 0)
            peaks = seen.glow.suns[some].astype(float) ** 2 * narrow
            return np.asarray(seen.apparent[:, seen.films[some]] @ peaks * L**2)

        return self._weighed(seen.by_films, by_sun, times)

    def _weighed(
        self, elements: np.ndarray, by_sun: Callable[[np.ndarray], np.ndarray], times: np.ndarray
    ) -> np.ndarray:
        """Sums of what is seen by some elements (item,), with their shares, shape (view, time).

        `by_sun` gives the sums (view, sun) over some of the items, bool (item,).
        """
        known, index = self.known, self.known.sun_index[times]
        out = np.zeros((len(known.seen.frames), len(times)))
        for element in np.unique(elements).tolist():
            share, lit = known.shares[times, element], np.flatnonzero(index >= 0)
            if share.any() and len(lit):
                out[:, lit] += by_sun(elements == element)[:, index[lit]] * share[lit]
        return out


def _weights(shown: Seen, frames: np.ndarray) -> np.ndarray:
    """Share of each pixel in the mean luminance of each view, shape (view, pixel)."""
    ahead = frames[:, 2] @ shown.directions.T > 0
    omega = ahead * shown.tiles.by_pixel
    return np.asarray(omega / omega.sum(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class SeenPlace:
    """View from one place by every opening and fill."""

    views: np.ndarray
    """Indices of the views, int, shape (view,)."""
    seen: Seen
    light: SurfacesByElement
    sky: np.ndarray
    """Luminances of sky and sun, as of `Luminances`."""
    sun: np.ndarray
    sun_index: np.ndarray

    def in_facade(self, shares: np.ndarray) -> PlaceInFacade:
        """View in a façade of shares (time, element) of the openings."""
        shares = np.column_stack([shares, np.ones(len(self.sky))])
        lit = self.light.in_facade(shares)
        known = Luminances(self.seen, self.sky, self.sun, self.sun_index, lit, shares)
        return PlaceInFacade(self.views, known)

    @property
    def sources(self) -> list[int]:
        """Elements by which sky, films or suns are seen, `BESIDES` among them."""
        shown = self.seen
        return sorted({*shown.sky, *shown.by_films.tolist(), *shown.by_images.tolist()})

    def light_by(self, element: int, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
        """Light that is seen by the whole of one element alone, as from `PlaceInFacade.light`.

        Surfaces are left out.
        """
        times = len(self.sky)
        shares = np.zeros((times, max(self.seen.starts, default=0) + 1))
        shares[:, element] = 1
        none = self.light.of_points(np.full(len(self.seen.surfaces.points), -1)).in_facade(shares)
        known = Luminances(self.seen, self.sky, self.sun, self.sun_index, none, shares)
        return PlaceInFacade(self.views, known).light(rule)

    def of_sources(self, least: float) -> SeenPlace:
        """Place with only those tiles that may be brighter than `least` [cd/m²] at some hour."""
        shown, light = self.seen, self.light
        may = sum(part @ self.sky.max(axis=0, initial=0) for part in shown.sky.values()) > least
        may = np.array(np.broadcast_to(may, len(shown.directions)))
        may[shown.films] = True
        points = np.unique(light.point)
        may |= np.diff(shown.showing[:, points].tocsr().indptr) > 0
        ahead = np.maximum.reduceat(may[shown.tiles.pixel], shown.tiles.first[:-1])
        of_points = np.full(len(shown.surfaces.points), -1)
        of_points[points] = np.arange(len(points))
        kept = shown.of_tiles(ahead).with_points(points)
        return replace(self, seen=kept, light=light.of_points(of_points))


def seen_places(
    case: Case, scenes: Sequence[scene.Scene], openings: SeenOpenings | None, rows: LightRows,
    tracer: Tracer, light: Daylight, looking: Eyes, run: Run, *, least: float, coefficients: int,
) -> Iterator[SeenPlace]:  # fmt: skip
    """Trace what is seen from each place of the eyes, place by place.

    Parameters
    ----------
    case : Case
    scenes : sequence of Scene
        Scene with the first fill in every opening, with the second one, and so on.
    openings : SeenOpenings, optional
        Openings; without them there is one scene.
    rows : LightRows
    tracer : callable
        Traces the light of surfaces by these rows.
    light : Daylight
    looking : Eyes
    run : Run
    least : float
        Luminance that a glare source exceeds [cd/m²]; what is never so bright is left out. With 0
        everything is kept.
    coefficients : int
        Largest number of coefficients of surfaces in one replicate that are in memory at once;
        places whose surfaces fit in together share photons and the light on cells.

    Yields
    ------
    SeenPlace
    """
    sky, sources = light.sky, case.effects.sources
    patches, disks = sources.of_bins(sky["sky"].values), sources.sun * sky["sun"].values
    shining = np.flatnonzero(disks > 0)
    sun_index = np.full(sky.sizes["time"], -1)
    sun_index[shining] = np.arange(len(shining))
    suns = sky["sun_direction"].values[shining]
    channels = scene.channels_of(case, run.enabled_effects)
    diameter = case.outside.sun_diameter
    paths = [eye_paths(world, diameter, openings) for world in scenes]

    def shown(i: int, views: np.ndarray) -> Seen:
        return seen(
            paths, channels, looking.points[views[0]], looking.frames[views], suns, diameter,
            case.sky.subdivision, case_seed(run.seed, Stream.SEEN, i),
        )  # fmt: skip

    count = len(rows.elements)
    together = max(64, coefficients // (count * (len(light.suns.labels) + sky.sizes["bin"])))
    most = max(1, min(together, LUMINANCES // (count * sky.sizes["time"])))
    every = ((views, shown(i, views)) for i, views in enumerate(looking.by_place()))
    for group in _together(every, most):
        surfaces = SeenSurfaces.joined([place.surfaces for _, place in group])
        above = np.concatenate([cuts(place, least) for _, place in group])
        lit = light_of_surfaces(
            tracer, rows, surfaces, above, case.accuracy.replicates, min(most, together)
        )
        start = 0
        for views, place in group:
            own = np.full(len(above), -1)
            own[start : start + len(place.surfaces.points)] = np.arange(len(place.surfaces.points))
            start += len(place.surfaces.points)
            known = lit.of_points(own)
            made = SeenPlace(views, place, known, patches, disks, sun_index)
            yield made.of_sources(least) if least else made
    for world in scenes:
        run.ray_counter.update(world.ray_counter.counted())


def _together(
    places: Iterator[tuple[np.ndarray, Seen]], most: int
) -> Iterator[list[tuple[np.ndarray, Seen]]]:
    """Group places, one after another, whose surfaces have no more than some points in all."""
    group: list[tuple[np.ndarray, Seen]] = []
    points = 0
    for views, shown in places:
        count = len(shown.surfaces.points)
        if group and points + count > most:
            yield group
            group, points = [], 0
        group.append((views, shown))
        points += count
    if group:
        yield group
