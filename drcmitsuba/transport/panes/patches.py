"""Patches that panes are cut into, and points on their faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.model import areas
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import normals as unit_normals
from drcmitsuba.scene.meshes import paired_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import ScenePart

MOST_PATCHES = 1 << 19
"""Largest number of patches."""
FINE, MOST_FINE = 3, 1024
"""Patches of panes that surfaces beyond their plane may shade are up to so many times narrower, as
long as there are no more of them."""
BEYOND = 0.01
"""Distance from the plane of a pane from which on a surface may shade it [m]."""
OFFSET = 1e-4
"""Distance of a face's points from the pane [m]."""


def patch_sizes(panes: Sequence[ScenePart], corners: np.ndarray, size: float) -> list[float]:
    """Widths of the patches of panes [m].

    Light on a pane that stands indoors differs from place to place as that on walls does: its
    patches are half as wide as `size`. The edge of a shadow on a pane is as sharp as the sun lets
    it be, and what it looks like from nearby is told by patches that are narrower still.

    Parameters
    ----------
    panes : sequence of ScenePart
        Panes that scatter, fronts inward.
    corners : np.ndarray, shape (corner, 3)
        Corners of all surfaces [m].
    size : float
        Width of patches of panes that nothing shades [m].
    """
    fineness = times_narrower([pane.quads for pane in panes], corners, size, MOST_FINE)
    return [size / max(1 + p.indoors, k) for p, k in zip(panes, fineness, strict=True)]


def times_narrower(
    groups: Sequence[np.ndarray], corners: np.ndarray, size: float, most: int,
    reach: float = np.inf,
) -> list[int]:  # fmt: skip
    """Times that patches of groups of panes, (pane, 4, 3) each, are narrower than `size` [m].

    It is 1 of those that no surface shades, a quad of four `corners` (corner, 3) [m] beyond a
    pane's plane of which a part lies within `reach` [m]; the others have `most` patches together.
    """
    shaded = [_may_be_shaded(quads, corners, reach) for quads in groups]
    area = sum(
        float(areas(q).sum()) for q, is_shaded in zip(groups, shaded, strict=True) if is_shaded
    )
    fits = (k for k in range(FINE, 1, -1) if area * (k / size) ** 2 <= most)
    fine = next(fits, 1)
    return [fine if is_shaded else 1 for is_shaded in shaded]


def _may_be_shaded(quads: np.ndarray, corners: np.ndarray, reach: float) -> bool:
    """Whether any surface lies beyond the plane of a pane (quad, 4, 3), within `reach` [m]."""
    every, of_quad = np.unique(unit_normals(quads).round(6), axis=0, return_inverse=True)
    surfaces = corners.reshape(-1, 4 if len(corners) % 4 == 0 else 1, 3)
    for k, normal in enumerate(every):
        at, plane = surfaces @ normal, quads[of_quad.reshape(-1) == k, 0] @ normal
        low, high = at.min(axis=1), at.max(axis=1)
        for depth in np.unique(plane.round(6)):
            if ((low < depth - BEYOND) & (high > depth - reach)).any():
                return True
    return False


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
    def of(cls, groups: Sequence[np.ndarray], size: float | Sequence[float]) -> PanePatches:
        """Cut groups of panes, (pane, 4, 3) each, into patches of about `size` [m], by group.

        A triangular pane, which repeats its last corner, becomes n² congruent triangles.

        Raises
        ------
        InputError
            The number of patches would exceed `MOST_PATCHES`.
        """
        parts, total = [], 0
        sizes = np.broadcast_to(size, len(groups)).tolist()
        for owner, (quads, width) in enumerate(zip(groups, sizes, strict=True)):
            for quad in quads:
                corner, u, v = quad[0], quad[1] - quad[0], quad[3] - quad[0]
                nu, nv = (max(1, round(float(np.linalg.norm(e)) / width)) for e in (u, v))
                is_triangular = bool((quad[2] == quad[3]).all())
                if is_triangular:
                    nu = nv = max(nu, nv)
                n = nu * nv
                total += n
                if total > MOST_PATCHES:
                    got = f"more than {MOST_PATCHES} patches of {width:g} m on the panes"
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

    @property
    def middle(self) -> np.ndarray:
        """Centroid of every patch [m], shape (patch, 3)."""
        share = np.where(self.triangular, 1 / 3, 1 / 2)[:, None]
        return np.asarray(self.corner + share * (self.u + self.v))

    @cached_property
    def scene(self) -> mi.Scene:
        """Scene of the patches alone; primitives 2i and 2i + 1 are the triangles of patch i."""
        c, u, v = self.corner, self.u, self.v
        quads = np.stack([c, c + u, c + u + v, c + v], axis=1)
        quads[self.triangular, 2] = quads[self.triangular, 3]
        return mitsuba_scene({"patches": paired_mesh("patches", quads)})

    @cached_property
    def area(self) -> np.ndarray:
        """Area of every patch, shape (patch,) [m²]."""
        return np.linalg.norm(np.cross(self.u, self.v), axis=1) / (1 + self.triangular)

    @cached_property
    def _tables(self) -> tuple[mi.Float, mi.Float, mi.Float, mi.Bool]:
        return flat(self.corner), flat(self.u), flat(self.v), mi.Bool(self.triangular)

    @cached_property
    def _normals(self) -> mi.Float:
        return flat(self.normal)

    def at(self, patch: mi.UInt32, a: mi.Float, b: mi.Float) -> mi.Point3f:
        """Points of patches at uniform numbers a and b, spread evenly over the area."""
        corner, u, v, triangular = self._tables
        fold = dr.gather(mi.Bool, triangular, patch) & (a + b > 1)
        a, b = dr.select(fold, 1 - a, a), dr.select(fold, 1 - b, b)
        y = dr.gather(mi.Point3f, corner, patch)
        return y + a * dr.gather(mi.Vector3f, u, patch) + b * dr.gather(mi.Vector3f, v, patch)

    def on_faces(self, face: mi.UInt32, uv: mi.Point2f) -> mi.Point3f:
        """Points before faces [m] at two uniform numbers, as `face_points` draws them."""
        patch, side = face >> 1, 1 - 2 * mi.Float(face & 1)
        n = dr.gather(mi.Vector3f, self._normals, patch)
        return self.at(patch, uv.x, uv.y) + OFFSET * side * n

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
