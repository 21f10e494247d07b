"""Paths of photons from surface to surface, and the flux that they add to cells and sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    SurfaceMaterial,
)
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.materials import is_diffuse
from drcmitsuba.scene.scene import Part
from drcmitsuba.transport.bsdf_lookup import (
    absorption,
    absorption_after,
    number,
    share_left,
    table,
)
from drcmitsuba.transport.ports import ComponentPorts, Start
from drcmitsuba.transport.receivers import CellAreas, Squares

WEAK = 0.25
"""Share of its initial flux below which a photon undergoes roulette; survivors get this share."""

OFFSET = 64 * 2.0**-24
"""Distance off a surface at which a photon goes on, relative to 1 + its largest coordinate [m].

Mitsuba takes 1500 in place of 64. In a duct a hundred times as long as wide that is 1.3 % of the
width: photons meet the next wall too early, and 2 % of the light were lost after 115 mirrors.
Points are exact to some 4 · 2⁻²⁴.
"""

OWN, FILM, DIFFUSER, RECEIVES = 1, 2, 4, 8
"""Traits of a surface, as bits: it belongs to the photon's component; it is a film of the room; it
is a diffusing pane of the room; light is deposited on it."""
_STRAIGHT, _BY_PANES, _OWN = 0, 1, 2
"""Chain of a photon so far: undeviated, by panes only, deviated by its own component."""


class FluxSums(NamedTuple):
    """Flux per unit radiance [m² sr] of one kind of bins, in double precision against drift."""

    cells: mi.Float64
    """Flux onto the rows of `CellAreas`, shape (row · bin,)."""
    sensors: mi.Float64
    """Flux through the squares, shape (sensor · bin,)."""
    mirrored: mi.Float64
    """Part of `sensors` that only smooth surfaces have deviated, shape (sensor · bin,)."""
    inner: mi.Float64
    """Flux of all bins through the middle quarter of the squares, shape (sensor,)."""


@dataclass(frozen=True)
class Traits:
    """Properties of surfaces that a photon needs, by the number of their BSDF."""

    bits: mi.UInt32
    """Sums of `OWN`, `FILM`, `DIFFUSER` and `RECEIVES`."""
    absorption: mi.Float | None
    """Absorption of solids [1/m]; None where nothing absorbs."""
    smooth: bool
    """Whether no surface scatters at random, apart from the choice to mirror or to refract."""

    @classmethod
    def of(cls, ports: ComponentPorts) -> Traits:
        """Collect the traits of a scene's surfaces for photons from the given ports."""
        scene, parts = ports.scene, ports.scene.parts
        bits = [_bits(part) | (OWN if part.component == ports.name else 0) for part in parts]
        smooth = all(_is_smooth(part.material) for part in parts)
        return cls(mi.UInt32(table(scene, bits, np.uint32)), absorption(scene), smooth)


def _is_smooth(material: SurfaceMaterial) -> bool:
    if isinstance(material, MirrorMaterial | DielectricMaterial):
        return material.roughness == 0
    return isinstance(material, Lambertian | GlazingMaterial)


def _bits(part: Part) -> int:
    """Traits of a part without `OWN`."""
    if part.component or not isinstance(part.material, BsdfMaterial | DiffuserMaterial):
        return RECEIVES if is_diffuse(part.material) else 0
    return FILM if isinstance(part.material, BsdfMaterial) else DIFFUSER


class Recorder:
    """Squares around sensors on the device, and the test of which of them photons cross."""

    def __init__(self, squares: Squares):
        self.centre, self.half = flat(squares.centre), flat(squares.edge / 2)
        self.planes = []
        for plane in squares.planes:
            # Opaque: as literals they would have the kernel compiled anew for every case.
            origin, x, y, n = (
                mi.Vector3f(*(dr.opaque(mi.Float, float(c)) for c in vector))
                for vector in (plane.origin, *plane.axes)
            )
            edge = dr.opaque(mi.Float, plane.edge)
            count = tuple(dr.opaque(mi.UInt32, c) for c in plane.count)
            layers = [mi.Int32(layer.astype(np.int32)) for layer in plane.sensors]
            self.planes.append((origin, x, y, n, edge, count, layers))

    def record(
        self, p: mi.Point3f, d: mi.Vector3f, length: mi.Float, column: mi.UInt32,
        bins: mi.UInt32, flux: mi.Float, mirrored: mi.Bool, sums: FluxSums, active: mi.Bool,
    ) -> None:  # fmt: skip
        """Add the flux of photons that fly from `p` over `length` to the squares they cross."""
        for origin, x, y, n, edge, count, layers in self.planes:
            down = dr.dot(d, n)
            t = dr.dot(origin - p, n) / down
            at = p + t * d
            u, v = dr.dot(at, x), dr.dot(at, y)
            i = dr.floor((u - dr.dot(origin, x)) / edge)
            j = dr.floor((v - dr.dot(origin, y)) / edge)
            crosses = active & (down < 0) & (t > 0) & (t <= length) & (i >= 0) & (j >= 0)
            crosses &= (i < mi.Float(count[0])) & (j < mi.Float(count[1]))
            index = mi.UInt32(j) * count[0] + mi.UInt32(i)
            for layer in layers:
                sensor = dr.gather(mi.Int32, layer, index, crosses)
                meets = crosses & (sensor >= 0)
                row = mi.UInt32(sensor)
                half = dr.gather(mi.Float, self.half, row, meets)
                centre = dr.gather(mi.Point2f, self.centre, row, meets)
                off = dr.maximum(dr.abs(u - centre.x), dr.abs(v - centre.y))
                meets &= off < half
                light, at = mi.Float64(flux), row * bins + column
                dr.scatter_add(sums.sensors, light, at, meets)
                dr.scatter_add(sums.mirrored, light, at, meets & mirrored)
                dr.scatter_add(sums.inner, light, row, meets & (2 * off < half))


def _onward(si: mi.SurfaceInteraction3f, d: mi.Vector3f) -> mi.Ray3f:
    """Ray that leaves a surface in a direction."""
    away = OFFSET * (1 + dr.max(dr.abs(si.p)))
    return mi.Ray3f(si.p + dr.mulsign(away, dr.dot(si.n, d)) * si.n, d)


def _deviated(chain: mi.UInt32, bits: mi.UInt32) -> mi.UInt32:
    """Chain of photons that a surface with some traits has deviated."""
    first_film = ((bits & FILM) != 0) & (chain == _STRAIGHT)
    by_panes = first_film | (((bits & DIFFUSER) != 0) & (chain != _OWN))
    return dr.select(by_panes, mi.UInt32(_BY_PANES), mi.UInt32(_OWN))


@symbolic
def follow(
    scene: mi.Scene, traits: Traits, areas: CellAreas, squares: Recorder, start: Start,
    sums: FluxSums, bins: mi.UInt32, limit: mi.UInt32, random: mi.PCG32,
) -> tuple[mi.Float, ...]:  # fmt: skip
    """Follow photons to their end and add their flux to `sums`.

    Returns
    -------
    tuple of mi.Float
        Flux of every lane by fate [m² sr], as `FluxLedger` from `landed` on; number of segments.
    """
    ctx = mi.BSDFContext(mi.TransportMode.Importance)
    flags = mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame
    ray, before = mi.Ray3f(start.p, start.d), mi.Point3f(start.p)
    flux, weak = mi.Float(start.flux), WEAK * start.flux
    landed, absorbed, escaped, others, lost, roulette = (mi.Float(0) for _ in range(6))
    inside = mi.Float(0)  # absorption of the solid that the photon is in
    chain, step = mi.UInt32(_STRAIGHT), mi.UInt32(0)
    mirrored, active = mi.Bool(True), mi.Bool(True)
    while dr.hint(
        active, exclude=[scene, traits, areas, squares, start, sums, bins, limit, ctx, weak]
    ):
        si = scene.ray_intersect(ray, flags, coherent=False, active=active)
        met = active & si.is_valid()
        counts = chain == _OWN
        squares.record(ray.o, ray.d, si.t, start.bin, bins, flux, mirrored, sums, active & counts)
        escaped += dr.select(active & ~met, flux, 0)
        if dr.hint(traits.absorption is not None, mode="scalar"):
            # The path runs from surface to surface: the ray began a little off the last one.
            left = share_left(inside, si.p - before)
            absorbed += dr.select(met, flux * (1 - left), 0)
            flux = dr.select(met, flux * left, flux)
        si.wi = si.to_local(-ray.d)
        bsdf, uv = si.bsdf(), mi.Point2f(0.5)  # random numbers take a seventh of the time
        if dr.hint(not traits.smooth, mode="scalar"):
            uv = mi.Point2f(random.next_float32(), random.next_float32())
        bs, weight = bsdf.sample(ctx, si, random.next_float32(), uv, met)
        bits = dr.gather(mi.UInt32, traits.bits, number(bsdf), met)
        receives = (bits & RECEIVES) != 0
        areas.record(si, ray.d, flux, start.bin, bins, sums.cells, receives & counts)
        # A surface may take a part and mirror the rest.
        diffuse = mi.has_flag(bs.sampled_type, mi.BSDFFlags.DiffuseReflection)
        onward = met & ~(receives & diffuse)
        after = dr.select(onward, flux * weight[0], 0)
        taken = dr.select(met, flux - after, 0)
        landed += dr.select(receives & counts, taken, 0)
        others += dr.select(receives & ~counts, taken, 0)
        absorbed += dr.select(receives, 0, taken)
        flux = after

        deviates = onward & ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        foreign = deviates & (chain == _STRAIGHT) & ((bits & OWN) == 0)
        others += dr.select(foreign, flux, 0)
        chain = dr.select(deviates, _deviated(chain, bits), chain)
        mirrored &= ~deviates | mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        if dr.hint(traits.absorption is not None, mode="scalar"):
            inside = absorption_after(traits.absorption, bsdf, bs, inside, deviates)
            before = si.p

        step += 1
        active = onward & ~foreign & (flux > 0)
        lost += dr.select(active & (step >= limit), flux, 0)
        active &= step < limit
        faint = active & (flux < weak)
        kept = dr.select(random.next_float32() * weak < flux, weak, 0)
        roulette += dr.select(faint, kept - flux, 0)
        flux = dr.select(faint, kept, flux)
        active &= flux > 0
        ray = _onward(si, si.to_world(bs.wo))
    return landed, absorbed, escaped, others, lost, roulette, mi.Float(step)
