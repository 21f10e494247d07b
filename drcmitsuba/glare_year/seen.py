"""View from one place: luminances of its pixels in every hour, and images of the suns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index

from drcmitsuba.glare_year.chains import TURNED, Chains, Ends
from drcmitsuba.glare_year.films import FilmGlow, glow
from drcmitsuba.glare_year.pixels import merged, rays
from drcmitsuba.glare_year.suns import Images, images
from drcmitsuba.glare_year.tiles import EyeTiles
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.scene import Scene
from drcmitsuba.schema import channel_weights

sparse = lazy.module("scipy.sparse")

FAINT = 0.3
"""Weight up to which what is seen outside, in a pane that mirrors it, may stand for a tile [–]."""
LIFT = 1e-3
"""Distance of a point from its surface [m]."""


@dataclass(frozen=True, eq=False)
class SeenSurfaces:
    """Points of diffuse surfaces that are seen; their luminance is the weighted illuminance."""

    pixel: np.ndarray
    """Pixel of every point, int, shape (point,)."""
    points: np.ndarray
    """Places, off their surface [m], shape (point, 3)."""
    normals: np.ndarray
    """Unit normals, shape (point, 3)."""
    weight: np.ndarray
    """Luminance over illuminance [1/sr], shape (point, channel)."""

    @classmethod
    def joined(cls, parts: list[SeenSurfaces]) -> SeenSurfaces:
        """Points of several places; their pixels remain those of each place."""
        columns = ("pixel", "points", "normals", "weight")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))

    def take(self, some: slice | np.ndarray) -> SeenSurfaces:
        """Some of the points."""
        return SeenSurfaces(
            self.pixel[some], self.points[some], self.normals[some], self.weight[some]
        )

    def luminance(self, E: np.ndarray) -> np.ndarray:
        """Luminance of the points [cd/m²], (point, time), by E (channel, point, time) [lx]."""
        shares = channel_weights(len(E))
        weights = self.weight.astype(np.float32).T
        return sum(share * w[:, None] * e for share, w, e in zip(shares, weights, E, strict=True))


@dataclass(frozen=True, eq=False)
class Seen:
    """View from one place, without the illuminance of the surfaces in it."""

    tiles: EyeTiles
    directions: np.ndarray
    """Unit vectors to the pixels, shape (pixel, 3)."""
    sky: Any
    """Luminance per unit luminance of ground and sky patches, csr array (pixel, bin) [–]."""
    surfaces: SeenSurfaces
    films: np.ndarray
    """Pixels of the rows of `glow`, int, shape (end,)."""
    glow: FilmGlow
    images: Images


def seen(
    scene: Scene, channels: tuple[int, ...], place: np.ndarray, forward: np.ndarray,
    suns: np.ndarray, diameter: float, subdivision: int, seed: int,
) -> Seen:  # fmt: skip
    """Trace what is seen from a place.

    Parameters
    ----------
    scene : Scene
    channels : tuple of int
        Colour channels of the case.
    place : np.ndarray, shape (3,)
        Place of the eye [m].
    forward : np.ndarray, shape (view, 3)
        Lines of sight.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    subdivision : int
        Reinhart's factor MF of the sky.
    seed : int
    """
    sent = rays(forward)
    chains = Chains(scene, channels)
    count = len(sent.directions)
    outside, films, surfaces = chains.ends(np.broadcast_to(place, (count, 3)), sent.directions)
    alone = np.ones(count, bool)
    alone[outside.ray[outside.weight > FAINT]] = alone[films.ray] = False
    ray = merged(sent.tile, np.where(alone, _keys(surfaces, count), -1), sent.directions)
    kept, pixel = np.unique(ray, return_inverse=True)
    surfaces, outside = (ends.take(np.isin(ends.ray, kept)) for ends in (surfaces, outside))
    at = np.searchsorted(kept, np.arange(count)).clip(max=len(kept) - 1)
    first = np.flatnonzero(np.r_[True, np.diff(sent.tile) > 0, True])
    mirroring = np.unique(sent.tile[outside.ray[outside.path == TURNED]])
    tiles = EyeTiles(first, sent.directions, pixel.ravel(), sent.solid_angle, forward)
    return Seen(
        tiles, sent.directions[kept], _of_sky(outside, at, len(kept), subdivision),
        SeenSurfaces(
            at[surfaces.ray], surfaces.point + LIFT * surfaces.normal, surfaces.normal,
            surfaces.weight.reshape(-1, len(channels)) / np.pi,
        ),
        at[films.ray], glow(scene, films, suns, diameter, subdivision, seed),
        images(chains, place, mirroring, suns, diameter, seed),
    )  # fmt: skip


def _keys(surfaces: Ends, count: int) -> np.ndarray:
    """Number of the parts and sides that each ray ends at, one after the other, int, (ray,)."""
    sides = np.concatenate([surfaces.part[:, None], surfaces.normal.round(1)], axis=1)
    side = np.unique(sides, axis=0, return_inverse=True)[1].ravel() + 1
    before = np.r_[0, np.flatnonzero(np.diff(surfaces.ray)) + 1] if len(side) else np.zeros(0, int)
    order = np.arange(len(side)) - np.repeat(before, np.diff(np.r_[before, len(side)]))
    ends = np.zeros((count, order.max(initial=0) + 1), int)
    ends[surfaces.ray, order] = side
    return np.unique(ends, axis=0, return_inverse=True)[1].ravel()


def _of_sky(outside: Ends, at: np.ndarray, pixels: int, subdivision: int) -> Any:
    """Share of each bin's luminance that each pixel has, csr array (pixel, bin)."""
    shape = (pixels, len(Patches(subdivision)))
    d = mi.Vector3f(*(flat(outside.direction[:, k]) for k in range(3)))
    bins = patch_index(d, subdivision).numpy() if len(outside.ray) else np.zeros(0, int)
    return sparse.csr_array((outside.weight.astype(np.float32), (at[outside.ray], bins)), shape)


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
    surfaces: np.ndarray
    """Luminance of the surface points [cd/m²], shape (point, time)."""

    @cached_property
    def largest(self) -> np.ndarray:
        """Luminance that no pixel exceeds but by films [cd/m²], shape (time,); ∞ with films."""
        if len(self.seen.films):
            return np.where(self.sky.any(axis=1) | (self.sun > 0), np.inf, 0)
        ends = np.bincount(self.seen.surfaces.pixel).max(initial=0)
        return np.asarray(self.sky.max(axis=1) + ends * self.surfaces.max(axis=0, initial=0))

    def at(self, hours: np.ndarray) -> np.ndarray:
        """Luminances in some hours, without the disks of the suns, float32, (pixel, hour)."""
        seen, lit = self.seen, self.sun_index[hours] >= 0
        sky = np.ascontiguousarray(self.sky[hours].T, np.float32)
        parts = [seen.sky @ sky, self._onto(seen.surfaces.pixel) @ self.surfaces[:, hours]]
        if len(seen.films):
            shining = seen.glow.sky @ sky
            suns = seen.glow.suns[:, self.sun_index[hours][lit]]
            shining[:, lit] += suns * self.sun[hours][lit].astype(np.float32)
            parts.append(self._onto(seen.films) @ shining)
        return np.asarray(sum(parts), np.float32)

    def _onto(self, pixel: np.ndarray) -> Any:
        """Sum of ends by pixel, csr array (pixel, end)."""
        ones = np.ones(len(pixel), np.float32)
        shape = (len(self.seen.directions), len(pixel))
        return sparse.csr_array((ones, (pixel, np.arange(len(pixel)))), shape)
