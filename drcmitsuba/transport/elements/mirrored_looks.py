"""Directions from receivers by way of mirrors to panes that scatter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.panes.patches import OFFSET, PanePatches
from drcmitsuba.transport.panes.transfer import PaneLook
from drcmitsuba.transport.rays.openings import Within
from drcmitsuba.transport.rays.shadow_rays import visibility


def looks_by_mirrors(
    images: ImageSuns, patches: PanePatches, points: mi.Float, normals: mi.Float, *,
    rays: int, seed: int, numbers: mi.UInt32, within: Within = None,
) -> list[PaneLook]:  # fmt: skip
    """Directions in which receivers see patches in one mirror, by the cosine law.

    Directions are those from the mirror to the patch, and weights include its reflectance; else as
    `panes.transfer.looks`.

    Parameters
    ----------
    images : ImageSuns
        Mirrors, and the scene `lit` in which the patches are seen from them.
    points, normals, rays, seed, numbers, within
        As for `ImageSuns.sky`.
    """
    every = []
    share, normal = dr.opaque(mi.Float, 1 / rays), mi.Float(patches.normal.ravel())
    _ = patches.scene  # made before a loop is recorded
    for row, _, p, d in images.towards_mirrors(points, normals, rays, seed, numbers, within):
        seen = _Seen.none(images, patches, dr.width(row))
        active = dr.full(mi.Bool, True, dr.width(row))
        dr.eval(images.followed(p, d, active, share, seen), seen.patch, seen.onward, seen.weight)
        at = dr.compress(seen.weight > 0)
        if not dr.width(at):
            continue
        row, patch, onward, weight = (
            dr.gather(kind, values, at)
            for kind, values in (
                (mi.UInt32, row), (mi.UInt32, seen.patch), (mi.Vector3f, seen.onward),
                (mi.Float, seen.weight),
            )
        )  # fmt: skip
        front = dr.dot(dr.gather(mi.Normal3f, normal, patch), onward) < 0
        every.append(PaneLook(row, patch, onward, front, weight))
    return every


@dataclass(frozen=True)
class _Seen:
    """Patches that rays meet after a mirror, by ray: a `Met` of `ImageSuns.followed`."""

    images: ImageSuns
    patches: PanePatches
    ray: mi.UInt32
    patch: mi.UInt32
    onward: mi.Float
    """Directions from the mirror, three numbers each."""
    weight: mi.Float
    """0 where no patch is met."""

    @classmethod
    def none(cls, images: ImageSuns, patches: PanePatches, count: int) -> _Seen:
        """Nothing is met yet by so many rays."""
        patch, onward = dr.zeros(mi.UInt32, count), dr.zeros(mi.Float, 3 * count)
        own: Any = (dr.arange(mi.UInt32, count), patch, onward, dr.zeros(mi.Float, count))
        dr.make_opaque(own)
        return cls(images, patches, *own)

    def __call__(
        self, weight: mi.Float, axis: mi.UInt32, ray: mi.Ray3f, active: mi.Bool
    ) -> mi.Float:
        """Store what is met; nothing of it counts once more."""
        hit = self.patches.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        # The ray ends before the pane, which may let straight light through as well.
        before = mi.Ray3f(ray.o, ray.d, hit.t * (1 - 1e-4) - OFFSET, 0, [])
        value = weight * visibility(self.images.lit, before, active & hit.is_valid())
        seen = active & hit.is_valid() & (value > 0)
        dr.scatter(self.patch, hit.prim_index // 2, self.ray, seen)
        dr.scatter(self.onward, ray.d, self.ray, seen)
        dr.scatter(self.weight, value, self.ray, seen)
        return mi.Float(0)
