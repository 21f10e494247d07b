"""The sun of an hour on the surfaces that rays of a view show, by its exact disk."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.sampling import TO_UNIT, disk_solid_angle, random_bits, sample_disk

from drcmitsuba.eye.mirrored_sun import seen_in_rough
from drcmitsuba.rendering.outside import OutsideLuminances
from drcmitsuba.rendering.pixel_paths import PixelPaths
from drcmitsuba.rendering.surface_light import Glowing
from drcmitsuba.rendering.traced_view import TracedView
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.transport.films.peaks import peak_deposit
from drcmitsuba.transport.rays.shadow_rays import straight

PEAK_RAYS = 4
"""Largest number of directions along the peaks of a film from each surface that a ray shows."""

LOBE_RAYS = 4
"""Directions from the lobe of the sun in rough mirrors, from each surface that a ray shows."""


def in_rough_mirrors(traced: TracedView, paths: PixelPaths, outside: OutsideLuminances) -> mi.Float:
    """Luminance that rough mirrors show of the sun [cd/m²]."""
    number = dr.arange(mi.UInt32, dr.width(paths.rough)) + dr.opaque(mi.UInt32, paths.first)
    with traced.scene.ray_counter.purpose(Stream.EYE_SUN.name):
        share = seen_in_rough(
            traced.scene, paths.rough_part, mi.Point3f(paths.rough_p), mi.Normal3f(paths.rough_n),
            paths.rough_d, images=traced.images, sun=outside.direction,
            diameter=outside.diameter, uv=_on_disk(traced, number, 2),
        )  # fmt: skip
    return share * outside.sun


def _on_disk(traced: TracedView, number: mi.UInt32, purpose: int) -> mi.Point2f:
    """Random numbers that draw points of the sun's disk."""
    seed = launch_seed(traced.light.base.accuracy.seed, Stream.EYE_SUN) ^ purpose
    return mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in random_bits(number, seed)))


def direct_sun(traced: TracedView, paths: PixelPaths, outside: OutsideLuminances) -> mi.Float:
    """Irradiance of the surfaces by the sun through openings and clear panes [lx]."""
    number = dr.arange(mi.UInt32, dr.width(paths.weight)) + dr.opaque(mi.UInt32, paths.first)
    centre = dr.opaque(mi.Vector3f, list(map(float, outside.direction)))
    d = sample_disk(centre, outside.diameter, _on_disk(traced, number, 0))
    cosine = dr.dot(paths.n, d)
    with traced.scene.ray_counter.purpose(Stream.EYE_SUN.name):
        tau = straight(traced.scene, mi.Point3f(paths.p), d, cosine > 0)
    E = dr.opaque(mi.Float, outside.sun * disk_solid_angle(outside.diameter))
    return dr.select(tau > 0, tau * cosine * E, 0)


def in_mirrors(traced: TracedView, paths: PixelPaths, outside: OutsideLuminances) -> mi.Float:
    """Irradiance of the surfaces by the sun in planar mirrors and in rough ones [lx]."""
    seed, E = launch_seed(traced.light.base.accuracy.seed, Stream.EYE_SUN), mi.Float(0)
    number = dr.arange(mi.UInt32, dr.width(paths.weight)) + dr.opaque(mi.UInt32, paths.first)
    points, normals = dr.ravel(paths.p), dr.ravel(paths.n)
    kind: dict[str, Any] = {
        "suns": outside.direction[None], "diameter": outside.diameter, "numbers": number,
    }  # fmt: skip
    with traced.scene.ray_counter.purpose(Stream.EYE_SUN.name):
        if traced.images is not None:
            D = traced.images.suns(points, normals, samples=1, seed=seed ^ 1, **kind)
            E += D.array * outside.sun
        for i, lobe in enumerate(traced.lobes):
            D = lobe.suns(points, normals, samples=LOBE_RAYS, seed=seed ^ (3 + i) << 8, **kind)
            E += D.array * outside.sun
    return E


def along_peaks(
    traced: TracedView, paths: PixelPaths, outside: OutsideLuminances, glow: Glowing
) -> mi.Float:
    """Irradiance of the surfaces by the sun in the narrow peaks of films [lx]."""
    films, E = traced.glow.table.films, mi.Float(0)
    number = dr.arange(mi.UInt32, dr.width(paths.weight)) + dr.opaque(mi.UInt32, paths.first)
    seed = launch_seed(traced.light.base.accuracy.seed, Stream.EYE_PEAKS)
    for peaks in glow.peaks:
        assert films is not None
        with traced.scene.ray_counter.purpose(Stream.EYE_PEAKS.name):
            D = peak_deposit(
                traced.scene, films.patches, films.mounts[peaks.owner], peaks, dr.ravel(paths.p),
                dr.ravel(paths.n), suns=outside.direction[None], diameter=outside.diameter,
                most=PEAK_RAYS, seed=seed, numbers=number,
            )  # fmt: skip
        E += D.array * outside.sun
    return E
