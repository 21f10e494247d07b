r"""Glow of films and rough mirrors: their luminance to an eye per unit luminance of sky and suns.

A film that is seen along d from a point p glows with

.. math:: L = \int f(\omega \to -d)\, |\cos\theta|\, V(p, \omega)\, L(\omega)\, d\omega .

For ground and sky, directions are drawn from the BSDF; a sun's disk is met with its exact direction
and shadow rays. f has the resolution of its file: a peak that is narrower than an outgoing cell is
spread over the cell, as wide and as dim as the cell makes it. Where f stands out (`STANDS_OUT`),
`FilmGlow.sharpness` says how much smaller a sun's disk is than the cell.

Rough mirrors glow by suns alone, with the lobe of their BSDF: rays follow what else they show.

Limits: light that reaches the film by way of other surfaces is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.eye.ends import EndRows
from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.runtime.random_streams import Stream, even_numbers, launch_seed
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.films.peaks import STANDS_OUT
from drcmitsuba.transport.mirrors.planar_mirrors import lobe_of
from drcmitsuba.transport.panes.patches import OFFSET
from drcmitsuba.transport.rays.shadow_rays import straight

SKY_SAMPLES = 512
"""Directions to ground and sky of every film end."""
SUN_SAMPLES = 16
"""Directions on a sun's disk of every film end."""
LOBE_SAMPLES = 2
"""The same of every end at a rough mirror, of which there are many to a tile."""


@dataclass(frozen=True, eq=False)
class FilmGlow:
    """Luminance of film ends per unit luminance of the sources."""

    sky: np.ndarray
    """By ground and sky patches [–], shape (end, bin)."""
    suns: np.ndarray
    """By every sun [–], shape (end, sun)."""
    sharpness: np.ndarray
    """Solid angle of the outgoing cell over that of the sun's disk, where f has a peak; elsewhere
    0 [–], shape (end, sun)."""

    @classmethod
    def joined(cls, parts: Sequence[FilmGlow]) -> FilmGlow:
        """Glow of the ends of several traces."""
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def glow(
    scene: Scene, ends: EndRows, suns: np.ndarray, diameter: float, subdivision: int, seed: int
) -> FilmGlow:
    """Glow of the films and rough mirrors that rays meet.

    Parameters
    ----------
    scene : Scene
    ends : EndRows
        Ends at films and rough mirrors.
    suns : np.ndarray, shape (sun, 3)
        Unit vectors to the suns.
    diameter : float
        Angle across a sun [deg].
    subdivision : int
        Reinhart's factor MF of the sky.
    seed : int
    """
    bins, count = len(Patches(subdivision)), len(ends.ray)
    sky = np.zeros((count, bins), np.float32)
    by_sun, sharpness = np.zeros((2, count, len(suns)), np.float32)
    for index in np.unique(ends.part):
        mine = np.flatnonzero(ends.part == index)
        material, which = scene.parts[index].material, ends.take(mine)
        own_seed = launch_seed(seed, Stream.GLOW, int(index))
        if isinstance(material, MirrorMaterial):
            lobe = mi.load_dict(bsdf(lobe_of(material)))
            if len(suns):
                lit, _ = _RoughMirror(scene, lobe, which, own_seed).suns(suns, diameter)
                by_sun[mine] = material.mirrored * lit
            continue
        film = _Film(scene, scene.parts[index].bsdf, which, own_seed)
        sky[mine] = film.sky(bins, subdivision)
        if len(suns):
            by_sun[mine], sharpness[mine] = film.suns(suns, diameter)
    return FilmGlow(sky, by_sun, sharpness)


@dataclass(frozen=True, eq=False)
class _Film:
    """Ends at the panes of one BSDF."""

    samples: ClassVar[int] = SUN_SAMPLES
    """Directions on a sun's disk of every end."""
    scene: Scene
    bsdf: Any
    ends: EndRows
    seed: int

    def _interaction(self, row: mi.UInt32) -> mi.SurfaceInteraction3f:
        """Interaction of each lane's end with the pane."""
        columns = (self.ends.point, self.ends.normal, self.ends.direction)
        p, n, d = (dr.gather(mi.Vector3f, flat(column), row) for column in columns)
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(row))
        si.p, si.n, si.sh_frame = mi.Point3f(p), mi.Normal3f(n), mi.Frame3f(n)
        si.wi = si.to_local(-d)
        return si

    def _reached(self, si: mi.SurfaceInteraction3f, d: mi.Vector3f, active: mi.Bool) -> mi.Float:
        """Transmittance from the pane towards directions d."""
        origin = si.p + dr.mulsign(mi.Float(OFFSET), dr.dot(si.n, d)) * si.n
        return straight(self.scene, mi.Point3f(origin), d, active & self.scene.effects.shines(d))

    def sky(self, bins: int, subdivision: int) -> np.ndarray:
        """Luminance per unit luminance of ground and sky patches, shape (end, bin)."""
        count, ctx = len(self.ends.ray), mi.BSDFContext()
        ctx.type_mask = mi.BSDFFlags.GlossyTransmission | mi.BSDFFlags.GlossyReflection
        out, block = dr.zeros(mi.Float64, count * bins), max(1, SHADOW_RAYS // SKY_SAMPLES)
        for start in range(0, count, block):
            lane = dr.arange(mi.UInt32, min(block, count - start) * SKY_SAMPLES)
            row = lane // SKY_SAMPLES + dr.opaque(mi.UInt32, start)
            index, si = lane % SKY_SAMPLES, self._interaction(row)
            lobe = even_numbers(index, row, self.seed, 0)
            uv = even_numbers(index, row, self.seed, 1)
            bs, value = self.bsdf.sample(ctx, si, lobe.x, uv)
            d, weight = si.to_world(bs.wo), value[0] / SKY_SAMPLES
            weight *= self._reached(si, d, weight > 0)
            at = row * bins + patch_index(d, subdivision)
            dr.scatter_add(out, mi.Float64(weight), at, weight > 0)
            dr.eval(out)
        return np.asarray(mi.Float(out).numpy().reshape(count, bins))

    def suns(self, suns: np.ndarray, diameter: float) -> tuple[np.ndarray, np.ndarray]:
        """Luminance per unit luminance of every sun, and the sharpness of peaks, (end, sun)."""
        shape, ctx = (len(self.ends.ray), len(suns)), mi.BSDFContext()
        omega, centres = disk_solid_angle(diameter), flat(suns)
        stride = dr.opaque(mi.UInt32, len(suns))
        parts, peaks = [], []
        for start in range(0, shape[0] * shape[1], SHADOW_RAYS):
            lane = dr.arange(mi.UInt32, min(SHADOW_RAYS, shape[0] * shape[1] - start))
            pair = lane + dr.opaque(mi.UInt32, start)
            row, sun = pair // stride, pair % stride
            si = self._interaction(row)
            centre = dr.gather(mi.Vector3f, centres, sun)
            total, plain = mi.Float(0), mi.Float(0)
            for i in range(self.samples):
                index = dr.full(mi.UInt32, i, dr.width(lane))
                uv = even_numbers(index, row, self.seed, 0, sun)
                d = sample_disk(centre, diameter, uv)
                value = self.bsdf.eval(ctx, si, si.to_local(d))[0]
                plain += value
                total += value * self._reached(si, d, value > 0)
            wo = si.to_local(centre)
            f = plain / (self.samples * dr.maximum(dr.abs(wo.z), 1e-4))
            parts.append((total * (omega / self.samples)).numpy())
            peaks.append(self._sharpness(si, wo, f, omega).numpy())
        return np.concatenate(parts).reshape(shape), np.concatenate(peaks).reshape(shape)

    def _sharpness(
        self, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, f: mi.Float, omega: float
    ) -> mi.Float:
        """Solid angle of the outgoing cell over that of the disk, where f is a peak, else 0."""
        peaked = f > STANDS_OUT / dr.pi * self._share(si, wo)
        size = self._cell_size(si) / dr.maximum(dr.abs(si.wi.z), 1e-4)
        return dr.select(peaked, size / omega, 0)

    def _share(self, si: mi.SurfaceInteraction3f, wo: mi.Vector3f) -> mi.Float:
        """Share of a sun's light that the film scatters to the side of the eye [–]."""
        entering = mi.SurfaceInteraction3f(si)
        entering.wi = wo
        ctx = mi.BSDFContext(mi.TransportMode.Importance)
        across = si.wi.z * wo.z < 0
        shares = []
        for kind in (mi.BSDFFlags.GlossyTransmission, mi.BSDFFlags.GlossyReflection):
            ctx.type_mask = +kind
            _, weight = self.bsdf.sample(ctx, entering, mi.Float(0.5), mi.Point2f(0.5))
            shares.append(weight[0])
        return dr.select(across, *shares)

    def _cell_size(self, si: mi.SurfaceInteraction3f) -> mi.Float:
        """Projected solid angle of the outgoing cell that holds the direction to the eye [sr]."""
        basis = getattr(self.bsdf, "basis", None)
        if basis is None:
            return mi.Float(np.pi / self.bsdf.out_cells)
        sizes = flat(basis.projected_solid_angle)
        return dr.gather(mi.Float, sizes, self.bsdf.out_cell(to_pane_frame(self.bsdf, si)))


class _RoughMirror(_Film):
    """Ends at the rough mirrors of one lobe, whose BSDF has no cells."""

    samples = LOBE_SAMPLES

    def _sharpness(
        self, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, f: mi.Float, omega: float
    ) -> mi.Float:
        return dr.zeros(mi.Float, dr.width(f))


def to_pane_frame(bsdf: Any, si: mi.SurfaceInteraction3f) -> mi.Vector3f:
    """Direction to the eye in the pane's frame: +z into the room, +y up."""
    from drcmitsuba_plugins.sampling import pane_axes, to_pane

    return to_pane(si.wi, pane_axes(si, bsdf.up, bsdf.level))
