"""Suns as an eye sees them: the visible part of their disks, straight and in mirrors.

A disk that is seen straight has directions of its own, and so has its image by each chain of planar
mirrors, by exact geometry: see `transport.mirrors.image_suns`. Where rays of the eye leave by way
of other smooth mirrors or clear solids, their tiles are looked at with `FINEST`² rays each: those
that end in the disk of a sun show its image, of the sun's luminance, at their place and with their
solid angle.

Limits: rough mirrors show no image. A ray at a clear solid is either reflected or refracted, by
chance, so that an image is smaller instead of dimmer. An image of n rays has a solid angle that is
uncertain by less than n^½ of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.eye.ends import EndRows, OnWay
from drcmitsuba.eye.openings import NO_OPENING, SeenOpenings
from drcmitsuba.eye.paths import EyePaths
from drcmitsuba.glare_year.pixels import within
from drcmitsuba.glare_year.seen_ends import seen_ends
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Stream, even_numbers, launch_seed
from drcmitsuba.transport.mirrors.mirror_planes import FAINT
from drcmitsuba.transport.rays.shadow_rays import straight

spatial = lazy.module("scipy.spatial")

SAMPLES = 1024
"""Directions on a disk that is seen straight: a sliver of 1 % dazzles."""
FINEST = 64
"""Rays along a tile that looks into mirrors: 1.2e-6 sr each, fifty in a sun's disk."""
TILES = 64
"""Number of tiles that are looked at at once."""


class Images(NamedTuple):
    """Images of the suns, straight and mirrored."""

    sun: np.ndarray
    """Index of the sun, int, shape (image,)."""
    direction: np.ndarray
    """Unit vectors from the eye, shape (image, 3)."""
    solid_angle: np.ndarray
    """Visible solid angle [sr], shape (image,)."""
    transmittance: np.ndarray
    """Luminance of the visible part over that of the sun [–], shape (image,)."""
    opening: np.ndarray
    """Opening that the eye sees it by, `NO_OPENING` for none, int, shape (image,)."""

    def take(self, which: np.ndarray) -> Images:
        """Some of the images."""
        return Images(*(column[which] for column in self))

    @classmethod
    def joined(cls, parts: Sequence[Images]) -> Images:
        """Images of several kinds."""
        return cls(*(np.concatenate(columns) for columns in zip(NONE, *parts, strict=True)))


NONE = Images(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, int))
Entered = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Takes disks (ray,) and directions (ray, 3) from the eye in them; gives openings, int, (ray,)."""


def images(
    paths: EyePaths, place: np.ndarray, mirroring: np.ndarray, suns: np.ndarray, diameter: float,
    seed: int,
) -> Images:  # fmt: skip
    """Find the images of suns that an eye sees.

    Parameters
    ----------
    paths : EyePaths
    place : np.ndarray, shape (3,)
        Place of the eye [m].
    mirroring : np.ndarray of int, shape (tile,)
        Numbers of the tiles some of whose rays leave by way of mirrors.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    seed : int
    """
    if not len(suns):
        return NONE
    p = mi.Point3f(*map(float, place))

    def straight_on(d: mi.Vector3f) -> mi.Float:
        return straight(paths.scene, p, d, mi.Bool(True))

    def entered(disk: np.ndarray, d: np.ndarray) -> np.ndarray:
        if paths.openings is None:
            return np.full(len(d), NO_OPENING)
        return _first(paths.openings, p, d)

    first = launch_seed(seed, Stream.SUN_IMAGES, 0)
    parts = [_disks(np.arange(len(suns)), suns, diameter, first, straight_on, entered)]
    if paths.sun.images is not None:
        parts += _in_planes(paths, place, suns, diameter, seed)
    parts += [
        _mirrored(paths, place, mirroring[i : i + TILES], suns, diameter,
                  launch_seed(seed, Stream.SUN_TILES, i // TILES))
        for i in range(0, len(mirroring), TILES)
    ]  # fmt: skip
    return Images.joined(parts)


def _disks(
    index: np.ndarray, centres: np.ndarray, diameter: float, seed: int,
    reached: Callable[[mi.Vector3f], mi.Float], entered: Entered,
) -> Images:  # fmt: skip
    """Disks around centres (disk, 3) of suns `index` (disk,), where any of their light arrives.

    There is one for every opening that a part of the disk is seen by.
    """
    lane = dr.arange(mi.UInt32, len(index) * SAMPLES)
    disk = lane // SAMPLES
    uv = even_numbers(lane % SAMPLES, disk, seed, 0)
    d = sample_disk(dr.gather(mi.Vector3f, flat(centres), disk), diameter, uv)
    tau = reached(d).numpy().reshape(-1, SAMPLES).astype(float)
    at, sample = np.nonzero(tau > 0)
    towards = np.array(d).T.reshape(-1, SAMPLES, 3)[at, sample].astype(float)
    opening = entered(at, towards)
    (seen, by), image = _numbered(np.stack([at, opening], axis=1))
    visible = np.bincount(image, minlength=len(seen))
    through = np.bincount(image, tau[at, sample], len(seen)) / np.maximum(visible, 1)
    omega = disk_solid_angle(diameter) * visible / SAMPLES
    return Images(index[seen], centres[seen], omega, through, by)


def _in_planes(
    paths: EyePaths, place: np.ndarray, suns: np.ndarray, diameter: float, seed: int
) -> Iterator[Images]:
    """Yield the images of suns by each chain of planar mirrors."""
    mirrored = paths.sun.images
    assert mirrored is not None
    p = mi.Point3f(*map(float, place))
    for k, (d, some, reached) in enumerate(
        mirrored.seen_from(p, suns, diameter, mirrored.mirrors.seen)
    ):

        def entered(disk: np.ndarray, d: np.ndarray, sun: np.ndarray = suns[some]) -> np.ndarray:
            return _opening_of_images(paths, place, disk, d, sun, diameter, seed)

        own = launch_seed(seed, Stream.SUN_IMAGES, k + 1)
        yield _disks(some, d, diameter, own, reached, entered)


def _opening_of_images(
    paths: EyePaths, place: np.ndarray, disk: np.ndarray, d: np.ndarray, suns: np.ndarray,
    diameter: float, seed: int,
) -> np.ndarray:  # fmt: skip
    """Opening by which each ray sees the image of a sun in mirrors: that of its disk's first ray.

    Of what the ray shows, it is the strongest end in the sun's disk; where chance has let none
    through, the first opening along the ray.
    """
    if paths.openings is None or not len(disk):
        return np.full(len(disk), NO_OPENING)
    each, first, image = np.unique(disk, return_index=True, return_inverse=True)
    opening = _first(paths.openings, mi.Point3f(*map(float, place)), d[first])
    outside = seen_ends(paths, place, d[first], seed=launch_seed(seed, Stream.EYE_PATHS)).outside
    cosine = np.einsum("ei,ei->e", outside.direction, suns[each][outside.ray])
    shown = outside.take(outside.has_met(OnWay.TURN) & (cosine > np.cos(np.radians(diameter))))
    rising = shown.take(np.argsort(shown.weight, kind="stable"))
    opening[rising.ray] = rising.opening  # the strongest end is written last
    return opening[image.ravel()]


def _mirrored(
    paths: EyePaths, place: np.ndarray, tiles: np.ndarray, suns: np.ndarray, diameter: float,
    seed: int,
) -> Images:  # fmt: skip
    """Suns that are seen by way of mirrors, one image for each sun, tile and opening."""
    d, solid_angle = within(tiles, FINEST, seed)
    own = launch_seed(seed, Stream.EYE_PATHS)
    outside = seen_ends(paths, place, d, seed=own, samples=FINEST**2).outside
    outside = outside.take(shows_by_chance(outside))
    radius = 2 * np.sin(np.radians(diameter) / 4)
    trees = (spatial.cKDTree(v) for v in (outside.direction, suns))
    met = next(trees).sparse_distance_matrix(next(trees), radius, output_type="ndarray")
    if not len(met):
        return NONE
    ray, weight = outside.ray[met["i"]], outside.weight[met["i"]]
    seen = np.stack([met["j"], ray // FINEST**2, outside.opening[met["i"]]], axis=1)
    (sun, _, opening), image = _numbered(seen)
    count = np.bincount(image)
    towards = np.stack([np.bincount(image, d[ray, k]) for k in range(3)], axis=1)
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    transmittance = np.bincount(image, weight) / count
    return Images(sun, towards, count * solid_angle, transmittance, opening)


def shows_by_chance(outside: EndRows) -> np.ndarray:
    """Whether rays that leave the scene may show suns that have no exact image, bool (end,).

    Images as faint as chains of planar mirrors that are left out are left out as well.
    """
    counts = (outside.sun > 0) & (outside.weight > FAINT)
    return np.asarray(counts & ~outside.has_met(OnWay.ROUGH | OnWay.MIRRORING_PANE))


def _first(openings: SeenOpenings, p: mi.Point3f, d: np.ndarray) -> np.ndarray:
    """Openings that rays from a place along d (ray, 3) meet first, int, (ray,)."""
    if not len(d):
        return np.zeros(0, int)
    towards = mi.Vector3f(*(flat(d[:, k]) for k in range(3)))
    return np.asarray(openings.first(p, towards).numpy().astype(int))


def _numbered(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns of the different rows (row, column), and the number of each among them."""
    different, number = np.unique(rows, axis=0, return_inverse=True)
    return different.T, number.ravel()
