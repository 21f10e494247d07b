"""Suns as an eye sees them: the visible part of their disks, straight and by way of flat mirrors.

A flat mirror shows a sun of the same luminance and size in another direction. The chains of the
eye's rays tell which mirrors there are; each set of mirrors that a ray meets one after the other
has one matrix, which turns the direction to the sun to that of its image. Rays around the image are
then followed: those that end in the sun count.
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.glare_year.chains import Chains, Ends
from drcmitsuba.glare_year.pixels import SIDE
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.shadow_rays import straight

SAMPLES = 1024
"""Directions on a disk that is seen straight: a sliver of 1 % dazzles."""
MIRRORED = 64
"""Directions on a disk that is seen in mirrors."""
MOST_TURNS = 64
"""Largest number of sets of mirrors, those first that the most rays meet."""
NEAR = 4 / SIDE
"""Angle from a ray that met a set of mirrors within which an image is looked for [rad]."""


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


def images(
    chains: Chains, place: np.ndarray, outside: Ends, rays: np.ndarray,
    suns: np.ndarray, diameter: float, seed: int,
) -> Images:  # fmt: skip
    """Find the images of suns that an eye sees.

    Parameters
    ----------
    chains : Chains
    place : np.ndarray, shape (3,)
        Place of the eye [m].
    outside : Ends
        Ends of the eye's rays outside.
    rays : np.ndarray, shape (ray, 3)
        Directions of the eye's rays.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    seed : int
    """
    if not len(suns):
        return Images(np.zeros(0, int), np.zeros((0, 3)), *np.zeros((2, 0)))
    parts = [_straight(chains.scene, place, suns, diameter, seed)]
    deviated = np.isfinite(outside.turn).all(axis=(1, 2))
    deviated &= np.abs(outside.turn - np.eye(3)).max(axis=(1, 2)) > 1e-4
    if deviated.any():
        _, of, count = np.unique(
            outside.turn[deviated].round(3), axis=0, return_inverse=True, return_counts=True
        )
        for i in np.argsort(-count)[:MOST_TURNS]:
            members = np.flatnonzero(deviated)[of.ravel() == i]
            shown, turn = rays[outside.ray[members]], outside.turn[members[0]]
            near = _near(suns @ turn.T, shown)
            if len(near):
                found = _mirrored(chains, place, suns[near], turn, diameter, seed)
                parts.append(found._replace(sun=near[found.sun]))
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
    tau = straight(scene, p, d, mi.Bool(True)).numpy().reshape(-1, SAMPLES)
    return _seen(suns, tau.astype(float), diameter)


def _mirrored(
    chains: Chains, place: np.ndarray, suns: np.ndarray, turn: np.ndarray, diameter: float,
    seed: int,
) -> Images:  # fmt: skip
    """Suns that are seen by way of a set of mirrors."""
    lane = dr.arange(mi.UInt32, len(suns) * MIRRORED)
    sun, centres = lane // MIRRORED, flat(suns @ turn.T)
    uv = even_numbers(lane % MIRRORED, sun, seed, 1)
    d = np.array(sample_disk(dr.gather(mi.Vector3f, centres, sun), diameter, uv)).T
    outside, _, _ = chains.ends(np.broadcast_to(place, d.shape), d.astype(float))
    chord = np.linalg.norm(outside.direction - suns[outside.ray // MIRRORED], axis=1)
    turned = np.abs(outside.turn - turn).max(axis=(1, 2)) < 1e-2
    hits = turned & (chord <= 1.001 * 2 * np.sin(np.radians(diameter) / 4))
    tau = np.bincount(outside.ray[hits], outside.weight[hits], len(d)).reshape(-1, MIRRORED)
    return _seen(suns, tau, diameter, turn)


def _seen(
    suns: np.ndarray, tau: np.ndarray, diameter: float, turn: np.ndarray | None = None
) -> Images:
    """Images of the suns of which some directions (sun, sample) are seen."""
    visible = (tau > 0).sum(axis=1)
    sun = np.flatnonzero(visible)
    omega = disk_solid_angle(diameter) * visible[sun] / tau.shape[1]
    towards = suns[sun] if turn is None else suns[sun] @ turn.T
    return Images(sun, towards, omega, tau[sun].sum(axis=1) / visible[sun])


def _near(images: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Indices of the images (sun, 3) that lie near any of the rays (ray, 3)."""
    block = max(1, (1 << 22) // len(rays))
    starts = range(0, len(images), block)
    nearest = [(images[i : i + block] @ rays.T).max(axis=1) for i in starts]
    return np.flatnonzero(np.concatenate(nearest) > np.cos(NEAR))
