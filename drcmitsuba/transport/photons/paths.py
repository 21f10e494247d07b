"""Paths of photons from surface to surface, and the flux that they add to cells and sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from drcmitsuba.scene.scene import Scene, ScenePart
from drcmitsuba.transport.mirrors.mirror_planes import MOST_IN_TURN
from drcmitsuba.transport.mirrors.planar_mirrors import PlanarMirrors
from drcmitsuba.transport.photons.changing_panes import ChangingPanes
from drcmitsuba.transport.photons.fluxes import COUNTS, FATES, FluxSums
from drcmitsuba.transport.photons.ports import Start
from drcmitsuba.transport.photons.receivers import CellAreas, Squares
from drcmitsuba.transport.photons.surfaces import Passed, PhotonScene
from drcmitsuba.transport.rays.bsdf_lookup import (
    absorption,
    absorption_after,
    number,
    share_left,
    table,
)

WEAK = 0.25
"""Share of its initial flux below which a photon undergoes roulette; survivors get this share."""
OFFSET = 64 * 2.0**-24
"""Distance off a surface at which a photon goes on, relative to 1 + its largest coordinate [m].

Mitsuba takes 1500 in place of 64. In a duct a hundred times as long as wide that is 1.3 % of the
width: photons meet the next wall too early, and 2 % of the light were lost after 115 mirrors.
Points are exact to some 4 · 2⁻²⁴.
"""
FILM, DIFFUSER, RECEIVES, CHANGES, IMAGES, LOBES, OWN = 1, 2, 4, 8, 16, 32, 64
"""Traits of a surface, as bits: it is a film of the room; it is a diffusing pane of the room; light
is deposited on it; it is one of `ChangingPanes`; it is one of `PlanarMirrors`; it is a rough one,
whose `sun_lobes` count. `OWN` times 1 + the number of its component among those of the photons."""
_STRAIGHT, _BY_PANES, _OWN, _IMAGED = 0, 1, 2, 3
"""Chain of a photon so far: undeviated, by panes only, deviated by its own component, by planar
mirrors only, of which `image_suns` and `sun_lobes` count the light."""


@dataclass(frozen=True)
class Traits:
    """Properties of surfaces that a photon needs, by the number of their BSDF."""

    bits: mi.UInt32
    """Sums of the traits, see `OWN`."""
    absorption: mi.Float | None
    """Absorption of solids [1/m]; None where nothing absorbs."""
    smooth: bool
    """Whether no surface scatters at random, apart from the choice to mirror or to refract."""
    imaged: bool
    """Whether light by way of mirrors that others find by its exact directions counts on cells.
    Light that these mirrors put on diffusing panes is left to the exact directions."""

    @classmethod
    def of(
        cls, scene: Scene, names: Sequence[str], panes: ChangingPanes | None, imaged: bool
    ) -> Traits:
        """Collect the traits of a scene's surfaces for photons of components of some names."""
        parts = scene.parts
        component = {name: OWN * number for number, name in enumerate(names, 1)}
        bits = [_bits(part) | component.get(part.component, 0) for part in parts]
        mirrors = PlanarMirrors.of(scene)
        if mirrors is not None:
            bits = [bit | IMAGES * (i in mirrors.parts) for i, bit in enumerate(bits)]
        for rough in PlanarMirrors.rough(scene).values():
            bits = [bit | LOBES * (i in rough.parts) for i, bit in enumerate(bits)]
        if panes is not None:
            changes = map(panes.have, parts)
            bits = [bit | CHANGES * change for bit, change in zip(bits, changes, strict=True)]
        smooth = all(_is_smooth(part.material) for part in parts)
        of_number = mi.UInt32(table(scene, bits, np.uint32))
        return cls(of_number, absorption(scene), smooth, imaged)


def _is_smooth(material: SurfaceMaterial) -> bool:
    if isinstance(material, MirrorMaterial | DielectricMaterial):
        return material.roughness == 0
    return isinstance(material, Lambertian | GlazingMaterial)


def _bits(part: ScenePart) -> int:
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
        self, passed: Passed, p: mi.Point3f, d: mi.Vector3f, length: mi.Float,
        column: mi.UInt32, bins: mi.UInt32, flux: mi.Float, mirrored: mi.Bool, sums: FluxSums,
        active: mi.Bool,
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
            light = mi.Float64(flux * passed.within(t))
            for layer in layers:
                sensor = dr.gather(mi.Int32, layer, index, crosses)
                meets = crosses & (sensor >= 0)
                row = mi.UInt32(sensor)
                half = dr.gather(mi.Float, self.half, row, meets)
                centre = dr.gather(mi.Point2f, self.centre, row, meets)
                off = dr.maximum(dr.abs(u - centre.x), dr.abs(v - centre.y))
                meets &= off < half
                at = row * bins + column
                dr.scatter_add(sums.sensors, light, at, meets)
                dr.scatter_add(sums.mirrored, light, at, meets & mirrored)
                dr.scatter_add(sums.inner, light, at, meets & (2 * off < half))


def _onward(si: mi.SurfaceInteraction3f, d: mi.Vector3f) -> mi.Ray3f:
    """Ray that leaves a surface in a direction."""
    away = OFFSET * (1 + dr.max(dr.abs(si.p)))
    return mi.Ray3f(si.p + dr.mulsign(away, dr.dot(si.n, d)) * si.n, d)


def _deviated(chain: mi.UInt32, bits: mi.UInt32, turns: mi.UInt32) -> mi.UInt32:
    """Chain of photons that a surface with some traits has deviated, after some planar mirrors."""
    first_film = ((bits & FILM) != 0) & (chain == _STRAIGHT)
    by_panes = first_film | (((bits & DIFFUSER) != 0) & (chain != _OWN))
    imaged = ((bits & IMAGES) != 0) & (turns < MOST_IN_TURN)
    imaged &= (chain == _STRAIGHT) | (chain == _IMAGED)
    imaged |= ((bits & LOBES) != 0) & (chain == _STRAIGHT) & (turns == 0)
    onward = dr.select(imaged, mi.UInt32(_IMAGED), mi.UInt32(_OWN))
    return dr.select(by_panes, mi.UInt32(_BY_PANES), onward)


@symbolic
def follow(
    scene: PhotonScene, traits: Traits, areas: CellAreas, squares: Recorder, start: Start,
    sums: FluxSums, bins: mi.UInt32, limit: mi.UInt32, random: mi.PCG32, scatter: mi.PCG32,
) -> mi.Bool:  # fmt: skip
    """Follow photons to their end and add their flux to `sums`.

    Surfaces that scatter draw from a generator of their own: a photon that meets none of them must
    not depend on whether the scene has one.

    Returns
    -------
    mi.Bool
        Whether each photon met a pane that may change.
    """
    ctx = mi.BSDFContext(mi.TransportMode.Importance)
    ray, before = mi.Ray3f(start.p, start.d), mi.Point3f(start.p)
    flux, weak = mi.Float(start.flux), WEAK * start.flux
    landed, absorbed, escaped, others, lost, roulette = (mi.Float(0) for _ in range(6))
    inside = mi.Float(0)  # absorption of the solid that the photon is in
    chain, step, turns = mi.UInt32(_STRAIGHT), mi.UInt32(0), mi.UInt32(0)
    mirrored, active = mi.Bool(True), mi.Bool(True)
    by_pane = mi.Bool(start.by_pane)
    while dr.hint(
        active, exclude=[scene, traits, areas, squares, start, sums, bins, limit, ctx, weak]
    ):
        si = scene.intersect(ray, active)
        met = active & si.is_valid()
        counts = chain == _OWN
        column = start.bin + dr.select(by_pane, sums.half.squares, 0)
        passed = scene.passed(ray.o, ray.d, active)
        squares.record(
            passed, ray.o, ray.d, si.t, column, bins, flux, mirrored, sums, active & counts
        )
        if dr.hint(traits.imaged, mode="scalar"):
            counts |= chain == _IMAGED
        if dr.hint(scene.panes is not None, mode="scalar"):
            through = flux * passed.within(si.t)
            absorbed += flux - through
            flux = through
        escaped += dr.select(active & ~met, flux, 0)
        if dr.hint(traits.absorption is not None, mode="scalar"):
            # The path runs from surface to surface: the ray began a little off the last one.
            left = share_left(inside, si.p - before)
            absorbed += dr.select(met, flux * (1 - left), 0)
            flux = dr.select(met, flux * left, flux)
        bsdf, uv = si.bsdf(), mi.Point2f(0.5)  # random numbers take a seventh of the time
        if dr.hint(not traits.smooth, mode="scalar"):
            uv = mi.Point2f(scatter.next_float32(), scatter.next_float32())
        bs, weight = bsdf.sample(ctx, si, random.next_float32(), uv, met)
        bits = dr.gather(mi.UInt32, traits.bits, number(bsdf), met)
        receives = (bits & RECEIVES) != 0
        by_pane |= (bits & CHANGES) != 0
        column = start.bin + dr.select(by_pane, sums.half.cells, 0)
        areas.record(si, ray.d, flux, column, bins, sums.cells, receives & counts)
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
        foreign = deviates & (chain == _STRAIGHT) & (bits // OWN != start.component + 1)
        others += dr.select(foreign, flux, 0)
        chain = dr.select(deviates, _deviated(chain, bits, turns), chain)
        lobe = (bits & LOBES) != 0  # nothing in turn with it has an image
        turns += dr.select(deviates, dr.select(lobe, mi.UInt32(MOST_IN_TURN), 1), 0)
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
    column = start.bin + dr.select(by_pane, sums.half.fates, 0)
    column += start.component * (len(FATES) + len(COUNTS)) * bins
    one = mi.Float(1)
    values = (start.flux, landed, absorbed, escaped, others, lost, roulette, one, mi.Float(step))
    for fate, value in enumerate(values):
        at = fate * bins + column
        dr.scatter_add(sums.fates, mi.Float64(value), at, mode=dr.ReduceMode.Local)
    return by_pane
