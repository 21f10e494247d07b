"""Deposit by shadow rays: light that comes straight from sky and suns, through clear panes only.

Receivers are points with a normal: sensors, cells, or the faces of scattering panes. D [sr] is
their irradiance per unit radiance of a bin.
"""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import (
    TO_UNIT,
    disk_solid_angle,
    from_disk,
    random_bits,
    sample_disk,
    transmittance,
)

from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.gather import first_directions
from drcmitsuba.transport.launch_size import SHADOW_RAYS

RIM = 8
"""Directions around a disk's edge: they detect any straight edge that leaves or takes 1.5 %."""
CLUSTER = 32
"""Number of neighbouring suns that are traced or skipped together."""


@dataclass(frozen=True)
class Openings:
    """Openings of a room: rectangles (opening, 4, 3), fronts inward [m].

    Rays that miss all openings are not traced: they would meet a wall.
    """

    quads: np.ndarray

    @classmethod
    def of(cls, scene: Scene, points: mi.Float) -> Openings | None:
        """Openings that all points look through; None where a point may lie outside the room."""
        room = scene.enclosure
        if room is None or not room.spares or not room.contains(points):
            return None
        return cls(room.openings)

    @property
    def normals(self) -> np.ndarray:
        """Unit normals into the room, shape (opening, 3)."""
        n = np.cross(self.quads[:, 1] - self.quads[:, 0], self.quads[:, 3] - self.quads[:, 0])
        return n / np.linalg.norm(n, axis=1, keepdims=True)

    def passed(self, p: mi.Point3f, d: mi.Vector3f) -> mi.Bool:
        """Whether rays may leave the room; in doubt yes."""
        result = mi.Bool(False)
        for quad, normal in zip(self.quads, self.normals, strict=True):
            corner, n = mi.Point3f(*map(float, quad[0])), mi.Vector3f(*map(float, normal))
            cosine = dr.dot(d, n)
            y = p - dr.dot(p - corner, n) / cosine * d - corner
            inside = cosine < 0
            for edge in (quad[1] - quad[0], quad[3] - quad[0]):
                length = float(np.linalg.norm(edge))
                along = dr.dot(y, mi.Vector3f(*map(float, edge / length)))
                inside &= (along > -1e-3) & (along < length + 1e-3)
            result |= inside
        return result

    def reached(self, points: np.ndarray, axes: np.ndarray, spread: np.ndarray) -> np.ndarray:
        """Whether cones of directions may leave the room, shape (point, cone); in doubt yes.

        A ray at angle δ to an axis of incidence θ meets the wall, at distance h, within
        h sin δ / (cos θ cos(θ + δ)) of the point where the axis meets it.
        """
        result = np.zeros((len(points), len(axes)), bool)
        for quad, normal in zip(self.quads, self.normals, strict=True):
            cosine = -(axes @ normal)
            outermost = np.cos(np.arccos(np.clip(cosine, -1, 1)) + spread)
            grazes = (outermost < 0.01) & (cosine > -np.sin(spread))
            safe = np.where(outermost < 0.01, 1.0, cosine)
            h = ((points - quad[0]) @ normal)[:, None]
            margin = h * np.sin(spread) / (safe * np.maximum(outermost, 0.01)) + 1e-3
            inside = np.broadcast_to(outermost >= 0.01, result.shape)
            for edge in (quad[1] - quad[0], quad[3] - quad[0]):
                length = np.linalg.norm(edge)
                along = ((points - quad[0]) @ edge / length)[:, None] + h / safe * (
                    axes @ edge / length
                )
                inside = inside & (along > -margin) & (along < length + margin)
            result |= inside | grazes
        return result


def _clusters(directions: np.ndarray) -> np.ndarray:
    """Indices of neighbouring directions, shape (cluster, CLUSTER), padded with −1."""

    def sort(index: np.ndarray) -> list[np.ndarray]:
        if len(index) <= CLUSTER:
            return [index]
        axis = int(np.argmax(np.ptp(directions[index], axis=0)))
        half = -(-len(index) // (2 * CLUSTER)) * CLUSTER
        order = index[np.argsort(directions[index, axis], kind="stable")]
        return sort(order[:half]) + sort(order[half:])

    order = np.concatenate(sort(np.arange(len(directions))))  # all clusters but the last are full
    return np.pad(order, (0, -len(order) % CLUSTER), constant_values=-1).reshape(-1, CLUSTER)


def candidates(
    openings: Openings | None, p: np.ndarray, n: np.ndarray, suns: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Receivers and clusters of suns that may see each other, pair by pair, and the clusters."""
    clusters = _clusters(suns)
    members = suns[clusters]  # -1 repeats the last sun, which does no harm to the bounds
    axes = members.mean(axis=1)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    cosines = np.einsum("gsi,gi->gs", members, axes)
    spread = np.arccos(np.clip(cosines, -1, 1)).max(axis=1) + radius
    possible = n @ axes.T > -np.sin(spread)
    if openings is not None:
        possible &= openings.reached(p, axes, spread)
    rows, groups = np.nonzero(possible)
    return rows, groups, clusters


def hidden_in_disks(scene: Scene, points: np.ndarray, suns: np.ndarray, diameter: float) -> mi.Bool:
    """Whether a slit may show a sun's disk without its edge, flat (point, sun).

    There is no such slit where every opening is wider than a disk's image across the room.
    """
    room, radius = scene.enclosure, np.radians(diameter) / 2
    if room is not None and room.narrowest < 2 * np.tan(radius) * np.linalg.norm(room.size):
        openings = Openings.of(scene, mi.Float(points.astype(np.float32).ravel()))
        if openings is not None:
            return mi.Bool(openings.reached(points, suns, np.full(len(suns), radius)).ravel())
    return mi.Bool(False)


def sun_numbers(suns: np.ndarray) -> np.ndarray:
    """Seeds of the random numbers of suns (sun, 3); they depend on the direction only."""
    directions = np.ascontiguousarray(suns, np.float32)
    return np.array([crc32(direction.tobytes()) for direction in directions], np.uint32)


def straight(
    scene: Scene, openings: Openings | None, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool
) -> mi.Float:
    """Transmittance from points to the sky: product over clear panes; 0 behind opaque surfaces."""
    if openings is not None:
        active = active & openings.passed(p, d)
    scene.ray_counter.add("shadow", active, dr.width(d))
    return to_sky(scene, p, d, active)


def to_sky(scene: Scene, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool) -> mi.Float:
    """`straight` without openings and the count of rays: it may stand in a symbolic loop."""
    ray = mi.Ray3f(p, d)
    lit = active & ~scene.opaque.ray_test(ray, coherent=False, active=active)
    if scene.clear is None:
        return dr.select(lit, mi.Float(1), 0)
    return transmittance(scene.clear, ray, lit)


def sky_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    subdivision: int, rays: int, seed: int, numbers: mi.UInt32 | None = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of points per unit radiance of the ground and the sky patches.

    Parameters
    ----------
    scene : Scene
    points, normals : mi.Float
        Positions (off their surface) [m] and normals, three numbers a point.
    subdivision : int
        Reinhart's factor MF.
    rays : int
        Number of rays from a point, cosine-distributed and stratified.
    seed : int
    numbers : mi.UInt32, optional
        Seeds of the points' random numbers, independent of the launch; by default 0, 1, … .

    Returns
    -------
    mi.TensorXf, shape (point, bin)
        D [sr]; a free point has ΣD = π.
    """
    bins, count = len(Patches(subdivision)), dr.width(points) // 3
    openings = Openings.of(scene, points)
    if openings is not None and len(openings.quads) == 0:
        return dr.zeros(mi.TensorXf, (count, bins))
    out = dr.zeros(mi.Float64, count * bins)  # a million rays may end in one bin
    numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
    block = max(1, SHADOW_RAYS // rays)
    for start in range(0, count, block):
        n_points = min(block, count - start)
        lane = dr.arange(mi.UInt32, n_points * rays)
        row = lane // rays + dr.opaque(mi.UInt32, start)
        p = dr.gather(mi.Point3f, points, row)
        frame = mi.Frame3f(dr.gather(mi.Normal3f, normals, row))
        number = dr.gather(mi.UInt32, numbers, row)
        d = frame.to_world(first_directions(lane % rays, number, seed))
        tau = straight(scene, openings, p, d, scene.effects.shines(d))
        index = row * bins + patch_index(d, subdivision)
        dr.scatter_add(out, mi.Float64(tau * (np.pi / rays)), index, tau > 0)
        dr.eval(out)
    return mi.TensorXf(mi.Float(out), (count, bins))


def sun_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    suns: np.ndarray, diameter: float, samples: int, seed: int, rim: int | None = None,
    numbers: mi.UInt32 | None = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of points per unit radiance of every sun.

    Parameters
    ----------
    scene : Scene
    points, normals : mi.Float
        Positions (off their surface) [m] and normals, three numbers a point.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    samples : int
        Directions drawn from the disk for every point and sun.
    seed : int
    rim : int, optional
        Index of the one direction to take instead, of `RIM` around the disk's edge.
    numbers : mi.UInt32, optional
        As for `sky_deposit`.

    Returns
    -------
    mi.TensorXf, shape (point, sun)
        D [sr] = Ω · mean of τ·V·max(0, cos θ) over the disk.
    """
    count, n_suns = dr.width(points) // 3, len(suns)
    out = dr.zeros(mi.Float, count * n_suns)
    openings = Openings.of(scene, points)
    if n_suns == 0 or (openings is not None and len(openings.quads) == 0):
        return mi.TensorXf(out, (count, n_suns))
    at, facing = (a.numpy().reshape(-1, 3) for a in (points, normals))
    rows, groups, clusters = candidates(openings, at, facing, suns, np.radians(diameter) / 2)
    directions = mi.Float(np.ascontiguousarray(suns, np.float32).ravel())
    row_of, group_of = mi.UInt32(rows.astype(np.uint32)), mi.UInt32(groups.astype(np.uint32))
    sun_of = mi.Int32(clusters.astype(np.int32).ravel())
    places = mi.UInt32(sun_numbers(suns))
    numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
    block = max(1, SHADOW_RAYS // CLUSTER)
    stride = dr.opaque(mi.UInt32, n_suns)  # a literal would have the kernel compiled anew
    for start in range(0, len(rows), block):
        lane = dr.arange(mi.UInt32, min(block, len(rows) - start) * CLUSTER)
        candidate = lane // CLUSTER + dr.opaque(mi.UInt32, start)
        row = dr.gather(mi.UInt32, row_of, candidate)
        group = dr.gather(mi.UInt32, group_of, candidate)
        member = dr.gather(mi.Int32, sun_of, group * CLUSTER + lane % CLUSTER)
        sun, exists = mi.UInt32(member), member >= 0
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        centre = dr.gather(mi.Vector3f, directions, sun, exists)
        pair = row * stride + sun
        number = dr.gather(mi.UInt32, numbers, row)
        place = dr.gather(mi.UInt32, places, sun, exists)
        drawn = _anywhere(centre, diameter, number, place, samples, seed)
        if rim is not None:
            drawn = [_on_rim(centre, diameter, number, place, rim, seed)]
        value = _seen(scene, openings, p, n, exists, diameter, drawn)
        dr.scatter(out, value, pair, exists)
        dr.eval(out)
    return mi.TensorXf(out, (count, n_suns))


def _anywhere(
    centre: mi.Vector3f, diameter: float, number: mi.UInt32, place: mi.UInt32, samples: int,
    seed: int,
) -> list[mi.Vector3f]:  # fmt: skip
    """Directions drawn from disks, by the seeds of points and of suns."""
    bits = (random_bits(number, seed + i, place) for i in range(samples))
    uv = (mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in each)) for each in bits)
    return [sample_disk(centre, diameter, each) for each in uv]


def _on_rim(
    centre: mi.Vector3f, diameter: float, number: mi.UInt32, place: mi.UInt32, rim: int, seed: int
) -> mi.Vector3f:
    """One of `RIM` directions evenly around the edge of each disk, turned at random together."""
    turn = mi.Float(random_bits(number, seed, place)[0] >> 8) * TO_UNIT
    s, c = dr.sincos(2 * dr.pi / RIM * (turn + dr.opaque(mi.Float, rim)))
    return from_disk(centre, diameter, 0.99 * mi.Point2f(c, s))


def _seen(
    scene: Scene, openings: Openings | None, p: mi.Point3f, n: mi.Normal3f, active: mi.Bool,
    diameter: float, drawn: list[mi.Vector3f],
) -> mi.Float:  # fmt: skip
    """D [sr] of points by suns, from directions on their disks."""
    total = mi.Float(0)
    for d in drawn:
        cosine = dr.dot(n, d)
        tau = straight(scene, openings, p, d, active & (cosine > 0))
        total += dr.select(tau > 0, tau * cosine, 0)
    return total * (disk_solid_angle(diameter) / len(drawn))


def pair_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, pairs: mi.UInt32, *,
    suns: np.ndarray, diameter: float, samples: int, seed: int, numbers: mi.UInt32,
) -> mi.Float:  # fmt: skip
    """Compute chosen entries of `sun_deposit`.

    Parameters
    ----------
    pairs : mi.UInt32
        Entries point · suns + sun.
    scene, points, normals, suns, diameter, samples, seed, numbers
        As for `sun_deposit`.

    Returns
    -------
    mi.Float, shape (pair,)
        D [sr].
    """
    openings = Openings.of(scene, points)
    directions = mi.Float(np.ascontiguousarray(suns, np.float32).ravel())
    stride, places = dr.opaque(mi.UInt32, len(suns)), mi.UInt32(sun_numbers(suns))
    parts = []
    for start in range(0, dr.width(pairs), SHADOW_RAYS):
        lane = dr.arange(mi.UInt32, min(SHADOW_RAYS, dr.width(pairs) - start))
        pair = dr.gather(mi.UInt32, pairs, lane + dr.opaque(mi.UInt32, start))
        row, sun = pair // stride, pair % stride
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        centre, number = dr.gather(mi.Vector3f, directions, sun), dr.gather(mi.UInt32, numbers, row)
        active = dr.full(mi.Bool, True, dr.width(lane))
        place = dr.gather(mi.UInt32, places, sun)
        drawn = _anywhere(centre, diameter, number, place, samples, seed)
        parts.append(_seen(scene, openings, p, n, active, diameter, drawn))
        dr.eval(parts[-1])
    return dr.concat(parts) if parts else mi.Float()
