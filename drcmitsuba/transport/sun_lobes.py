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
from drcmitsuba.runtime.random_streams import shifted_point
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.image_suns import ImageSuns
from drcmitsuba.transport.launch_size import SHADOW_RAYS
from drcmitsuba.transport.openings import Openings, Within
from drcmitsuba.transport.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.shadow_rays import sun_numbers, visibility

DIRECTIONS = 8
"""Directions from a lobe for each direction on a sun's disk: most of them miss the mirror."""


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

    def suns(
        self, points: mi.Float, normals: mi.Float, *,
        suns: np.ndarray, diameter: float, samples: int, seed: int,
        numbers: mi.UInt32 | None = None, within: Within = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by suns [sr], shape (point, sun); parameters as for `sun_deposit`."""
        count, n = dr.width(points) // 3, DIRECTIONS * samples
        out = dr.zeros(mi.Float64, count * len(suns))
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        axes = range(len(self.images.mirrors.axes)) if count and len(suns) else ()
        weight = disk_solid_angle(diameter) / n
        for axis in axes:
            drawn = self._drawn(axis, points, normals, suns, diameter, n, seed + axis, numbers,
                                within)  # fmt: skip
            for entry, p, d, s, share in drawn:
                D = share * self._reached(axis, p, d, s) * dr.opaque(mi.Float, weight)
                dr.scatter_add(out, mi.Float64(D), entry, D > 0)
                dr.eval(out)
        return mi.TensorXf(mi.Float(out), (count, len(suns)))

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
        for row, p, d in every:
            number = dr.gather(mi.UInt32, numbers, row)
            bits = random_bits(number, seed + 1, dr.arange(mi.UInt32, dr.width(row)))
            uv = mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in bits))
            met = _OnSky(self, d, uv, row * stride, subdivision, out)
            active = dr.full(mi.Bool, True, dr.width(row))
            dr.eval(images.followed(p, d, active, share, met), out)
        return mi.TensorXf(mi.Float(out), (count, bins))

    def _drawn(
        self, axis: int, points: mi.Float, normals: mi.Float, suns: np.ndarray, diameter: float,
        n: int, seed: int, numbers: mi.UInt32, within: Within,
    ) -> Iterator[tuple[mi.UInt32, mi.Point3f, mi.Vector3f, mi.Vector3f, mi.Float]]:  # fmt: skip
        """Yield rays from points to mirrors of an axis.

        They are the entry point · suns + sun, the point, the direction to the mirror, that from
        there to the sun, and cos θ f cos θ_s / p.
        """
        scene, mirrors = self.images.scene, self.images.mirrors
        into = Openings(mirrors.seen[axis])
        out_of = Openings.of(scene, points, self.images.looks_out(within))
        normal = mirrors.axes[axis]
        offsets = np.concatenate(mirrors.rectangles[axis]) @ normal
        lowest, highest = (dr.opaque(mi.Float, f(offsets)) for f in (np.min, np.max))
        frame = mi.Frame3f(mi.Normal3f(*(dr.opaque(mi.Float, float(x)) for x in normal)))
        pairs, centres = dr.width(points) // 3 * len(suns), flat(suns)
        places, ctx = mi.UInt32(sun_numbers(suns)), mi.BSDFContext()
        block = max(1, SHADOW_RAYS // n)
        for start in range(0, pairs, block):
            lane = dr.arange(mi.UInt32, min(block, pairs - start) * n)
            pair, index = row_and_column(lane, n)
            pair += dr.opaque(mi.UInt32, start)
            row, sun = row_and_column(pair, len(suns))
            p = dr.gather(mi.Point3f, points, row)
            centre = dr.gather(mi.Vector3f, centres, sun)
            high, at = dr.dot(centre, frame.n), dr.dot(p, frame.n)
            both = dr.select(high > 0, at > lowest, at < highest)  # on one side of a mirror
            number, place = dr.gather(mi.UInt32, numbers, row), dr.gather(mi.UInt32, places, sun)
            uv = shifted_point(index, random_bits(number, seed, place))
            on_disk = random_bits(number, seed + 1, place + index)
            s = sample_disk(
                centre, diameter, mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in on_disk))
            )
            si = dr.zeros(mi.SurfaceInteraction3f, dr.width(lane))
            si.n, si.sh_frame = frame.n, frame
            si.wi = frame.to_local(s)
            bs, value = self.lobe.sample(ctx, si, mi.Float(0.5), uv, both)
            d = -frame.to_world(bs.wo)
            cosine = dr.dot(dr.gather(mi.Normal3f, normals, row), d)
            share = value[0] * cosine * dr.abs(si.wi.z / bs.wo.z)
            passed = both & (value[0] > 0) & (cosine > 0) & into.passed(row, p, d)
            if out_of is not None:
                passed &= out_of.passed(row, p, d)
            dr.eval(passed, pair, p, d, s, share)
            kept = dr.compress(passed)
            if dr.width(kept):
                rays = (pair, p, d, s, share)
                pair, p, d, s, share = (dr.gather(type(x), x, kept) for x in rays)
                dr.eval(pair, p, d, s, share)
                scene.ray_counter.take("shadow", dr.width(kept))
                yield pair, p, d, s, share

    def _reached(self, axis: int, p: mi.Point3f, d: mi.Vector3f, s: mi.Vector3f) -> mi.Float:
        """Reflectance of the mirrors that rays meet times the light that they get along s [–]."""
        met, active = _InLobe(self.images.scene, axis, s), dr.full(mi.Bool, True, dr.width(p))
        return self.images.followed(p, d, active, mi.Float(1), met)


@dataclass(frozen=True)
class _OnSky:
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
