"""Surfaces as rays of an eye meet them: what they reflect diffusely, and how they turn rays."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.grazing import more_at_grazing

from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    SurfaceMaterial,
)
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.materials import bsdf, channel_of
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.rays.bsdf_lookup import number, table


class SurfaceKind(IntFlag):
    """Kinds of a surface; bits."""

    TURNS = 1
    """It turns rays."""
    POLISHED = 2
    """It is matt where it mirrors nothing."""
    GLAZING = 4
    SCATTERS = 8
    """It is a pane that scatters."""
    ROUGH = 16
    """It turns rays into a lobe."""
    ROUGH_MIRROR = 32


def _kinds(material: SurfaceMaterial) -> SurfaceKind:
    kinds = SurfaceKind(0)
    if isinstance(material, MirrorMaterial):
        rough = material.roughness > 0
        if material.specular > 0:
            kinds |= SurfaceKind.TURNS | (
                SurfaceKind.ROUGH | SurfaceKind.ROUGH_MIRROR if rough else SurfaceKind(0)
            )
        return kinds | (SurfaceKind.POLISHED if material.polished else SurfaceKind(0))
    if isinstance(material, DielectricMaterial):
        return SurfaceKind.TURNS | (SurfaceKind.ROUGH if material.roughness else SurfaceKind(0))
    if isinstance(material, GlazingMaterial):
        return SurfaceKind.GLAZING | SurfaceKind.TURNS
    if isinstance(material, BsdfMaterial | DiffuserMaterial):
        return SurfaceKind.SCATTERS | SurfaceKind.TURNS
    return kinds


def _diffuse(material: SurfaceMaterial, channel: int) -> tuple[float, float]:
    """Share of the light that front and back reflect diffusely towards an eye before them [–]."""
    if isinstance(material, Lambertian):
        front, back = material.sides
        return channel_of(front, channel), channel_of(back, channel)
    if isinstance(material, PorousMaterial):
        solid = (1 - material.porosity) * channel_of(material.reflectance, channel)
        return solid, solid
    if isinstance(material, MirrorMaterial):
        return material.matt, material.matt
    return 0.0, 0.0


def _mirroring(material: MirrorMaterial) -> MirrorMaterial:
    """Mirror without its diffuse part; where it is not polished, as if all light were mirrored."""
    rho = material.mirrored if material.polished else material.reflectance
    return material.model_copy(update={"specular": 1.0, "reflectance": rho})


class MetSurface(NamedTuple):
    """Surfaces that rays meet next."""

    si: mi.SurfaceInteraction3f
    hit: mi.Bool
    """Whether there is one."""
    part: mi.UInt32
    kinds: mi.UInt32
    """Bits of `SurfaceKind`."""
    back: mi.Bool
    """Whether the ray comes from behind."""
    bs: mi.BSDFSample3f
    """Direction in which it turns the ray."""
    straight: mi.Float
    turned: mi.Float
    matt: mi.Float
    """Shares of the light that pass straight on, that come by the turn, and that it reflects
    diffusely towards the ray [–]."""

    def has(self, kind: SurfaceKind) -> mi.Bool:
        """Whether there is a surface of a kind."""
        return self.hit & ((self.kinds & int(kind)) > 0)


@dataclass(frozen=True, eq=False)
class EyeOptics:
    """Optics of the parts of a scene."""

    part: mi.UInt32
    """Index of the part, by the number of its BSDF in the registry."""
    kinds: mi.UInt32
    """Bits of `SurfaceKind`, by part."""
    turning: tuple[Any, ...]
    """BSDFs by which parts turn rays, mirrors without their diffuse part."""
    numbers: mi.UInt32
    """Numbers of these in the registry, by part."""
    mirrored: mi.Float
    """Share of the light of a turn that counts, by part [–]."""
    matt: mi.Float
    """Share of the light that is reflected diffusely, flat (channel, part, side) [–]; the first
    channel is luminance."""

    @classmethod
    def of(cls, scene: Scene) -> EyeOptics:
        """Tabulate the parts of a scene."""
        materials = [part.material for part in scene.parts]
        turning = [
            mi.load_dict(bsdf(_mirroring(m))) if isinstance(m, MirrorMaterial) else part.bsdf
            for m, part in zip(materials, scene.parts, strict=True)
        ]
        share = [
            m.specular if isinstance(m, MirrorMaterial) and not m.polished else 1.0
            for m in materials
        ]
        matt = [_diffuse(m, channel) for channel in range(-1, 3) for m in materials]
        return cls(
            flat_indices(table(scene, range(len(materials)), np.uint32)),
            flat_indices([int(_kinds(m)) for m in materials]), tuple(turning),
            flat_indices([int(number(mi.BSDFPtr(b))[0]) for b in turning]), flat(share), flat(matt),
        )  # fmt: skip

    def diffuse(
        self, part: mi.UInt32, back: mi.Bool, cosine: mi.Float, channel: int, active: mi.Bool
    ) -> mi.Float:
        """Share of the light that surfaces reflect diffusely towards an eye [–].

        Parameters
        ----------
        part : mi.UInt32
        back : mi.Bool
            Whether the eye is behind them.
        cosine : mi.Float
            Cosine of the angle to their normal at which it sees them.
        channel : int
            Colour channel, −1 for luminance.
        active : mi.Bool
        """
        first = dr.opaque(mi.UInt32, 2 * (channel + 1) * len(self.turning))
        side = first + 2 * part + dr.select(back, mi.UInt32(1), 0)
        matt = dr.gather(mi.Float, self.matt, side, active)
        polished = (dr.gather(mi.UInt32, self.kinds, part, active) & int(SurfaceKind.POLISHED)) > 0
        return dr.select(polished, matt * (1 - more_at_grazing(cosine, dr.exp)), matt)

    def met(
        self, si: mi.SurfaceInteraction3f, d: mi.Vector3f, lobe: mi.Float, uv: mi.Point2f
    ) -> MetSurface:
        """Surfaces where rays along d meet them, turned by uniform random numbers.

        `si` has the direction back along the ray; it is not valid where a ray meets nothing.
        """
        hit, bsdf = si.is_valid(), si.bsdf()
        part = dr.gather(mi.UInt32, self.part, number(bsdf), hit)
        kinds = dr.gather(mi.UInt32, self.kinds, part, hit)
        back = hit & (dr.dot(si.n, d) > 0)
        clear = hit & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
        straight = dr.select(clear, bsdf.eval_null_transmission(si, clear)[0], 0)
        turns, ctx = hit & ((kinds & int(SurfaceKind.TURNS)) > 0), mi.BSDFContext()
        ctx.type_mask = int(mi.BSDFFlags.All) & ~int(mi.BSDFFlags.Null)
        which = dr.gather(mi.UInt32, self.numbers, part, turns)
        bs, value = dr.reinterpret_array(mi.BSDFPtr, which).sample(ctx, si, lobe, uv, turns)
        turned = value[0] * dr.gather(mi.Float, self.mirrored, part, turns)
        matt = self.diffuse(part, back, dr.abs(si.wi.z), -1, hit)
        return MetSurface(
            si, hit, part, kinds, back, bs, straight, dr.select(turns, turned, 0), matt
        )
