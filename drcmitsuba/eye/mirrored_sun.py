r"""Sun in mirrors that rays of the eye meet: what counts exactly, and what is left to chance.

Planar mirrors show the sun's disk by exact geometry, see `OutsideLuminances.disk_in`. At a rough
mirror a point of the disk is drawn, and of each of its images in planar mirrors, and the BSDF tells
how much of its light goes to the eye. Rays go on, and may leave the scene within the disk: then
they count the share of its light that nothing else counts,

* 0 after planar mirrors in turn that are one of their chains;
* :math:`p\Omega / (1 + p\Omega)` after a rough mirror, and such a chain or none behind it, where p
  is the density of their direction from the rough mirror and Ω the disk's solid angle; the point of
  the disk counts :math:`1 / (1 + p\Omega)`;
* 1 after anything else, such as curved mirrors and clear solids.

References
----------
.. [1] E. Veach and L. Guibas, "Optimally combining sampling techniques for Monte Carlo rendering",
   SIGGRAPH 1995 (the balance heuristic).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.mirror_planes import MOST_AXES, MOST_IN_TURN
from drcmitsuba.transport.mirrors.planar_mirrors import NONE
from drcmitsuba.transport.rays.bsdf_lookup import bsdfs, number, table
from drcmitsuba.transport.rays.shadow_rays import straight

BASE = MOST_AXES + 1
OTHER = BASE**MOST_IN_TURN
"""Ways of rays: 0 without a turn, and after a rough mirror; way · `BASE` + axis + 1 after one more
planar mirror; and `OTHER` after anything else."""


def _is_rough(material: object) -> bool:
    return isinstance(material, MirrorMaterial) and material.roughness > 0 and material.specular > 0


@dataclass(frozen=True)
class MirroredSun:
    """Mirrors of a scene, as rays of the eye meet them."""

    images: ImageSuns | None
    """Planar mirrors; None without any."""
    listed: mi.Bool
    """Whether a way is a chain of planar mirrors, or none, shape (way,)."""
    rough: mi.UInt32 | None
    """Part of the scene of each rough mirror plus 1, by the number of its BSDF, 0 of anything else;
    None without rough mirrors."""
    solid_angle: float
    """Solid angle of the sun's disk [sr]."""

    @classmethod
    def of(cls, scene: Scene, images: ImageSuns | None, diameter: float) -> MirroredSun:
        """Mirrors of a scene, for a sun of an angle across [deg]."""
        parts = [_is_rough(part.material) * (i + 1) for i, part in enumerate(scene.parts)]
        rough = flat_indices(table(scene, parts, np.uint32)) if any(parts) else None
        listed = np.arange(OTHER + 1) == 0
        for chain in () if images is None else images.mirrors.chains:
            way = 0
            for axis in chain:
                way = way * BASE + axis + 1
            listed[way] = True
        return cls(images, mi.Bool(listed), rough, disk_solid_angle(diameter))

    def glossy(self, bsdf: mi.BSDFPtr, active: mi.Bool) -> mi.UInt32:
        """Part of the scene of the rough mirrors that rays meet; `NONE` for anything else."""
        assert self.rough is not None
        return dr.gather(mi.UInt32, self.rough, number(bsdf), active) - 1  # 0 - 1 is NONE

    def share(self, way: mi.UInt32, lobe: mi.Float) -> mi.Float:
        """Share of the sun's light that rays count after their way [–]; `lobe` as of `turned`."""
        return dr.select(dr.gather(mi.Bool, self.listed, way), lobe, 1)

    def turned(
        self, way: mi.UInt32, lobe: mi.Float, si: mi.SurfaceInteraction3f,
        bs: mi.BSDFSample3f, turns: mi.Bool,
    ) -> tuple[mi.UInt32, mi.Float]:  # fmt: skip
        """Way of rays after a surface, and the share that they count after their rough mirror [–].

        Parameters
        ----------
        way, lobe
            The same before the surface.
        si, bs
            Rays at the surface, and their directions after it.
        turns
            Rays that do not pass straight.
        """
        onward, counted = mi.UInt32(OTHER), mi.Float(lobe)
        if self.images is not None:
            smooth = turns & mi.has_flag(bs.sampled_type, mi.BSDFFlags.DeltaReflection)
            axis, _ = self.images.mirrors.met(si, si.wi.z, smooth)
            follows = (axis != NONE) & (way < OTHER // BASE)
            onward = dr.select(follows, way * BASE + axis + 1, OTHER)
        if self.rough is not None:
            glossy = turns & mi.has_flag(bs.sampled_type, mi.BSDFFlags.GlossyReflection)
            glossy &= self.glossy(si.bsdf(), glossy) != NONE
            p = si.bsdf().pdf(_glossy(), si, bs.wo, glossy) * dr.opaque(mi.Float, self.solid_angle)
            onward, counted = dr.select(glossy, 0, onward), dr.select(glossy, p / (1 + p), counted)
        return dr.select(turns, onward, way), counted


def _glossy() -> mi.BSDFContext:
    """Context of the mirrored light of a rough mirror, without its diffuse light."""
    ctx = mi.BSDFContext()
    ctx.type_mask = +mi.BSDFFlags.GlossyReflection
    return ctx


def seen_in_rough(
    scene: Scene, part: mi.UInt32, p: mi.Point3f, n: mi.Normal3f, d: mi.Vector3f, *,
    images: ImageSuns | None, sun: np.ndarray, diameter: float, uv: mi.Point2f,
) -> mi.Float:  # fmt: skip
    """Luminance that rough mirrors show per luminance of the sun, as far as rays do not count it.

    Parameters
    ----------
    scene : Scene
    part : mi.UInt32
        Parts of the scene that are rough mirrors.
    p, n, d
        Places on them, off the surface [m], normals, and directions from the eye.
    images : ImageSuns, optional
        Planar mirrors, by way of which the sun shines on the rough ones as well.
    sun : np.ndarray, shape (3,)
        Unit vector to the sun.
    diameter : float
        Angle across the sun [deg].
    uv : mi.Point2f
        Random numbers, which draw a point of the disk for each place.

    Returns
    -------
    mi.Float
        Luminance over that of the sun [–].
    """
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(part))
    si.p, si.n, si.sh_frame = p, n, mi.Frame3f(n)
    si.wi = si.to_local(-d)
    bsdf, omega = bsdfs(scene, part), dr.opaque(mi.Float, disk_solid_angle(diameter))

    def shown(centre: np.ndarray, reached: Callable[..., mi.Float]) -> mi.Float:
        s = sample_disk(dr.opaque(mi.Vector3f, list(map(float, centre))), diameter, uv)
        wo = si.to_local(s)
        f = bsdf.eval(_glossy(), si, wo)[0]
        by_rays = bsdf.pdf(_glossy(), si, wo) * omega
        tau = reached(p, s, f > 0)
        return dr.select(tau > 0, f * tau * omega / (1 + by_rays), 0)

    total = shown(sun, partial(straight, scene))
    if images is None:
        return total
    for chain in images.mirrors.chains:
        (centre,), (may,) = images.mirrors.images(chain, sun[None])
        if may:
            total += shown(centre, partial(images.reached, chain))
            dr.eval(total)
    return total
