"""One state of the façade: illuminance at the eyes, and what is seen from each of their places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import of_points
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.luminance_noise import DIM, POINTS, LuminanceNoise
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.seen import Luminances, Seen, SeenSurfaces, seen
from drcmitsuba.glare_year.sources import contrast_sums
from drcmitsuba.metrics import accumulate
from drcmitsuba.picture.glare import LARGEST_FACTOR
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.scene import scene
from drcmitsuba.schema import by_luminance
from drcmitsuba.sky.daylight import Daylight

COEFFICIENTS = 20 << 20
"""Largest number of coefficients of surfaces in one replicate that are in memory at once.

Places whose surfaces fit in together share photons and the light on cells.
"""
SKY_RAYS = 512
"""Largest number of rays to the sky of a surface's point in a replicate: many make a source."""
SUN_SAMPLES = 2
"""Largest number of directions in each replicate from a surface to a sun that an edge crosses, or
that a mirror shows: a tile stands for a piece of the surface, of which it knows one point."""
FIRST = 2
"""Number of replicates that tell which points of surfaces are bright at any hour."""
LUMINANCES = 1 << 25
"""Largest number of luminances of pixels, or of points of several places, in hours at once."""


@dataclass(frozen=True, eq=False)
class PlaceInState:
    """View from one place in one state of the façade, and its luminances."""

    views: np.ndarray
    """Indices of the views, int, shape (view,)."""
    known: Luminances
    noise: LuminanceNoise

    def deviations(self, eyes: Eyes, rule: Rule) -> np.ndarray:
        """Deviations of the sums of `sums` from their means by each replicate of C.

        Returns
        -------
        np.ndarray, shape (replicate, time, view)
        """
        least = max(self._least(rule), DIM)
        return self.noise.of_sums(self.known, eyes.frames[self.views], least)

    def sums(self, eyes: Eyes, rule: Rule, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Σ L² ω / P² of the views at some time stamps, and that of peaks as sharp as suns.

        Returns
        -------
        by_file, sharp : np.ndarray, shape (time, view)
            Sums with film peaks as wide as the cells of their BSDF, and as wide as a sun's disk.
        """
        frames = eyes.frames[self.views]
        tiles = self.known.seen.tiles
        if tiles.opening != rule.opening:
            tiles = replace(tiles, opening=rule.opening)
        out = np.zeros((len(self.views), len(times)))
        weights = _weights(self.known.seen, frames)
        shining = np.flatnonzero(self.known.largest[times] > self._least(rule))
        step = max(64, LUMINANCES // len(self.known.seen.tiles.rays))
        for start in range(0, len(shining), step):
            here = shining[start : start + step]
            hours = times[here]
            L = self.known.at(hours)
            if rule.threshold > LARGEST_FACTOR:
                limit = np.full(len(hours), rule.threshold)
            else:
                limit = rule.threshold * (weights @ L)
            out[:, here] = contrast_sums(L, tiles, frames, limit, rule.peak)
        out += self._of_suns(frames, times, self._least(rule))
        return out.T, (out + self._sharp(frames, times)).T

    @staticmethod
    def _least(rule: Rule) -> float:
        """Luminance below which nothing is bright, whatever the mean [cd/m²]."""
        return rule.threshold if rule.threshold > LARGEST_FACTOR else 0.0

    def _of_suns(self, frames: np.ndarray, times: np.ndarray, least: float) -> np.ndarray:
        """Σ L² ω / P² of the suns' disks, shape (view, time)."""
        known, images = self.known, self.known.seen.images
        by_sun = np.zeros((len(frames), int(known.sun_index.max(initial=-1)) + 1))
        index = known.sun_index[times]
        L = np.zeros(by_sun.shape[1])
        L[index[index >= 0]] = known.sun[times][index >= 0]
        shown = L[images.sun] * images.transmittance
        local = np.einsum("mi,vki->vmk", images.direction, frames)
        parts = shown**2 * images.solid_angle / position_index(local) ** 2
        parts *= (local[..., 2] > 0) & (shown > least)
        for row, values in zip(by_sun, parts, strict=True):
            row += np.bincount(images.sun, values, len(row))
        return (
            np.where(index >= 0, by_sun[:, index], 0)
            if by_sun.size
            else np.zeros((len(frames), len(times)))
        )

    def _sharp(self, frames: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Growth of Σ L² ω / P² where peaks of films are as narrow as a sun, (view, time)."""
        known, seen = self.known, self.known.seen
        index = known.sun_index[times]
        if not len(seen.films) or not seen.glow.suns.size:
            return np.zeros((len(frames), len(times)))
        local = np.einsum("pi,vki->vpk", seen.directions[seen.films], frames)
        weight = seen.tiles.by_pixel[seen.films] / position_index(local) ** 2
        weight *= local[..., 2] > 0
        narrow = np.maximum(seen.glow.sharpness - 1, 0)
        by_sun = weight @ (seen.glow.suns.astype(float) ** 2 * narrow)
        return np.where(index >= 0, by_sun[:, index] * known.sun[times] ** 2, 0)


def _weights(shown: Seen, frames: np.ndarray) -> np.ndarray:
    """Share of each pixel in the mean luminance of each view, shape (view, pixel)."""
    ahead = frames[:, 2] @ shown.directions.T > 0
    omega = ahead * shown.tiles.by_pixel
    return np.asarray(omega / omega.sum(axis=1, keepdims=True))


def at_eyes(case: Case, state: State, light: Daylight, looking: Eyes, run: Run) -> np.ndarray:
    """Vertical illuminance at the eyes by each replicate of C [lx], (replicate, time, view).

    Eyes are few and turned to one side each: paths of all bounces cost them no more than cells,
    which lend the light of one side of a room to the other by as much as the noise that is left.
    """
    paths = replace(run, enabled_effects=replace(run.enabled_effects, solved_cells=False))
    with run.timed(f"eyes, {state}") as done:
        C = of_points(
            case, state, light.suns, light.sky.attrs["latitude"], looking.points, looking.forward,
            run=paths, progress=done,
        )  # fmt: skip
        return accumulate.replicates(by_luminance(C), light.sky, np.arange(len(looking)))


def places(
    case: Case, state: State, light: Daylight, looking: Eyes, run: Run
) -> Iterator[PlaceInState]:
    """Trace what is seen from each place in one state of the façade, place by place.

    Parameters
    ----------
    case : Case
    state : str
        State of the façade, see `case.groups`.
    light : Daylight
    looking : Eyes
    run : Run

    Yields
    ------
    Place
        Its arrays take 10 to 60 kB for every time stamp, the most where it looks at films.
    """
    effects, sky = run.enabled_effects, light.sky
    shining = np.flatnonzero(sky["sun"].values > 0)
    sun_index = np.full(sky.sizes["time"], -1)
    sun_index[shining] = np.arange(len(shining))
    suns = sky["sun_direction"].values[shining]
    channels = scene.channels_of(case, effects)
    world = scene.load(case, state, -1, effects)
    every = (
        (views, seen(
            world, channels, looking.points[views[0]], looking.forward[views], suns,
            case.outside.sun_diameter, case.sky.subdivision, run.seed + i,
        ))
        for i, views in enumerate(looking.by_place())
    )  # fmt: skip
    most = COEFFICIENTS // (len(light.suns.labels) + sky.sizes["bin"])
    most = min(most, LUMINANCES // sky.sizes["time"])
    for together in _together(every, most):
        surfaces = SeenSurfaces.joined([shown.surfaces for _, shown in together])
        L, noise = _of_surfaces(case, state, light, surfaces, run)
        start = 0
        for views, shown in together:
            here = slice(start, start + len(shown.surfaces.points))
            known = Luminances(shown, sky["sky"].values, sky["sun"].values, sun_index, L[here])
            yield PlaceInState(views, known, noise.of_points(here))
            start = here.stop
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


def _of_surfaces(
    case: Case, state: State, light: Daylight, surfaces: SeenSurfaces, run: Run
) -> tuple[np.ndarray, LuminanceNoise]:
    """Luminance of the surfaces of places [cd/m²], float32, (point, time), and its noise.

    Points that are dim at all hours can neither be sources nor make noise: they get but the `FIRST`
    replicates.
    """
    sky, replicates = light.sky, case.accuracy.replicates
    out = np.zeros((len(surfaces.points), sky.sizes["time"]), np.float32)
    noise = []
    bins = len(light.suns.labels) + sky.sizes["bin"]
    first = FIRST if replicates - FIRST >= 2 else replicates
    step = max(64, COEFFICIENTS // bins)
    again = replace(run, seed=case_seed(run.seed, Stream.BRIGHT_SURFACES))
    for start in range(0, len(surfaces.points), step):
        some = surfaces.take(slice(start, start + step))
        C = _coefficients(case, state, light, some, run, first)
        mean = C["replicates"].mean("replicate", skipna=False).expand_dims("replicate")
        C_mean = C.drop_vars("replicates").assign(replicates=mean)
        L = _luminances(C_mean, sky, some, np.arange(len(some.points)))[0]
        out[start : start + step] = L
        bright = np.flatnonzero((L > DIM / 2).any(axis=1))
        further, brighter = None, some.take(bright)
        if first < replicates and len(bright):
            rest = replicates - first
            further = _coefficients(case, state, light, brighter, again, rest)
        for begin in range(0, len(bright), POINTS):
            points = bright[begin : begin + POINTS]
            each = _luminances(C, sky, some, points)
            if further is not None:
                among = np.arange(begin, begin + len(points))
                others = _luminances(further, sky, brighter, among)
                each = np.concatenate([each, others])
                out[start + points] = each.mean(axis=0)
            point, time = np.nonzero(out[start + points] > DIM)
            deviation = each[:, point, time] - each[:, point, time].mean(axis=0)
            noise.append(LuminanceNoise(start + points[point], time, deviation))
    return out, LuminanceNoise.joined(noise, replicates)


def _coefficients(
    case: Case, state: State, light: Daylight, surfaces: SeenSurfaces, run: Run, replicates: int
) -> xr.Dataset:
    """C of surfaces in some replicates, with less effort for a point than sensors have."""
    accuracy = case.accuracy
    fewer = {
        "replicates": replicates,
        "sensor_sky_rays": min(SKY_RAYS, accuracy.sensor_sky_rays),
        "sensor_sun_samples": min(SUN_SAMPLES, accuracy.sensor_sun_samples),
        "mirrored_sun_samples": 0,  # of faint mirrors, not to every sun
    }
    coarser = case.with_tables(accuracy=accuracy.model_copy(update=fewer))
    alone = replace(run, shared=None)  # these points are of this call alone
    latitude = light.sky.attrs["latitude"]
    return of_points(
        coarser, state, light.suns, latitude, surfaces.points, surfaces.normals, run=alone
    )


def _luminances(
    C: xr.Dataset, sky: xr.Dataset, surfaces: SeenSurfaces, points: np.ndarray
) -> np.ndarray:
    """Luminance of some points by each replicate of C [cd/m²], shape (replicate, point, time)."""
    channels = (
        [C.isel(channel=k) for k in range(C.sizes["channel"])] if "channel" in C.dims else [C]
    )
    E = np.stack([accumulate.replicates(one, sky, points) for one in channels])
    taken = surfaces.take(points)
    return np.stack([taken.luminance(E[:, r].swapaxes(1, 2)) for r in range(E.shape[1])])
