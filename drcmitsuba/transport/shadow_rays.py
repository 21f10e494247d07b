"""Deposit by shadow rays: light that comes straight from sky and suns, through clear panes only.

Receivers are points with a facing: sensors, cells, or the faces of scattering panes. For each one
and every bin of unit radiance this gives the irradiance D [sr].
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.scene import Scene
from drcmitsuba.transport.gather import first_directions
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk, transmittance

LANES = 1 << 23
"""Lanes of one launch: large enough to fill a GPU, small enough for memory."""


def _straight(scene: Scene, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool) -> mi.Float:
    """Transmittance from points to the sky: 0 behind anything opaque, else the panes' product."""
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
        tau = _straight(scene, p, d, mi.Bool(True))
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
    directions = mi.Float(np.ascontiguousarray(suns, np.float32).ravel())
    scale = disk_solid_angle(diameter) / samples
    out = dr.zeros(mi.Float, count * n_suns)
    block = max(1, LANES // max(1, n_suns))
    for start in range(0, count if n_suns else 0, block):
        n_points = min(block, count - start)
        lane = dr.arange(mi.UInt32, n_points * n_suns)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + start, n_points * n_suns)
        row = lane // n_suns + dr.opaque(mi.UInt32, start)
        p = dr.gather(mi.Point3f, points, row)
        n = dr.gather(mi.Normal3f, normals, row)
        centre = dr.gather(mi.Vector3f, directions, lane % n_suns)
        total = mi.Float(0)
        for _ in range(samples):
            d = sample_disk(centre, diameter, sampler.next_2d())
            cosine = dr.dot(n, d)
            tau = _straight(scene, p, d, cosine > 0)
            total += dr.select(tau > 0, tau * cosine, 0)
        dr.scatter(out, total * scale, lane + dr.opaque(mi.UInt32, start * n_suns))
        dr.eval(out)
    return mi.TensorXf(out, (count, n_suns))
