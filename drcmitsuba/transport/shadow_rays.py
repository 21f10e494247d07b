"""Deposit by shadow rays: light that comes straight from sky and suns, through clear panes only.

Receivers are points with a facing: sensors, cells, or the faces of scattering panes. For each one
and every bin of unit radiance this gives the irradiance D [sr].
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk, transmittance

from drcmitsuba.scene import Scene
from drcmitsuba.transport.gather import first_directions

LANES = 1 << 23
"""Lanes of one launch: large enough to fill a GPU, small enough for memory."""


@dataclass(frozen=True)
class Openings:
    """Where receivers in a room can see out: rectangles (opening, 4, 3), fronts inward [m].

    Rays that miss all of them need not be traced. Nothing is lost: they would meet a wall.
    """

    quads: np.ndarray

    @classmethod
    def of(cls, scene: Scene, points: mi.Float) -> Openings | None:
        """Openings that all points look through; None where that is not known."""
        room = scene.enclosure
        return cls(room.openings) if room is not None and room.contains(points) else None

    @property
    def normals(self) -> np.ndarray:
        """Unit normals into the room, shape (opening, 3)."""
        n = np.cross(self.quads[:, 1] - self.quads[:, 0], self.quads[:, 3] - self.quads[:, 0])
        return n / np.linalg.norm(n, axis=1, keepdims=True)

    def passed(self, p: mi.Point3f, d: mi.Vector3f, spread: float = 0.0) -> mi.Bool:
        """Whether rays within `spread` [rad] of d may leave the room; errs on the side of yes."""
        result = mi.Bool(False)
        for quad, normal in zip(self.quads, self.normals, strict=True):
            corner, n = mi.Point3f(*map(float, quad[0])), mi.Vector3f(*map(float, normal))
            cosine = -dr.dot(d, n)
            distance = dr.dot(p - corner, n) / cosine
            y = p + distance * d - corner
            inside = cosine > -spread
            # A ray that is off by the spread meets the wall off by distance · spread / cosine.
            margin = 1e-3 + 1.5 * spread * distance / cosine
            for edge in (quad[1] - quad[0], quad[3] - quad[0]):
                length = float(np.linalg.norm(edge))
                along = dr.dot(y, mi.Vector3f(*map(float, edge / length)))
                inside &= (along > -margin) & (along < length + margin)
            result |= inside | ((dr.abs(cosine) < 8 * spread) & (spread > 0))
        return result

    def faced(self, suns: np.ndarray, diameter: float) -> np.ndarray:
        """Suns (bool) of which any part stands before an opening."""
        return (suns @ self.normals.T < np.sin(np.radians(diameter))).any(axis=1)


def _straight(
    scene: Scene, openings: Openings | None, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool
) -> mi.Float:
    """Transmittance from points to the sky: 0 behind anything opaque, else the panes' product."""
    if openings is not None:
        active &= openings.passed(p, d)
    ray = mi.Ray3f(p, d)
    lit = active & ~scene.opaque.ray_test(ray, coherent=False, active=active)
    if scene.clear is None:
        return dr.select(lit, mi.Float(1), 0)
    return transmittance(scene.clear, ray, lit)


def sky_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    subdivision: int, rays: int, seed: int,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of points per unit radiance of the ground and the sky patches.

    Parameters
    ----------
    scene : Scene
    points, normals : mi.Float
        Positions (off their surface) and normals, three numbers a point.
    subdivision : int
        Reinhart's factor MF.
    rays : int
        Rays from a point, cosine-distributed and stratified.
    seed : int

    Returns
    -------
    mi.TensorXf, shape (point, bin)
        D [sr]; a free point has ΣD = π.
    """
    bins, count = len(Patches(subdivision)), dr.width(points) // 3
    out = dr.zeros(mi.Float, count * bins)
    openings = Openings.of(scene, points)
    if openings is not None and len(openings.quads) == 0:
        return mi.TensorXf(out, (count, bins))
    block = max(1, LANES // rays)
    for start in range(0, count, block):
        n_points = min(block, count - start)
        lane = dr.arange(mi.UInt32, n_points * rays)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + start, n_points * rays)
        row = lane // rays + dr.opaque(mi.UInt32, start)
        p = dr.gather(mi.Point3f, points, row)
        frame = mi.Frame3f(dr.gather(mi.Normal3f, normals, row))
        d = frame.to_world(first_directions(sampler, lane, rays))
        tau = _straight(scene, openings, p, d, mi.Bool(True))
        index = row * bins + patch_index(d, subdivision)
        dr.scatter_add(out, tau * (np.pi / rays), index, tau > 0)
        dr.eval(out)
    return mi.TensorXf(out, (count, bins))


def sun_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    suns: np.ndarray, diameter: float, samples: int, seed: int,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of points per unit radiance of every sun.

    Parameters
    ----------
    scene : Scene
    points, normals : mi.Float
        Positions (off their surface) and normals, three numbers a point.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    samples : int
        Directions drawn from the disk for every point and sun.
    seed : int

    Returns
    -------
    mi.TensorXf, shape (point, sun)
        D [sr] = Ω · mean of τ·V·max(0, cos θ) over the disk.
    """
    count, n_suns = dr.width(points) // 3, len(suns)
    out = dr.zeros(mi.Float, count * n_suns)
    openings = Openings.of(scene, points)
    seen = np.arange(n_suns)
    if openings is not None:
        seen = np.flatnonzero(openings.faced(suns, diameter))
    if len(seen) == 0:
        return mi.TensorXf(out, (count, n_suns))
    spread = np.radians(diameter) / 2
    directions = mi.Float(np.ascontiguousarray(suns[seen], np.float32).ravel())
    sun_of = mi.UInt32(seen.astype(np.uint32))

    def pair(index: mi.UInt32) -> tuple[mi.UInt32, mi.Point3f, mi.Normal3f, mi.Vector3f]:
        row = index // len(seen)
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        return row, p, n, dr.gather(mi.Vector3f, directions, index % len(seen))

    scale = disk_solid_angle(diameter) / samples
    block = max(1, LANES // len(seen))
    for start in range(0, count, block):
        # Most pairs of receiver and sun face away or look at a wall: only the rest is traced.
        first, pairs = start * len(seen), min(block, count - start) * len(seen)
        index = dr.arange(mi.UInt32, pairs) + dr.opaque(mi.UInt32, first)
        _, p, n, centre = pair(index)
        possible = dr.dot(n, centre) > -spread
        if openings is not None:
            possible &= openings.passed(p, centre, spread)
        index = dr.compress(possible) + dr.opaque(mi.UInt32, first)
        lanes = dr.width(index)
        if lanes == 0:
            continue
        row, p, n, centre = pair(index)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + start, lanes)
        total = mi.Float(0)
        for _ in range(samples):
            d = sample_disk(centre, diameter, sampler.next_2d())
            cosine = dr.dot(n, d)
            tau = _straight(scene, openings, p, d, cosine > 0)
            total += dr.select(tau > 0, tau * cosine, 0)
        sun = dr.gather(mi.UInt32, sun_of, index % len(seen))
        dr.scatter(out, total * scale, row * n_suns + sun)
        dr.eval(out)
    return mi.TensorXf(out, (count, n_suns))
