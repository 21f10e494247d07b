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

from collections.abc import Callable, Iterator
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.glare_year.chains import TURNED, Chains
from drcmitsuba.glare_year.pixels import within
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
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


NONE = Images(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def images(
    chains: Chains, place: np.ndarray, mirroring: np.ndarray, suns: np.ndarray, diameter: float,
    seed: int,
) -> Images:  # fmt: skip
    """Find the images of suns that an eye sees.

    Parameters
    ----------
    chains : Chains
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
        return straight(chains.scene, p, d, mi.Bool(True))

    parts = [_disks(np.arange(len(suns)), suns, diameter, seed, straight_on)]
    if chains.images is not None:
        parts += _in_planes(chains.images, p, suns, diameter, seed)
    parts += [
        _mirrored(chains, place, mirroring[i : i + TILES], suns, diameter, seed + i)
        for i in range(0, len(mirroring), TILES)
    ]
    return Images(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _disks(
    index: np.ndarray, centres: np.ndarray, diameter: float, seed: int,
    reached: Callable[[mi.Vector3f], mi.Float],
) -> Images:  # fmt: skip
    """Disks around centres (disk, 3) of suns `index` (disk,), where any of their light arrives."""
    lane = dr.arange(mi.UInt32, len(index) * SAMPLES)
    disk = lane // SAMPLES
    uv = even_numbers(lane % SAMPLES, disk, seed, 0)
    d = sample_disk(dr.gather(mi.Vector3f, flat(centres), disk), diameter, uv)
    tau = reached(d).numpy().reshape(-1, SAMPLES).astype(float)
    visible = (tau > 0).sum(axis=1)
    seen = np.flatnonzero(visible)
    omega = disk_solid_angle(diameter) * visible[seen] / SAMPLES
    return Images(index[seen], centres[seen], omega, tau[seen].sum(axis=1) / visible[seen])


def _in_planes(
    images: ImageSuns, p: mi.Point3f, suns: np.ndarray, diameter: float, seed: int
) -> Iterator[Images]:
    """Yield the images of suns by each chain of planar mirrors."""
    for k, (d, some, reached) in enumerate(
        images.seen_from(p, suns, diameter, images.mirrors.seen)
    ):
        yield _disks(some, d, diameter, seed + 7 * k + 1, reached)


def _mirrored(
    chains: Chains, place: np.ndarray, tiles: np.ndarray, suns: np.ndarray, diameter: float,
    seed: int,
) -> Images:  # fmt: skip
    """Suns that are seen by way of mirrors, one image for each sun and tile."""
    d, solid_angle = within(tiles, FINEST, seed)
    outside, _, _ = chains.ends(np.broadcast_to(place, d.shape), d)
    outside = outside.take(outside.path == TURNED)
    radius = 2 * np.sin(np.radians(diameter) / 4)
    trees = (spatial.cKDTree(v) for v in (outside.direction, suns))
    met = next(trees).sparse_distance_matrix(next(trees), radius, output_type="ndarray")
    if not len(met):
        return NONE
    ray, weight = outside.ray[met["i"]], outside.weight[met["i"]]
    key, image = np.unique(met["j"] * len(tiles) + ray // FINEST**2, return_inverse=True)
    count = np.bincount(image, minlength=len(key))
    towards = np.stack([np.bincount(image, d[ray, k], len(key)) for k in range(3)], axis=1)
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    transmittance = np.bincount(image, weight, len(key)) / count
    return Images(key // len(tiles), towards, count * solid_angle, transmittance)
