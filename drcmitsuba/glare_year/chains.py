r"""Chains: what the rays of an eye meet, through panes and by way of mirrors, and with what weight.

A ray goes straight through clear panes, gaps and the straight-through part of films, and turns at
smooth mirrors and at panes that mirror. On its way it collects *ends*: the outside (sky, ground or
sun), a film that glows, and points of surfaces that reflect or transmit diffusely. The luminance
that the eye sees is

.. math:: L = \sum_e w_e L_e

with the weight of an end w [–], the product of the transmittances and mirrors before it.

A rough mirror glows by the suns as a film does, and turns rays as well, to one direction of its
lobe.

Limits: of clear solids and rough mirrors one direction is drawn; panes show the images of sky and
suns, but not those of surfaces; what they mirror is followed over `MOST_IN_TURN` turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.grazing import more_at_grazing

from drcmitsuba.glare_year.openings import NO_OPENING, SeenOpenings
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
)
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.materials import bsdf, channel_of
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.image_suns import OFFSET, ImageSuns
from drcmitsuba.transport.mirrors.mirror_planes import MOST_IN_TURN
from drcmitsuba.transport.rays import bsdf_lookup

MOST_SURFACES = 24
"""Largest number of surfaces on a chain."""
LEAST_WEIGHT = 1e-5
"""Weight below which a chain ends [–]."""
STRAIGHT, TURNED, SCATTERED = 0, MOST_IN_TURN + 1, MOST_IN_TURN + 2
"""Ways of a ray: without a turn, by smooth mirrors and clear solids, by a rough mirror as well.
Numbers between are those of the planar mirrors in turn, whose images of suns are exact."""


class Ends(NamedTuple):
    """Ends of one kind."""

    ray: np.ndarray
    """Index of the ray, int, shape (end,)."""
    weight: np.ndarray
    """Weight [–]; of surfaces that of their illuminance over π, shape (end,) or (end, channel)."""
    point: np.ndarray
    """Place of the end [m]; of the outside, that of the last surface, shape (end, 3)."""
    direction: np.ndarray
    """Direction of the chain's last part, away from the eye, shape (end, 3)."""
    normal: np.ndarray
    """Normal of a film, or of a surface on the side whose illuminance counts, shape (end, 3)."""
    part: np.ndarray
    """Index of the scene's part, −1 for the outside, int, shape (end,)."""
    path: np.ndarray
    """How the ray came here, from `STRAIGHT` to `SCATTERED`, int, shape (end,)."""
    opening: np.ndarray
    """Opening that the ray met first, `NO_OPENING` for none, int, shape (end,)."""
    again: np.ndarray
    """Whether it met another opening afterwards, bool, shape (end,)."""

    def take(self, which: np.ndarray) -> Ends:
        """Some of the ends."""
        return Ends(*(column[which] for column in self))


@dataclass(frozen=True, eq=False)
class _ChainRays:
    """Rays on their way."""

    ray: np.ndarray
    weight: np.ndarray
    p: np.ndarray
    d: np.ndarray
    path: np.ndarray
    in_pane: np.ndarray
    """Whether a pane has mirrored the ray: what surfaces send along it is left out."""
    opening: np.ndarray
    again: np.ndarray

    def take(self, which: np.ndarray) -> _ChainRays:
        return _ChainRays(*(column[which] for column in _columns(self)))

    def ends(self, part: int, normals: np.ndarray | None = None, weight: Any = 1.0) -> Ends:
        """Ends here; `weight` (…) or (channel,) is the share of each end's light."""
        w = np.multiply.outer(self.weight, weight)
        n = np.zeros_like(self.d) if normals is None else normals
        at = np.full(len(self.ray), part)
        return Ends(self.ray, w, self.p, self.d, n, at, self.path, self.opening, self.again)


@dataclass(frozen=True)
class Chains:
    """Follows rays through a scene.

    Parameters
    ----------
    scene : Scene
    channels : tuple of int
        Colour channels of reflectances, as of `scene.channels_of`.
    openings : SeenOpenings, optional
        Openings that rays note; by default none.
    """

    scene: Scene
    channels: tuple[int, ...] = (-1,)
    openings: SeenOpenings | None = None

    def ends(self, points: np.ndarray, directions: np.ndarray) -> tuple[Ends, Ends, Ends]:
        """Follow rays.

        Parameters
        ----------
        points, directions : np.ndarray, shape (ray, 3)
            Origins [m] and unit vectors.

        Returns
        -------
        outside, films, surfaces : Ends
        """
        every: dict[str, list[Ends]] = {"outside": [], "films": [], "surfaces": []}
        count = len(points)
        straight = np.full(count, STRAIGHT)
        clean = np.zeros(count, bool)
        none = np.full(count, NO_OPENING)
        on = _ChainRays(
            np.arange(count), np.ones(count), points, directions, straight, clean, none, clean
        )
        for depth in range(MOST_SURFACES):
            on = self._step(on, every, depth)
            if not len(on.ray):
                break
        return _joined(every["outside"]), _joined(every["films"]), _joined(every["surfaces"])

    def _step(self, on: _ChainRays, every: dict[str, list[Ends]], depth: int) -> _ChainRays:
        """Trace rays to their next surfaces, note the ends, and return the rays that go on."""
        ray = mi.Ray3f(_points(on.p), _vectors(on.d))
        self.scene.ray_counter.take("path", len(on.ray))
        si = self.scene.full.ray_intersect(ray, mi.RayFlags.Minimal, coherent=False)
        hit = si.is_valid()
        if self.openings is not None:
            far = np.where(hit.numpy(), si.t.numpy().astype(float), np.inf)
            opening, again = self.openings.both(on.p, on.d, far, on.opening)
            on = replace(on, opening=opening, again=on.again | again)
        si.sh_frame = mi.Frame3f(si.n)
        si.wi = si.to_local(-ray.d)
        pointer = si.bsdf()
        clear = mi.has_flag(pointer.flags(), mi.BSDFFlags.Null)
        through = dr.select(clear & hit, pointer.eval_null_transmission(si, hit)[0], 0).numpy()
        known = dr.gather(mi.UInt32, self._parts, bsdf_lookup.number(pointer), hit)
        part = np.where(hit.numpy(), known.numpy().astype(int), -1)
        n = np.array(si.n).T.astype(float)
        here = replace(on, p=np.where(part[:, None] < 0, on.p, np.array(si.p).T))
        outside = part < 0
        if outside.any():
            every["outside"].append(here.take(outside).ends(-1))
        onward = [replace(here, weight=on.weight * through).take(through > 0)]
        for index in np.unique(part[~outside]):
            mine = part == index
            onward += self._meet(int(index), here.take(mine), n[mine], every, depth)
        joined = _ChainRays(*(np.concatenate(c) for c in zip(*map(_columns, onward), strict=True)))
        far = OFFSET * (1 + np.abs(joined.p).max(axis=1, initial=0, keepdims=True))
        return replace(joined, p=joined.p + far * joined.d).take(joined.weight > LEAST_WEIGHT)

    def _meet(
        self, index: int, on: _ChainRays, n: np.ndarray, every: dict[str, list[Ends]], depth: int
    ) -> Iterator[_ChainRays]:
        """Note the ends of rays at a part of the scene, and yield those that it turns."""
        material = self.scene.parts[index].material
        if isinstance(material, GlazingMaterial):
            followed = on.path < MOST_IN_TURN
            if self.images is not None and index in self.images.mirrors.parts and followed.any():
                yield self._turned(index, on.take(followed), n[followed], depth)
            return
        on, n = on.take(~on.in_pane), n[~on.in_pane]
        if not len(on.ray):
            return
        front = np.einsum("ri,ri->r", n, on.d) < 0
        towards = np.where(front[:, None], n, -n)
        if isinstance(material, Lambertian):
            for side, rho in zip((front, ~front), material.sides, strict=True):
                met, shown = on.take(side), towards[side]
                every["surfaces"].append(met.ends(index, shown, self._channels(rho)))
        elif isinstance(material, PorousMaterial):
            share = (1 - material.porosity) * self._channels(material.reflectance)
            every["surfaces"].append(on.ends(index, towards, share))
        elif isinstance(material, DiffuserMaterial):
            ones = np.ones(len(self.channels))
            lit, shown = on.take(front), towards[front]
            every["surfaces"].append(lit.ends(index, shown, material.reflectance * ones))
            every["surfaces"].append(on.ends(index, -towards, material.scattered * ones))
        elif isinstance(material, BsdfMaterial):
            every["films"].append(on.ends(index, n))
        elif isinstance(material, MirrorMaterial):
            if material.specular < 1:
                seen = replace(on, weight=on.weight * _matt(material, n, on.d))
                every["surfaces"].append(seen.ends(index, towards, np.ones(len(self.channels))))
            if index in self._lobed:
                every["films"].append(on.ends(index, n))
            if material.specular > 0:
                yield self._turned(index, on, n, depth)
        elif isinstance(material, DielectricMaterial):
            yield self._turned(index, on, n, depth)

    def _turned(self, index: int, on: _ChainRays, n: np.ndarray, depth: int) -> _ChainRays:
        """Rays after a mirror or the surface of a clear solid."""
        material = self.scene.parts[index].material
        numbers = np.random.default_rng([depth, index]).random((3, len(on.ray)))
        d, normal = _vectors(on.d), _vectors(n)
        si = dr.zeros(mi.SurfaceInteraction3f, len(on.ray))
        si.p, si.n, si.sh_frame = _points(on.p), normal, mi.Frame3f(normal)
        si.wi = si.to_local(-d)
        ctx, is_pane = mi.BSDFContext(), isinstance(material, GlazingMaterial)
        if is_pane:
            ctx.component = 0  # the mirrored part
        bs, weight = self._turning[index].sample(
            ctx, si, flat(numbers[0]), mi.Point2f(flat(numbers[1]), flat(numbers[2]))
        )
        onward = np.array(si.to_world(bs.wo)).T.astype(float)
        share = weight[0].numpy()
        if isinstance(material, MirrorMaterial) and not material.polished:
            share = share * material.specular
        path = np.maximum(on.path, SCATTERED if getattr(material, "roughness", 0) else TURNED)
        if self.images is not None and index in self.images.mirrors.parts:
            path = np.where(on.path < TURNED, on.path + 1, on.path)
        return replace(
            on, weight=on.weight * share, d=onward, path=path, in_pane=on.in_pane | is_pane
        )

    def _channels(self, reflectance: Any) -> np.ndarray:
        return np.array([channel_of(reflectance, channel) for channel in self.channels])

    @cached_property
    def images(self) -> ImageSuns | None:
        """Images of suns in planar mirrors; None without such mirrors."""
        return ImageSuns.of(self.scene)

    @cached_property
    def _lobed(self) -> frozenset[int]:
        """Parts that are rough mirrors, in which suns show as lobes."""
        parts = enumerate(self.scene.parts)
        return frozenset(
            i
            for i, part in parts
            if isinstance(part.material, MirrorMaterial) and part.material.roughness > 0
        )

    @cached_property
    def _parts(self) -> mi.UInt32:
        """Index of the part of every BSDF, by its number in the registry."""
        return mi.UInt32(bsdf_lookup.table(self.scene, range(len(self.scene.parts)), np.uint32))

    @cached_property
    def _turning(self) -> dict[int, Any]:
        """BSDFs of the mirrors, without their diffuse parts, and of clear solids, by their part."""
        made = {}
        for i, part in enumerate(self.scene.parts):
            if isinstance(part.material, MirrorMaterial):
                made[i] = mi.load_dict(bsdf(_mirroring(part.material)))
            elif isinstance(part.material, DielectricMaterial | GlazingMaterial):
                made[i] = part.bsdf
        return made


def _mirroring(material: MirrorMaterial) -> MirrorMaterial:
    """Mirror without its diffuse part; where it is not polished, as if all light were mirrored."""
    rho = material.mirrored if material.polished else material.reflectance
    return material.model_copy(update={"specular": 1.0, "reflectance": rho})


def _matt(material: MirrorMaterial, n: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Diffuse share of what eyes see of a mirror along d (ray, 3), shape (ray,)."""
    if not material.polished:
        return np.full(len(d), material.matt)
    return material.matt * (1 - more_at_grazing(np.abs(np.einsum("ri,ri->r", n, d))))


def _columns(rays: _ChainRays) -> tuple[np.ndarray, ...]:
    return (
        rays.ray, rays.weight, rays.p, rays.d, rays.path, rays.in_pane, rays.opening, rays.again
    )  # fmt: skip


def _points(p: np.ndarray) -> mi.Point3f:
    return mi.Point3f(*(flat(p[:, k]) for k in range(3)))


def _vectors(d: np.ndarray) -> mi.Vector3f:
    return mi.Vector3f(*(flat(d[:, k]) for k in range(3)))


def _joined(parts: list[Ends]) -> Ends:
    """All ends of a kind, by ray."""
    if not parts:
        none = np.zeros(0, int)
        p, d, n = np.zeros((3, 0, 3))
        return Ends(none, np.zeros(0), p, d, n, none, none, none, np.zeros(0, bool))
    joined = Ends(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return joined.take(np.argsort(joined.ray, kind="stable"))
