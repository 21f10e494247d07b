"""Clear panes that are a few rectangles in a few planes: light passes them without a search.

A ray meets every plane at one point, which lies in a rectangle or not. That takes a tenth of the
time of a search for the panes one after another (`drcmitsuba_plugins.sampling.transmittance`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import is_triangle, normals

MOST_PLANES = 4
"""Largest number of planes: each adds to the kernels."""
MOST_PANES = 16
"""Largest number of panes in a plane, likewise."""
UPON = 1e-3
"""Distance between panes up to which a search may take two of them for one [m]."""
NEAR = 1e-5
"""Distance within which points count as the same [m]."""


class PanesInPlane(NamedTuple):
    """Panes of one kind in a plane. A kernel reads the numbers, as those of `Openings`."""

    pane: Any
    """BSDF, whose straight transmittance depends on the angle of incidence alone."""
    corner: mi.Vector3f
    normal: mi.Vector3f
    along: mi.Vector3f
    up: mi.Vector3f
    """Two perpendicular directions in the plane."""
    bounds: tuple[mi.Vector4f, ...]
    """Least and largest place of every pane along the one and the other direction [m]."""
    quads: np.ndarray
    """The panes, shape (pane, 4, 3)."""

    @classmethod
    def of(cls, quads: np.ndarray, pane: Any) -> PanesInPlane | None:
        """Plane of rectangles (pane, 4, 3) that are parallel to each other; None for others."""
        if len(quads) > MOST_PANES or is_triangle(quads).any():
            return None
        corner, axes = quads[0, 0], _axes(quads)
        places = (quads - corner) @ axes[:2].T
        low, high = places.min(axis=1), places.max(axis=1)
        corners = np.minimum(abs(places - low[:, None]), abs(places - high[:, None]))
        if abs(axes[0] @ axes[1]) > 1e-6 or (corners > NEAR).any():
            return None
        vectors = flat(np.stack([corner, *axes]))
        numbers = flat(np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1))
        start, along, up, normal = (dr.gather(mi.Vector3f, vectors, mi.UInt32(k)) for k in range(4))
        bounds = tuple(dr.gather(mi.Vector4f, numbers, mi.UInt32(k)) for k in range(len(quads)))
        dr.eval(start, normal, along, up, bounds)
        return cls(pane, start, normal, along, up, bounds, quads)

    def touches(self, other: PanesInPlane) -> bool:
        """Whether a pane lies upon one of another plane: a search finds only one of them."""
        axes = _axes(self.quads)
        mine, theirs = (quads @ axes.T for quads in (self.quads, other.quads))
        common = np.minimum(mine.max(axis=1)[:, None], theirs.max(axis=1)) - np.maximum(
            mine.min(axis=1)[:, None], theirs.min(axis=1)
        )
        return bool(((common[..., :2] > NEAR).all(axis=2) & (common[..., 2] > -UPON)).any())

    def crossing(self, ray: mi.Ray3f, active: mi.Bool) -> tuple[mi.Float, mi.Float]:
        """Distance to the plane [m], and transmittance of the pane that a ray passes, or 1."""
        cosine = dr.dot(self.normal, ray.d)
        t = dr.dot(self.corner - ray.o, self.normal) / cosine
        y = ray.o + t * ray.d - self.corner
        a, b = dr.dot(y, self.along), dr.dot(y, self.up)
        within = mi.Bool(False)
        for low_a, high_a, low_b, high_b in self.bounds:
            within |= (a >= low_a) & (a < high_a) & (b >= low_b) & (b < high_b)
        within &= active & (t > 0) & (t < ray.maxt)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(dr.safe_sqrt(1 - dr.square(cosine)), 0, -cosine)
        return t, dr.select(within, self.pane.eval_null_transmission(si, within)[0], 1)


def _axes(quads: np.ndarray) -> np.ndarray:
    """Directions of both edges of the first quad, and its normal, shape (3, 3)."""
    edges = quads[0, [1, 3]] - quads[0, 0]
    return np.vstack([edges / np.linalg.norm(edges, axis=1, keepdims=True), normals(quads)[:1]])


@dataclass(frozen=True)
class FlatPanes:
    """All clear panes of a scene."""

    planes: tuple[PanesInPlane, ...]

    @classmethod
    def of(cls, kinds: Iterable[tuple[np.ndarray, Any]]) -> FlatPanes | None:
        """Panes of some kinds, rectangles (pane, 4, 3) [m] and their BSDF; None where unfit."""
        planes: list[PanesInPlane] = []
        for quads, pane in kinds:
            n = normals(quads)
            n *= np.sign(n[np.arange(len(n)), abs(n).argmax(axis=1)])[:, None]  # either side
            height = np.einsum("qi,qi->q", quads[:, 0], n)
            rows = np.round(np.column_stack([n, height]) / NEAR)
            _, plane = np.unique(rows, axis=0, return_inverse=True)
            for number in range(plane.max() + 1):
                made = PanesInPlane.of(quads[plane.ravel() == number], pane)
                if made is None or len(planes) == MOST_PLANES:
                    return None
                planes.append(made)
        if not planes or any(a.touches(b) for a, b in combinations(planes, 2)):
            return None
        return cls(tuple(planes))

    def transmittance(self, ray: mi.Ray3f, active: mi.Bool) -> mi.Float:
        """Product of the transmittances of all panes that active rays pass; else 0."""
        result = dr.select(active, mi.Float(1), 0)
        for plane in self.planes:
            result *= plane.crossing(ray, active)[1]
        return result
