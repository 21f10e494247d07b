"""Deposit by shadow rays: light that comes straight from sky and suns, through clear panes only.

Receivers are points with a normal: sensors, cells, or the faces of scattering panes. D [sr] is
their irradiance per unit radiance of a bin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache, partial
from typing import Any
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

from drcmitsuba.runtime.flat_arrays import add_at, flat, row_and_column
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.runtime.random_streams import even_numbers, shifted_point
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.rays.even_rays import EvenRays, Starts
from drcmitsuba.transport.rays.openings import Openings, Within
from drcmitsuba.transport.rays.sun_clusters import possible_pairs

Through = Callable[..., Any]
"""Function that gives the share of light that reaches points from directions, as `straight`."""
Accepts = Callable[..., Any]
"""Function that gives the share of light that counts at points, by cosines of the incidence."""
RIM = 8
"""Directions around a disk's edge: they detect any straight edge that leaves or takes 1.5 %."""


def sun_numbers(suns: np.ndarray) -> np.ndarray:
    """Seeds of the random numbers of suns (sun, 3); they depend on the direction only."""
    return _sun_numbers(suns.astype(np.float32).tobytes())


@lru_cache(maxsize=8)  # sensors, cells and films ask for the same suns
def _sun_numbers(directions: bytes) -> np.ndarray:
    size = 3 * np.dtype(np.float32).itemsize
    each = range(0, len(directions), size)
    return np.array([crc32(directions[start : start + size]) for start in each], np.uint32)


def straight(
    scene: Scene, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool, openings: Openings | None = None
) -> mi.Float:
    """Transmittance from points to the sky: product over clear panes; 0 behind opaque surfaces.

    Active rays pass one of the `openings`, where these are given.
    """
    scene.ray_counter.add("shadow", active, dr.width(d))
    return visibility(scene, mi.Ray3f(p, d), active, openings)


def visibility(
    scene: Scene, ray: mi.Ray3f, active: mi.Bool, openings: Openings | None = None
) -> mi.Float:
    """Transmittance along rays, which are not counted: the call may stand in a symbolic loop.

    Active rays stay in the room of the `openings`, or leave it by one of them.
    """
    opaque = scene.opaque
    if openings is not None and openings.occluders is not None:
        opaque = openings.occluders
    lit = active & ~opaque.ray_test(ray, coherent=False, active=active)
    if scene.clear is None:
        return dr.select(lit, mi.Float(1), 0)
    if scene.flat_panes is not None:
        return scene.flat_panes.transmittance(ray, lit)
    return transmittance(scene.clear, ray, lit, scene.met_faces.intersect)


def sky_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    subdivision: int, rays: int, seed: int, numbers: mi.UInt32 | None = None,
    within: Within = None, accepts: Accepts | None = None, starts: Starts | None = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of points per unit radiance of the ground and the sky patches.

    Parameters
    ----------
    points, normals : mi.Float
        Positions (off their surface) [m] and normals, three numbers a point.
    subdivision : int
        Reinhart's factor MF.
    rays : int
        Number of rays from a point, cosine-distributed and stratified.
    numbers : mi.UInt32, optional
        Seeds of the points' random numbers, independent of the launch; by default 0, 1, … .
    within : mi.Bool or bool, optional
        Whether the points lie in the room, see `openings.Within`.
    accepts : callable, optional
        Share of the light that counts, by the point and the cosine of the incidence; by default
        all.
    starts : callable, optional
        Where each ray starts, see `even_rays.Starts`: the receivers are surfaces, of which `points`
        are one each, and D is their mean.

    Returns
    -------
    mi.TensorXf, shape (point, bin)
        D [sr]; a free point has ΣD = π.
    """
    bins, count = len(Patches(subdivision)), dr.width(points) // 3
    openings = None if starts is not None else Openings.of(scene, points, within)
    if openings is not None and openings.are_none:
        return dr.zeros(mi.TensorXf, (count, bins))
    out = dr.zeros(mi.Float64, count * bins)  # a million rays may end in one bin
    share = dr.opaque(mi.Float, np.pi / rays)
    numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
    block = max(1, SHADOW_RAYS // rays)
    for start in range(0, count, block):
        n_points = min(block, count - start)
        every = EvenRays.of(points, normals, numbers, start, n_points, rays, seed, starts)
        for row, p, d, active in every.leaving(scene.effects.shines, openings):
            tau = straight(scene, p, d, active, openings)
            if accepts is not None:
                n = dr.gather(mi.Normal3f, normals, row)
                tau *= accepts(row, dr.dot(n, d), tau > 0)
            index = row * bins + patch_index(d, subdivision)
            add_at(out, mi.Float64(tau * share), index, tau > 0)
            dr.eval(out)
    return mi.TensorXf(mi.Float(out), (count, bins))


def sun_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    suns: np.ndarray, diameter: float, samples: int, seed: int,
    numbers: mi.UInt32 | None = None, within: Within = None,
    through: Through | None = None, pairs: Iterable[mi.UInt32] | None = None,
    accepts: Accepts | None = None, starts: Starts | None = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of points per unit radiance of every sun.

    Parameters
    ----------
    points, normals : mi.Float
        Positions (off their surface) [m] and normals, three numbers a point.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    samples : int
        Directions drawn from the disk for every point and sun.
    numbers, within, accepts, starts : optional
        As for `sky_deposit`.
    through : callable
        Share of light that reaches points from directions; by default the straight one.
    pairs : iterable of mi.UInt32, optional
        Pairs point · suns + sun that may see each other; by default those of `possible_pairs`.

    Returns
    -------
    mi.TensorXf, shape (point, sun)
        D [sr] = Ω · mean of τ·V·max(0, cos θ) over the disk.
    """
    count, n_suns = dr.width(points) // 3, len(suns)
    out = dr.zeros(mi.Float, count * n_suns)
    if not n_suns:
        return mi.TensorXf(out, (count, n_suns))
    numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
    openings = None if starts is not None else Openings.of(scene, points, within)
    of_pairs = _by_pairs(
        scene, openings, points, normals, suns, diameter, samples, seed, numbers, through, accepts,
        starts,
    )  # fmt: skip
    if pairs is None:
        pairs = possible_pairs(openings, points, normals, suns, diameter)
    for many in pairs:
        for pair in _launches(many, samples):
            dr.scatter(out, of_pairs(*row_and_column(pair, n_suns)), pair)
            dr.eval(out)
    return mi.TensorXf(out, (count, n_suns))


def rim_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, *,
    suns: np.ndarray, diameter: float, seed: int, numbers: mi.UInt32,
    pairs: Iterable[mi.UInt32], within: Within = None,
) -> tuple[mi.Float, mi.Float, mi.Float]:  # fmt: skip
    """Irradiance of points per unit radiance of every sun, by `RIM` directions around its edge.

    Parameters
    ----------
    scene, points, normals, suns, diameter, seed, numbers, within, pairs
        As for `sun_deposit`.

    Returns
    -------
    mean, least, most : mi.Float, flat (point, sun)
        Mean, least and largest D of the directions [sr].
    """
    mean, least, most = (dr.zeros(mi.Float, dr.width(points) // 3 * len(suns)) for _ in range(3))
    openings = Openings.of(scene, points, within)
    of_pairs = _by_pairs(scene, openings, points, normals, suns, diameter, 1, seed, numbers)
    for pair in pairs:
        total, lowest, highest = mi.Float(0), mi.Float(dr.inf), mi.Float(0)
        row, sun = row_and_column(pair, len(suns))
        for rim in range(RIM):
            D = of_pairs(row, sun, rim)
            dr.eval(D)
            total, lowest, highest = total + D, dr.minimum(lowest, D), dr.maximum(highest, D)
        for out, value in ((mean, total / RIM), (least, lowest), (most, highest)):
            dr.scatter(out, value, pair)
        dr.eval(mean, least, most)
    return mean, least, most


def _by_pairs(
    scene: Scene, openings: Openings | None, points: mi.Float, normals: mi.Float,
    suns: np.ndarray, diameter: float, samples: int, seed: int, numbers: mi.UInt32,
    through: Through | None = None, accepts: Accepts | None = None, starts: Starts | None = None,
) -> Callable[..., mi.Float]:  # fmt: skip
    """Make the function that gives D [sr] of pairs of a point and a sun.

    It takes the pairs' points and suns, and optionally the index of the one direction to take, of
    `RIM` around the disk's edge. Each direction has a lane of its own.
    """
    directions, places = flat(suns), mi.UInt32(sun_numbers(suns))
    reaching = partial(straight, openings=openings) if through is None else through

    def of(row: mi.UInt32, sun: mi.UInt32, rim: int | None = None) -> mi.Float:
        count = samples if rim is None else 1
        pair, sample = row_and_column(dr.arange(mi.UInt32, dr.width(row) * count), count)
        if count > 1:
            dr.eval(row, sun)  # lanes of several directions look them up
            row, sun = (dr.gather(mi.UInt32, x, pair) for x in (row, sun))
        active = dr.full(mi.Bool, True, dr.width(pair))
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        centre = dr.gather(mi.Vector3f, directions, sun, active)
        number = dr.gather(mi.UInt32, numbers, row)
        place = dr.gather(mi.UInt32, places, sun, active)
        if starts is not None:
            p = starts(row, even_numbers(sample, number, seed, 1, place))
        d = _drawn(centre, diameter, number, place, sample, seed, rim)
        cosine = dr.dot(n, d)
        lit = active & (cosine > 0)
        if openings is not None:
            lit &= openings.passed(row, p, d)
        tau = reaching(scene, p, d, lit)
        if accepts is not None:
            tau *= accepts(row, cosine, tau > 0)
        D = dr.select(tau > 0, tau * cosine, 0) * (disk_solid_angle(diameter) / count)
        return dr.block_sum(D, count) if count > 1 else D

    return of


def _drawn(
    centre: mi.Vector3f, diameter: float, number: mi.UInt32, place: mi.UInt32,
    sample: mi.UInt32, seed: int, rim: int | None,
) -> mi.Vector3f:  # fmt: skip
    """Directions drawn from disks by the seeds of points and suns, or one of `RIM` on the edge.

    `sample` is their number in the even sequence of the disk.
    """
    if rim is not None:  # the directions on the edge are turned at random together
        turn = mi.Float(random_bits(number, seed, place)[0] >> 8) * TO_UNIT
        s, c = dr.sincos(2 * dr.pi / RIM * (turn + dr.opaque(mi.Float, rim)))
        return from_disk(centre, diameter, 0.99 * mi.Point2f(c, s))
    shifts = random_bits(number, seed, place)
    return sample_disk(centre, diameter, shifted_point(sample, shifts))


def _launches(pairs: mi.UInt32, samples: int) -> Iterator[mi.UInt32]:
    """Yield parts of an array of pairs, whose directions have a lane each."""
    step, count = max(1, SHADOW_RAYS // samples), dr.width(pairs)
    for start in range(0, count, step):
        lane = dr.arange(mi.UInt32, min(step, count - start)) + dr.opaque(mi.UInt32, start)
        yield pairs if count <= step else dr.gather(mi.UInt32, pairs, lane)


def one_sun_deposit(
    scene: Scene, points: mi.Float, normals: mi.Float, sun: mi.UInt32, *,
    suns: np.ndarray, diameter: float, samples: int, seed: int, numbers: mi.UInt32,
    within: Within = None,
) -> mi.Float:  # fmt: skip
    """Irradiance of points per unit radiance of one sun for each of them.

    Parameters
    ----------
    sun : mi.UInt32
        Index of the sun of every point.
    scene, points, normals, suns, diameter, samples, seed, numbers, within
        As for `sun_deposit`.

    Returns
    -------
    mi.Float, shape (point,)
        D [sr].
    """
    openings, count = Openings.of(scene, points, within), dr.width(sun)
    of_pairs = _by_pairs(scene, openings, points, normals, suns, diameter, samples, seed, numbers)
    parts = []
    for row in _launches(dr.arange(mi.UInt32, count), samples):
        parts.append(of_pairs(row, dr.gather(mi.UInt32, sun, row)))
        dr.eval(parts[-1])
    return dr.concat(parts) if parts else mi.Float()
