r"""Deposit by rough mirrors in few planes: lobes of the suns by exact directions, and the sky.

A rough mirror in few planes (`planar_mirrors`) shows a sun s as a lobe about its image. Of the
light that comes straight to the mirror and goes straight on to a receiver,

.. math:: D_b = \Omega_b \, \mathrm{E}\left[\frac{f(s, o) \cos\theta_s}{p(o)} \,
    \rho \tau V \cos\theta\right]

with s drawn from the sun's disk and the direction o from the mirror to the receiver from the lobe,
whose density is p. Rays go from the receiver along −o: they meet the mirror, or not, as its outline
and what stands before it decide, and from there a shadow ray goes to s. The random directions are
those of a mirror of reflectance 1; ρ is that of the surface that is met. For the sky, directions −o
are drawn from the receiver's hemisphere, and those to the sky from the lobe.

Limits: one rough mirror; what it sends on to other mirrors, and what they send to it, photons
follow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import TO_UNIT, disk_solid_angle, random_bits, sample_disk

from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.runtime.flat_arrays import flat, row_and_column
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.runtime.random_streams import shifted_point
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.rays.openings import Openings, Within
from drcmitsuba.transport.rays.shadow_rays import sun_numbers, visibility
from drcmitsuba.transport.rays.sun_clusters import WIDEST, possible_pairs

TAIL = 1e-4
"""Share of a lobe that is left out, the light farthest from a sun's image [–]."""


@dataclass(frozen=True)
class SunLobes:
    """Light of suns by way of the rough mirrors of one lobe."""

    images: ImageSuns
    """Way of rays to the mirrors."""
    mirror: MirrorMaterial
    """Mirror of the same lobe, of reflectance 1."""

    @classmethod
    def of(cls, scene: Scene) -> tuple[SunLobes, ...]:
        """Different lobes in a scene."""
        every = PlanarMirrors.rough(scene).items()
        return tuple(cls(ImageSuns(scene, mirrors), mirror) for mirror, mirrors in every)

    @cached_property
    def lobe(self) -> Any:
        """BSDF of the lobe."""
        return mi.load_dict(bsdf(self.mirror))

    @cached_property
    def widest(self) -> float:
        """Angle from an image of a sun within which its lobe lies [rad], but for `TAIL` of it."""
        alpha = self.mirror.roughness
        if self.mirror.distribution == "ggx":
            tangent = alpha * math.sqrt(1 / TAIL - 1)
        else:
            tangent = alpha * math.sqrt(-math.log(TAIL))
        return 2 * math.atan(tangent)

    def suns(
        self, points: mi.Float, normals: mi.Float, *,
        suns: np.ndarray, diameter: float, samples: int, seed: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by suns [sr], shape (point, sun).

        Parameters
        ----------
        samples : int
            Directions from the lobe for every point and sun, each of its own direction on the disk.
        points, normals, suns, diameter, seed, numbers, within
            As for `sun_deposit`.
        """
        images, count, n = self.images, dr.width(points) // 3, samples
        out = dr.zeros(mi.Float64, count * len(suns))
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        openings = Openings.of(images.scene, points, images.looks_out(within))
        drawn = _Drawn(
            self, points, normals, numbers, suns, diameter, openings, n,
            dr.opaque(mi.Float, disk_solid_angle(diameter) / n),
        )  # fmt: skip
        for axis in range(len(images.mirrors.axes)) if count and len(suns) else ():
            for pairs in self._possible(axis, drawn):
                block = max(1, SHADOW_RAYS // n)
                for start in range(0, dr.width(pairs), block):
                    some = dr.arange(mi.UInt32, min(block, dr.width(pairs) - start))
                    pair = dr.gather(mi.UInt32, pairs, some + dr.opaque(mi.UInt32, start))
                    dr.eval(pair)
                    drawn.add(axis, pair, seed + axis, out)
        return mi.TensorXf(mi.Float(out), (count, len(suns)))

    def _possible(self, axis: int, drawn: _Drawn) -> Iterator[mi.UInt32]:
        """Yield pairs point · suns + sun whose lobe may be seen in the mirrors of an axis."""
        suns, mirrors = drawn.suns, self.images.mirrors
        stride, wide = len(suns), self.widest + np.radians(drawn.diameter) / 2
        if wide > WIDEST:  # the lobe is all over the half-space
            every = dr.width(drawn.points) // 3 * stride
            for start in range(0, every, SHADOW_RAYS):
                yield dr.arange(mi.UInt32, min(SHADOW_RAYS, every - start)) + dr.opaque(
                    mi.UInt32, start
                )
            return
        n = mirrors.axes[axis]
        seen = suns - 2 * (suns @ n)[:, None] * n
        into = Openings(mirrors.seen[axis])
        spread, directions = dr.opaque(mi.Float, wide), flat(seen)
        p, normals = drawn.points, drawn.normals
        for pair in possible_pairs(into, p, normals, seen, 2 * math.degrees(wide)):
            if drawn.openings is None:
                yield pair
                continue
            row, sun = row_and_column(pair, stride)
            at, d = dr.gather(mi.Point3f, p, row), dr.gather(mi.Vector3f, directions, sun)
            kept = dr.compress(drawn.openings.passed(row, at, d, spread))
            if dr.width(kept):
                yield dr.gather(mi.UInt32, pair, kept)

    def sky(
        self, points: mi.Float, normals: mi.Float, *,
        subdivision: int, rays: int, seed: int, numbers: mi.UInt32 | None = None,
        within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by ground and sky patches [sr], shape (point, bin), as `sky_deposit`."""
        bins, count, images = len(Patches(subdivision)), dr.width(points) // 3, self.images
        out = dr.zeros(mi.Float64, count * bins)
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        share, stride = dr.opaque(mi.Float, np.pi / rays), dr.opaque(mi.UInt32, bins)
        every = images.towards_mirrors(points, normals, rays, seed, numbers, within)
        for row, ray, p, d in every:
            number = dr.gather(mi.UInt32, numbers, row)
            bits = random_bits(number, seed + 1, ray)
            uv = mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in bits))
            met = _LobeOnSky(self, d, uv, row * stride, subdivision, out)
            active = dr.full(mi.Bool, True, dr.width(row))
            dr.eval(images.followed(p, d, active, share, met), out)
        return mi.TensorXf(mi.Float(out), (count, bins))


@dataclass(frozen=True)
class _LobeRays:
    """Rays from points along a lobe."""

    p: mi.Point3f
    d: mi.Vector3f
    s: mi.Vector3f
    """Direction from the mirror to the sun."""
    share: mi.Float
    """cos θ f cos θ_s / p [–]."""
    passed: mi.Bool
    """Whether the mirror may be seen along d."""


@dataclass(frozen=True)
class _Drawn:
    """Directions that receivers draw from the lobes of suns."""

    lobes: SunLobes
    points: mi.Float
    normals: mi.Float
    numbers: mi.UInt32
    suns: np.ndarray
    diameter: float
    openings: Openings | None
    """Openings of the receivers' room."""
    n: int
    """Number of directions of each pair of a point and a sun."""
    weight: mi.Float
    """Solid angle of the sun's disk over `n` [sr]."""

    def add(self, axis: int, pair: mi.UInt32, seed: int, out: mi.Float64) -> None:
        """Add D of pairs point · suns + sun by the mirrors of an axis."""
        images = self.lobes.images
        lane = dr.arange(mi.UInt32, dr.width(pair) * self.n)
        kept = dr.compress(self._rays(axis, pair, lane, seed).passed)
        if not dr.width(kept):
            return
        images.scene.ray_counter.take("shadow", dr.width(kept))
        rays = self._rays(axis, pair, kept, seed)  # again: what lanes hold would fill the memory
        met = _InLobe(images.scene, axis, rays.s)
        active = dr.full(mi.Bool, True, dr.width(kept))
        D = self.weight * images.followed(rays.p, rays.d, active, rays.share, met)
        entry = dr.gather(mi.UInt32, pair, kept // self.n)
        dr.scatter_add(out, mi.Float64(D), entry, D > 0)
        dr.eval(out)

    def _rays(self, axis: int, pairs: mi.UInt32, lane: mi.UInt32, seed: int) -> _LobeRays:
        """Ray of each lane pair · n + direction."""
        mirrors = self.lobes.images.mirrors
        normal = mirrors.axes[axis]
        offsets = np.concatenate(mirrors.rectangles[axis]) @ normal
        lowest, highest = (dr.opaque(mi.Float, f(offsets)) for f in (np.min, np.max))
        frame = mi.Frame3f(mi.Normal3f(*(dr.opaque(mi.Float, float(x)) for x in normal)))
        pair, index = row_and_column(lane, self.n)
        row, sun = row_and_column(dr.gather(mi.UInt32, pairs, pair), len(self.suns))
        p = dr.gather(mi.Point3f, self.points, row)
        centre = dr.gather(mi.Vector3f, flat(self.suns), sun)
        high, at = dr.dot(centre, frame.n), dr.dot(p, frame.n)
        both = dr.select(high > 0, at > lowest, at < highest)  # on one side of a mirror
        number = dr.gather(mi.UInt32, self.numbers, row)
        place = dr.gather(mi.UInt32, mi.UInt32(sun_numbers(self.suns)), sun)
        uv = shifted_point(index, random_bits(number, seed, place))
        bits = random_bits(number, seed + 1, place + index)
        on_disk = mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in bits))
        s = sample_disk(centre, self.diameter, on_disk)
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(lane))
        si.n, si.sh_frame, si.wi = frame.n, frame, frame.to_local(s)
        bs, value = self.lobes.lobe.sample(mi.BSDFContext(), si, mi.Float(0.5), uv, both)
        d = -frame.to_world(bs.wo)
        cosine = dr.dot(dr.gather(mi.Normal3f, self.normals, row), d)
        passed = both & (value[0] > 0) & (cosine > 0)
        passed &= Openings(mirrors.seen[axis]).passed(row, p, d)
        if self.openings is not None:
            passed &= self.openings.passed(row, p, d)
        return _LobeRays(p, d, s, value[0] * cosine * dr.abs(si.wi.z / bs.wo.z), passed)


@dataclass(frozen=True)
class _LobeOnSky:
    """Adds light of ground and sky patches, which the lobe sends along −d."""

    lobes: SunLobes
    d: mi.Vector3f
    uv: mi.Point2f
    """Random numbers."""
    first: mi.UInt32
    """First entry of each ray's receiver in `out`."""
    subdivision: int
    out: mi.Float64

    def __call__(
        self, weight: mi.Float, axis: mi.UInt32, ray: mi.Ray3f, active: mi.Bool
    ) -> mi.Float:
        """Add the light; nothing of it counts once more."""
        scene, normals = self.lobes.images.scene, flat(self.lobes.images.mirrors.axes)
        normal = dr.gather(mi.Normal3f, normals, axis, active)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.n, si.sh_frame = normal, mi.Frame3f(normal)
        si.wi = si.to_local(-self.d)
        bs, value = self.lobes.lobe.sample(mi.BSDFContext(), si, mi.Float(0.5), self.uv, active)
        towards = si.to_world(bs.wo)
        lit = active & (value[0] > 0) & scene.effects.shines(towards)
        light = weight * value[0] * visibility(scene, mi.Ray3f(ray.o, towards), lit)
        entry = self.first + patch_index(towards, self.subdivision)
        dr.scatter_add(self.out, mi.Float64(light), entry, lit & (light > 0))
        return mi.Float(0)


@dataclass(frozen=True)
class _InLobe:
    """Counts light from directions s on mirrors of an axis."""

    scene: Scene
    axis: int
    s: mi.Vector3f

    def __call__(
        self, weight: mi.Float, axis: mi.UInt32, ray: mi.Ray3f, active: mi.Bool
    ) -> mi.Float:
        """Light that counts, as `image_suns.Met`."""
        active &= axis == self.axis
        reached = weight * visibility(self.scene, mi.Ray3f(ray.o, self.s), active)
        return dr.select(active, reached, 0)
