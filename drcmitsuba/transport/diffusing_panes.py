"""Deposit through scattering panes: light that meets one of them, or several in turn.

A Lambertian pane turns the irradiance of its two faces into radiance, T·E of the far face and R·E
of the near one, over π. Where T depends on the incidence, E of the outer face counts light by
T(θ)/T, with T the mean; light from within the room counts by T. The pane is cut into patches, so
that

    D_b[receiver, bin] = Σ_face K[receiver, face] · E[face, bin],

where K holds geometry, visibility and the pane's optics, and shadow rays from the faces give E.
Light from pane to pane is the geometric series E = D_a + K' E.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import TO_UNIT, clamped_index, random_bits

from drcmitsuba.model.materials import DiffuserMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import add_at, flat, flat_indices, row_and_column
from drcmitsuba.scene.meshes import paired_mesh
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.gather import first_directions
from drcmitsuba.transport.openings import Openings, Within
from drcmitsuba.transport.shadow_rays import visibility

MOST_PATCHES = 1 << 19
"""Largest number of patches."""
OFFSET = 1e-4
"""Distance of a face's points from the pane [m]."""


@dataclass(frozen=True)
class PanePatches:
    """Patches that panes are cut into: parallelograms, or triangles of half their area.

    Faces are numbered 2·patch for the front (towards the room) and 2·patch + 1 for the back.
    """

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    """Corner and the two edges from it [m], shape (patch, 3) each."""
    owner: np.ndarray
    """Group of panes that the patch belongs to, int, shape (patch,)."""
    triangular: np.ndarray
    """Whether the patch is the triangle between its corner and the ends of the edges."""

    @classmethod
    def of(cls, groups: Sequence[np.ndarray], size: float) -> PanePatches:
        """Cut groups of panes, (pane, 4, 3) each, into patches of about `size` [m].

        A triangular pane, which repeats its last corner, becomes n² congruent triangles.

        Raises
        ------
        InputError
            The number of patches would exceed `MOST_PATCHES`.
        """
        parts, total = [], 0
        for owner, quads in enumerate(groups):
            for quad in quads:
                corner, u, v = quad[0], quad[1] - quad[0], quad[3] - quad[0]
                nu, nv = (max(1, round(float(np.linalg.norm(e)) / size)) for e in (u, v))
                is_triangular = bool((quad[2] == quad[3]).all())
                if is_triangular:
                    nu = nv = max(nu, nv)
                n = nu * nv
                total += n
                if total > MOST_PATCHES:
                    got = f"more than {MOST_PATCHES} patches of {size:g} m on the panes"
                    raise InputError("case", "accuracy.cell_size", got, "take larger cells")
                i, j = (a.ravel()[:, None] for a in np.mgrid[:nu, :nv])
                edges = np.tile(u / nu, (n, 1)), np.tile(v / nv, (n, 1))
                start = corner + i * u / nu + j * v / nv
                if is_triangular:  # the square (i, j) beyond the diagonal folds back onto it
                    turned = i + j >= nu
                    start = np.where(turned, corner + (nu - i) * u / nu + (nu - j) * v / nu, start)
                    edges = (
                        np.where(turned, -edges[0], edges[0]),
                        np.where(turned, -edges[1], edges[1]),
                    )
                parts.append((start, *edges, np.full(n, owner), np.full(n, is_triangular)))
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def __len__(self) -> int:
        """Count the patches."""
        return len(self.corner)

    @cached_property
    def normal(self) -> np.ndarray:
        """Unit normal towards the room, shape (patch, 3)."""
        n = np.cross(self.u, self.v)
        return n / np.linalg.norm(n, axis=1, keepdims=True)

    @cached_property
    def scene(self) -> mi.Scene:
        """Scene of the patches alone; primitives 2i and 2i + 1 are the triangles of patch i."""
        c, u, v = self.corner, self.u, self.v
        quads = np.stack([c, c + u, c + u + v, c + v], axis=1)
        quads[self.triangular, 2] = quads[self.triangular, 3]
        return mi.load_dict({"type": "scene", "patches": paired_mesh("patches", quads)})

    @cached_property
    def area(self) -> np.ndarray:
        """Area of every patch, shape (patch,) [m²]."""
        return np.linalg.norm(np.cross(self.u, self.v), axis=1) / (1 + self.triangular)

    @cached_property
    def _tables(self) -> tuple[mi.Float, mi.Float, mi.Float, mi.Bool]:
        return flat(self.corner), flat(self.u), flat(self.v), mi.Bool(self.triangular)

    def at(self, patch: mi.UInt32, a: mi.Float, b: mi.Float) -> mi.Point3f:
        """Points of patches at uniform numbers a and b, spread evenly over the area."""
        corner, u, v, triangular = self._tables
        fold = dr.gather(mi.Bool, triangular, patch) & (a + b > 1)
        a, b = dr.select(fold, 1 - a, a), dr.select(fold, 1 - b, b)
        y = dr.gather(mi.Point3f, corner, patch)
        return y + a * dr.gather(mi.Vector3f, u, patch) + b * dr.gather(mi.Vector3f, v, patch)

    @property
    def corners_of_faces(self) -> np.ndarray:
        """Corners of what `face_points` draws from [m], shape (corner, 3)."""
        ends = [self.corner + a * self.u + b * self.v for a in (0, 1) for b in (0, 1)]
        return np.concatenate([p + side * OFFSET * self.normal for p in ends for side in (1, -1)])

    def face_points(self, rng: np.random.Generator) -> tuple[mi.Float, mi.Float]:
        """One random point and the outward normal of every face, three numbers each."""
        uv = rng.random((2, len(self), 1))
        a, b = np.where(self.triangular[:, None] & (uv.sum(axis=0) > 1), 1 - uv, uv)
        p = self.corner + a * self.u + b * self.v
        sides = np.array([1.0, -1.0])[None, :, None]
        n = sides * self.normal[:, None]
        return flat(p[:, None] + OFFSET * n), flat(n)


@dataclass(frozen=True)
class Acceptance:
    """How much light counts at the faces of panes, by its incidence: T(θ)/T at outer ones."""

    table: mi.Float
    """T(θ)/T of every group of panes at equal steps of cos θ, flat (group, step)."""
    steps: int
    group: mi.UInt32
    """Group of every face."""
    outer: mi.Bool
    """Whether a face is an outer one."""

    @classmethod
    def of(cls, materials: Sequence[DiffuserMaterial], owner: np.ndarray) -> Acceptance | None:
        """Acceptance of the faces of patches by their owners; None where T is the same anywhere."""
        shares = [np.ravel(material.transmittance) for material in materials]
        steps = max((len(share) for share in shares), default=1)
        if steps == 1:
            return None
        c = np.linspace(0, 1, steps)
        rows = [
            np.interp(c, np.linspace(0, 1, len(share)), share) / material.scattered
            if len(share) > 1 and material.scattered > 0 else np.ones(steps)
            for share, material in zip(shares, materials, strict=True)
        ]  # fmt: skip
        of_face = np.repeat(owner, 2)
        return cls(
            flat(rows), steps, flat_indices(of_face), mi.Bool(np.arange(len(of_face)) % 2 == 1)
        )

    def at(self, face: mi.UInt32, cosine: mi.Float, active: mi.Bool) -> mi.Float:
        """T(θ)/T of light on faces [–]."""
        is_outer = active & dr.gather(mi.Bool, self.outer, face, active)
        x = dr.clip(cosine, 0, 1) * (self.steps - 1)
        i = clamped_index(x, self.steps - 1)
        at = dr.gather(mi.UInt32, self.group, face, is_outer) * self.steps + i
        low = dr.gather(mi.Float, self.table, at, is_outer)
        high = dr.gather(mi.Float, self.table, at + 1, is_outer)
        return dr.select(is_outer, dr.lerp(low, high, x - mi.Float(i)), 1)


class Look(NamedTuple):
    """Directions from receivers to panes, one lane each.

    `weight` is cos θ / (π · p), with p the sum of the densities of both ways to draw the direction
    times `rays`, times the transmittance of clear panes in between; 0 where no pane is seen.
    """

    row: mi.UInt32
    patch: mi.UInt32
    d: mi.Vector3f
    front: mi.Bool
    weight: mi.Float


def looks(
    scene: Scene, patches: PanePatches, points: mi.Float, normals: mi.Float, *,
    rays: int, seed: int, numbers: mi.UInt32 | None = None, within: Within = None,
) -> tuple[Look, Look]:  # fmt: skip
    """Directions from receivers to the patches, drawn in two ways.

    Points on the panes and cosine-distributed directions are combined by the balance heuristic:
    the first suit small and far panes, the second keep the estimate bounded close to a pane.

    Parameters
    ----------
    points, normals : mi.Float
        Receivers, three numbers each.
    rays : int
        Directions of each of the two kinds per receiver.
    numbers, within : optional
        As for `shadow_rays.sky_deposit`.

    Returns
    -------
    tuple of Look
        By points and by directions, lanes receiver · rays + index.
    """
    count = dr.width(points) // 3
    normal = flat(patches.normal)
    total_area = dr.opaque(mi.Float, float(patches.area.sum()))
    many = dr.opaque(mi.Float, rays)
    share = mi.DiscreteDistribution(flat(patches.area))
    lane = dr.arange(mi.UInt32, count * rays)
    row, index = row_and_column(lane, rays)
    number = row if numbers is None else dr.gather(mi.UInt32, numbers, row)
    a, b = (mi.Float(v >> 8) * TO_UNIT for v in random_bits(number, seed, index))
    p = dr.gather(mi.Point3f, points, row)
    n = dr.gather(mi.Normal3f, normals, row)
    openings = Openings.of(scene, points, within)  # rays to its panes stay in a box

    def look(patch: mi.UInt32, d: mi.Vector3f, distance: mi.Float, seen: mi.Bool) -> Look:
        """Weigh directions drawn in either way."""
        pane_normal = dr.gather(mi.Normal3f, normal, patch, seen)
        cos_pane, cosine = dr.dot(pane_normal, -d), dr.dot(n, d)
        seen = seen & (cosine > 0) & (cos_pane != 0)
        # The ray ends before the pane, which may let straight light through as well.
        before = mi.Ray3f(p, d, distance * (1 - 1e-4) - OFFSET, 0, [])
        scene.ray_counter.add("pane", seen, dr.width(d))
        tau = visibility(scene, before, seen, openings)
        by_area = dr.square(distance) / (dr.abs(cos_pane) * total_area)
        by_cosine = cosine * dr.inv_pi
        weight = dr.select(tau > 0, by_cosine * tau / (many * (by_area + by_cosine)), 0)
        return Look(row, dr.select(seen, patch, 0), d, cos_pane > 0, weight)

    # Points on the panes.
    stratum = (mi.Float(index) + a) / many
    patch, u = share.sample_reuse(stratum)
    y = patches.at(patch, u, b)
    distance = dr.norm(y - p)
    d = (y - p) / dr.maximum(distance, 1e-9)
    by_point = look(patch, d, distance, mi.Bool(True))

    # Directions by the cosine law.
    d = mi.Frame3f(n).to_world(first_directions(index, number, seed))
    hit = patches.scene.ray_intersect_preliminary(mi.Ray3f(p, d), coherent=False)
    return by_point, look(hit.prim_index // 2, d, hit.t, hit.is_valid())


def pane_transfer(
    scene: Scene, patches: PanePatches, points: mi.Float, normals: mi.Float, *,
    rays: int, seed: int, numbers: mi.UInt32 | None = None, within: Within = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance at points per irradiance on the faces of panes that scatter evenly.

    Parameters
    ----------
    patches : PanePatches
        Patches of `scene.scattering`.
    scene, points, normals, rays, seed, numbers, within
        As for `looks`.

    Returns
    -------
    mi.TensorXf, shape (receiver, face)
        K, dimensionless.
    """
    count, faces = dr.width(points) // 3, 2 * len(patches)
    out, stride = dr.zeros(mi.Float64, count * faces), dr.opaque(mi.UInt32, faces)
    optics: list[Any] = [pane.material for pane in scene.scattering]
    through = flat([optics[i].scattered for i in patches.owner])
    back = flat([optics[i].reflectance for i in patches.owner])
    every = looks(
        scene, patches, points, normals, rays=rays, seed=seed, numbers=numbers, within=within
    )
    dr.eval([(look.row, look.patch, look.front, look.weight) for look in every])
    for look in every:
        seen = look.weight > 0
        near = 2 * look.patch + dr.select(look.front, mi.UInt32(0), 1)
        # The back reflects nothing, as in `materials.bsdf`.
        for face, albedo, lit in ((near ^ 1, through, seen), (near, back, seen & look.front)):
            value = look.weight * dr.gather(mi.Float, albedo, look.patch, lit)
            add_at(out, mi.Float64(value), look.row * stride + face, lit & (value > 0))
    dr.eval(out)
    return mi.TensorXf(mi.Float(out), (count, faces))


def neumann_series(between: mi.TensorXf, received: mi.TensorXf) -> mi.TensorXf:
    """Irradiance of the faces with the light between panes, E = D_a + K' E.

    Parameters
    ----------
    between : mi.TensorXf, shape (face, face)
        K' from the faces to the faces.
    received : mi.TensorXf, shape (face, bin)
        D_a, straight from sky and suns [sr].

    Returns
    -------
    mi.TensorXf, shape (face, bin)
        E [sr].
    """
    result, term = received, received
    while float(dr.max(term.array)[0]) > 1e-7 * max(1e-30, float(dr.max(result.array)[0])):
        term = between @ term
        result = result + term
        dr.eval(result, term)
    return result
