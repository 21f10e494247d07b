"""Suns as an eye sees them: the visible part of their disks, straight and in mirrors.

A disk that is seen straight has directions of its own. Where rays of the eye leave by way of smooth
mirrors or clear solids, their tiles are looked at with `FINEST`² rays each: those that end in the
disk of a sun show its image, of the sun's luminance, at their place and with their solid angle.

Limits: rough mirrors show no image. A ray at a clear solid is either reflected or refracted, by
chance, so that an image is smaller instead of dimmer. An image of n rays has a solid angle that is
uncertain by less than n^½ of them.
"""

from __future__ import annotations

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
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.shadow_rays import straight

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
    parts = [_straight(chains.scene, place, suns, diameter, seed)]
    parts += [
        _mirrored(chains, place, mirroring[i : i + TILES], suns, diameter, seed + i)
        for i in range(0, len(mirroring), TILES)
    ]
    return Images(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _straight(
    scene: Scene, place: np.ndarray, suns: np.ndarray, diameter: float, seed: int
) -> Images:
    """Suns that are seen through panes alone."""
    lane = dr.arange(mi.UInt32, len(suns) * SAMPLES)
    sun, centres = lane // SAMPLES, flat(suns)
    uv = even_numbers(lane % SAMPLES, sun, seed, 0)
    d = sample_disk(dr.gather(mi.Vector3f, centres, sun), diameter, uv)
    p = mi.Point3f(*map(float, place))
    tau = straight(scene, p, d, mi.Bool(True)).numpy().reshape(-1, SAMPLES).astype(float)
    visible = (tau > 0).sum(axis=1)
    seen = np.flatnonzero(visible)
    omega = disk_solid_angle(diameter) * visible[seen] / SAMPLES
    return Images(seen, suns[seen], omega, tau[seen].sum(axis=1) / visible[seen])


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
