r"""Sun in mirrors that rays of the eye meet: what counts exactly, and what is left to chance.

Planar mirrors show the sun's disk by exact geometry, see `Outside.disk_in`. At a rough mirror a
point of the disk is drawn, and the mirror's BSDF tells how much of its light goes to the eye. Rays
go on, and may leave the scene within the disk: then they count the share of its light that nothing
else counts,

* 0 after planar mirrors in turn that are one of their chains;
* :math:`p\Omega / (1 + p\Omega)` after a rough mirror, where p is the density of their direction
  and Ω the disk's solid angle; the point of the disk counts :math:`1 / (1 + p\Omega)`;
* 1 after anything else, such as curved mirrors and clear solids.

Limits: sun by way of a rough mirror and another mirror is found by chance.

References
----------
.. [1] E. Veach and L. Guibas, "Optimally combining sampling techniques for Monte Carlo rendering",
   SIGGRAPH 1995 (the balance heuristic).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.bsdf_lookup import bsdfs, number, table
from drcmitsuba.transport.image_suns import ImageSuns
from drcmitsuba.transport.planar_mirrors import MOST_AXES, MOST_IN_TURN, NONE
from drcmitsuba.transport.shadow_rays import straight

BASE = MOST_AXES + 1
OTHER = BASE**MOST_IN_TURN
"""Ways of rays: 0 without a turn, way · `BASE` + axis + 1 after one more planar mirror, and `OTHER`
after anything else."""


def _is_rough(material: object) -> bool:
    return isinstance(material, MirrorMaterial) and material.roughness > 0 and material.specular > 0


@dataclass(frozen=True)
class MirroredSun:
    """Mirrors of a scene, as rays of the eye meet them."""

    images: ImageSuns | None
    """Planar mirrors; None without any."""
    listed: mi.Bool
    """Whether a way is a chain of planar mirrors, shape (way,)."""
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
        listed = np.zeros(OTHER + 1, bool)
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

    def turned(
        self, way: mi.UInt32, share: mi.Float, si: mi.SurfaceInteraction3f,
        bs: mi.BSDFSample3f, turns: mi.Bool,
    ) -> tuple[mi.UInt32, mi.Float]:  # fmt: skip
        """Way of rays after a surface, and the share of the sun's light that they count [–].

        Parameters
        ----------
        way, share
            The same before the surface.
        si, bs
            Rays at the surface, and their directions after it.
        turns
            Rays that do not pass straight.
        """
        onward, counted = mi.UInt32(OTHER), mi.Float(1)
        if self.images is not None:
            smooth = turns & mi.has_flag(bs.sampled_type, mi.BSDFFlags.DeltaReflection)
            axis, _ = self.images.mirrors.met(si, si.wi.z, smooth)
            follows = (axis != NONE) & (way < OTHER // BASE)
            onward = dr.select(follows, way * BASE + axis + 1, OTHER)
            counted = dr.select(dr.gather(mi.Bool, self.listed, onward), mi.Float(0), 1)
        if self.rough is not None:
            glossy = turns & mi.has_flag(bs.sampled_type, mi.BSDFFlags.GlossyReflection)
            glossy &= self.glossy(si.bsdf(), glossy) != NONE
            p = si.bsdf().pdf(_glossy(), si, bs.wo, glossy) * dr.opaque(mi.Float, self.solid_angle)
            counted = dr.select(glossy, p / (1 + p), counted)
        return dr.select(turns, onward, way), dr.select(turns, counted, share)


def _glossy() -> mi.BSDFContext:
    """Context of the mirrored light of a rough mirror, without its diffuse light."""
    ctx = mi.BSDFContext()
    ctx.type_mask = +mi.BSDFFlags.GlossyReflection
    return ctx


def seen_in_rough(
    scene: Scene, part: mi.UInt32, p: mi.Point3f, n: mi.Normal3f, d: mi.Vector3f, *,
    sun: np.ndarray, diameter: float, uv: mi.Point2f,
) -> mi.Float:  # fmt: skip
    """Luminance that rough mirrors show per luminance of the sun, as far as rays do not count it.

    Parameters
    ----------
    scene : Scene
    part : mi.UInt32
        Parts of the scene that are rough mirrors.
    p, n, d
        Places on them, off the surface [m], normals, and directions from the eye.
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
    s = sample_disk(dr.opaque(mi.Vector3f, list(map(float, sun))), diameter, uv)
    bsdf, wo, omega = bsdfs(scene, part), si.to_local(s), disk_solid_angle(diameter)
    f = bsdf.eval(_glossy(), si, wo)[0]
    by_rays = bsdf.pdf(_glossy(), si, wo) * dr.opaque(mi.Float, omega)
    tau = straight(scene, p, s, f > 0)
    return dr.select(tau > 0, f * tau * dr.opaque(mi.Float, omega) / (1 + by_rays), 0)
