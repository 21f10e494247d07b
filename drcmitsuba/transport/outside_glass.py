"""Deposit by the outside of clear panes, which mirror sky and sun to sills, reveals and façades.

Panes with a refractive index mirror on both sides. D of a receiver that sees the back of such a
pane grows by the light that the pane mirrors to it:

    D_mirrored[bin] = ∫ ρ(θ) V L_bin(d') cos dΩ(d),

with d' the direction d after the pane. A sun is mirrored by each plane of panes into one direction,
to which shadow rays go. One mirroring counts; where photons are followed they carry this light.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index

from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime.flat_arrays import add_at, flat, flat_indices, row_and_column
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.gather import first_directions
from drcmitsuba.transport.launch_size import SHADOW_RAYS
from drcmitsuba.transport.shadow_rays import sun_deposit, visibility

MOST_PLANES = 16
"""Largest number of planes of panes that mirror, the first ones of the scene."""
ALONG = 1e-5
"""Largest deviation of a pane's normal from that of its plane, as 1 − cosine [–]."""
BEFORE = 1e-3
"""Least distance of a receiver before a pane [m]."""


@dataclass(frozen=True)
class OutsideGlass:
    """Planes of panes that mirror to the outside."""

    scene: Scene
    planes: np.ndarray
    """Outward unit normals and distances from the origin [m], shape (plane, 4)."""

    @classmethod
    def of(cls, scene: Scene) -> OutsideGlass | None:
        """Collect the planes of a scene; None without panes that mirror to the outside."""
        if scene.followed:
            return None
        planes = []
        for part in scene.parts:
            pane = part.material
            if isinstance(pane, GlazingMaterial) and pane.ior is not None and not part.component:
                n = -normals(part.quads)
                planes.append(np.c_[n, np.einsum("qi,qi->q", n, part.quads[:, 0])])
        if not planes:
            return None
        every = np.concatenate(planes)
        _, first = np.unique(np.round(every, 4), axis=0, return_index=True)
        return cls(scene, every[np.sort(first)[:MOST_PLANES]])

    def sky(
        self, points: mi.Float, normals: mi.Float, *,
        subdivision: int, rays: int, seed: int, numbers: mi.UInt32 | None = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by mirrored ground and sky patches [sr], (point, bin), as `sky_deposit`."""
        bins, count = len(Patches(subdivision)), dr.width(points) // 3
        out = dr.zeros(mi.Float64, count * bins)
        rows = self._before(points, self.planes)
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        block, share = max(1, SHADOW_RAYS // rays), dr.opaque(mi.Float, np.pi / rays)
        for start in range(0, len(rows), block):
            here = flat_indices(rows[start : start + block])
            lane = dr.arange(mi.UInt32, dr.width(here) * rays)
            place, ray = row_and_column(lane, rays)
            row = dr.gather(mi.UInt32, here, place)
            p = dr.gather(mi.Point3f, points, row)
            frame = mi.Frame3f(dr.gather(mi.Normal3f, normals, row))
            number = dr.gather(mi.UInt32, numbers, row)
            d = frame.to_world(first_directions(ray, number, seed))
            rho, onward = self._mirrored(p, d, mi.Bool(True))
            rho = dr.select(self.scene.effects.shines(onward), rho, 0)
            index = row * bins + patch_index(onward, subdivision)
            add_at(out, mi.Float64(rho * share), index, rho > 0)
            dr.eval(out)
        return mi.TensorXf(mi.Float(out), (count, bins))

    def suns(
        self, points: mi.Float, normals: mi.Float, *,
        suns: np.ndarray, diameter: float, samples: int, seed: int,
        numbers: mi.UInt32 | None = None,
    ) -> mi.TensorXf:  # fmt: skip
        """D of points by mirrored suns [sr], (point, sun), as `sun_deposit`."""
        count = dr.width(points) // 3
        out = np.zeros((count, len(suns)), np.float32)
        numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
        same = np.unique(np.round(self.planes[:, :3], 4), axis=0, return_inverse=True)[1].ravel()
        for plane in range(same.max() + 1):
            planes = self.planes[same == plane]
            outward = planes[0, :3]
            rows, across = self._before(points, planes), suns @ outward
            ahead = np.flatnonzero(across > -np.radians(diameter) / 2)
            if not len(rows) or not len(ahead):
                continue
            row = flat_indices(rows)
            p, n = (dr.ravel(dr.gather(mi.Vector3f, columns, row)) for columns in (points, normals))
            D = sun_deposit(
                self.scene, p, n, suns=suns[ahead] - 2 * across[ahead, None] * outward,
                diameter=diameter, samples=samples, seed=seed,
                numbers=dr.gather(mi.UInt32, numbers, row), through=partial(self._towards, outward),
            )  # fmt: skip
            out[np.ix_(rows, ahead)] += D.numpy()
        return mi.TensorXf(flat(out), out.shape)

    def _before(self, points: mi.Float, planes: np.ndarray) -> np.ndarray:
        """Indices of points that lie before any of the planes."""
        p = points.numpy().reshape(-1, 3)
        before = np.zeros(len(p), bool)
        for plane in planes:
            before |= p @ plane[:3] > plane[3] + BEFORE
        return np.flatnonzero(before)

    def _towards(
        self, outward: np.ndarray, scene: Scene, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool
    ) -> mi.Float:
        """Share of light that panes of one outward normal mirror to points from directions d."""
        return self._mirrored(p, d, active, mi.Vector3f(*map(float, outward)))[0]

    def _mirrored(
        self, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool, outward: mi.Vector3f | None = None
    ) -> tuple[mi.Float, mi.Vector3f]:
        """Share of light that a pane mirrors to points from directions d, and its origin."""
        scene, ray = self.scene, mi.Ray3f(p, d)
        assert scene.clear is not None
        scene.ray_counter.add("shadow", active, dr.width(d))
        panes = scene.clear if scene.panes is None else scene.panes
        si = panes.ray_intersect(ray, mi.RayFlags.Minimal, coherent=False, active=active)
        si.sh_frame = mi.Frame3f(si.n)
        si.wi = si.to_local(-d)
        bsdf = si.bsdf()
        active = active & si.is_valid() & (si.wi.z < 0)
        active &= mi.has_flag(bsdf.flags(), mi.BSDFFlags.DeltaReflection)
        if outward is not None:
            active &= dr.dot(si.n, outward) < ALONG - 1
        ray.maxt = si.t * (1 - 1e-4)
        reached = mi.Float(1)
        if scene.panes is None:
            active &= ~scene.opaque.ray_test(ray, coherent=False, active=active)
        else:  # porous bodies may stand before the pane
            reached = visibility(scene, ray, active)
        context = mi.BSDFContext()
        context.component = 0  # the mirrored part
        bs, rho = bsdf.sample(context, si, 0.5, mi.Point2f(0.5), active)
        onward = si.to_world(bs.wo)
        share = reached * visibility(scene, si.spawn_ray(onward), active)
        return dr.select(active, rho[0], 0) * share, onward
