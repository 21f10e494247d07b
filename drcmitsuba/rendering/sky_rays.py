r"""Rays from surfaces to the sky, for the light that reaches them straight through openings.

Points on the openings of a room and cosine-distributed directions are combined by the balance
heuristic, so that E of a unit radiance is estimated by

.. math:: w = \frac{\tau \cos\theta}{n_o\, p_o(\omega) + n_c \cos\theta / \pi}

for each ray, with p_o the density of directions to points spread evenly over the openings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import patch_index

from drcmitsuba.eye.openings import NO_OPENING
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.rays.shadow_rays import straight

MOST_OPENINGS = 16
"""Largest number of openings that points are drawn on; with more, directions are drawn alone."""
BY_COSINE = 4
"""One in so many rays has a cosine-distributed direction."""
EDGE = 1e-4
"""Width of an opening's edge over its size that counts as inside: rounding loses no rays."""


@dataclass(frozen=True)
class SkyOpenings:
    """Openings of a room on which points are drawn: corners, edges and areas."""

    quads: np.ndarray
    """Parallelograms [m], shape (opening, 4, 3)."""

    @classmethod
    def of(cls, scene: Scene) -> SkyOpenings:
        """Openings of a scene; none where it has no room, or too many of them."""
        room = scene.enclosure
        quads = np.zeros((0, 4, 3)) if room is None else room.openings
        return cls(quads if len(quads) <= MOST_OPENINGS else quads[:0])

    @property
    def areas(self) -> np.ndarray:
        """Areas of the openings [m²]."""
        u, v = (self.quads[:, k] - self.quads[:, 0] for k in (1, 3))
        return np.linalg.norm(np.cross(u, v), axis=1)

    def points(self, u: mi.Float, v: mi.Float) -> mi.Point3f:
        """Points spread evenly over all openings at uniform numbers."""
        which, rest = mi.DiscreteDistribution(flat(self.areas)).sample_reuse(u)
        corner, a, b = (
            dr.gather(mi.Vector3f, flat(x), which)
            for x in (
                self.quads[:, 0], self.quads[:, 1] - self.quads[:, 0],
                self.quads[:, 3] - self.quads[:, 0],
            )
        )  # fmt: skip
        return mi.Point3f(corner + rest * a + v * b)

    def density(self, p: mi.Point3f, d: mi.Vector3f) -> mi.Float:
        """Density of directions from p to points on the openings [1/sr]."""
        out, total = mi.Float(0), float(self.areas.sum())
        for quad, n in zip(self.quads, normals(self.quads), strict=True):
            corner, normal = mi.Vector3f(*map(float, quad[0])), mi.Vector3f(*map(float, n))
            cosine = dr.dot(d, normal)
            t = dr.dot(corner - p, normal) / cosine
            hit, inside = p + t * d - corner, t > 0
            for edge in (quad[1] - quad[0], quad[3] - quad[0]):
                along = dr.dot(hit, mi.Vector3f(*map(float, edge / (edge @ edge))))
                inside &= (along > -EDGE) & (along < 1 + EDGE)
            out += dr.select(inside, t * t / (dr.abs(cosine) * total), 0)
        return out


class SkyRays(NamedTuple):
    """Rays from points to the sky, as many from each."""

    bin: mi.UInt32
    """Bin that they reach, 0 for the ground, shape (point · ray,)."""
    opening: mi.UInt32
    """Number from 1 of the opening that they pass, 0 for none; empty where none is told apart."""
    weight: mi.Float
    """Irradiance [sr] by each of the fills that let straight light through, see `FacadeScenes`, 0
    where nothing is seen, shape (fill · point · ray,); what passes no opening counts with the first
    fill."""


def sky_rays(
    scenes: FacadeScenes, windows: SkyOpenings, p: mi.Point3f, n: mi.Normal3f, number: mi.UInt32,
    *, rays: int, subdivision: int, seed: int,
) -> SkyRays:  # fmt: skip
    """Bins that rays from points reach, and their irradiance per unit radiance of the bin.

    Parameters
    ----------
    scenes : FacadeScenes
    windows : SkyOpenings
    p, n : mi.Point3f, mi.Normal3f
        Points off their surface [m], and normals.
    number : mi.UInt32
        Seeds of the points' random numbers, independent of the launch.
    rays : int
        Number of rays from a point.
    subdivision : int
        Reinhart's factor MF of the sky.
    seed : int
    """
    lane = dr.arange(mi.UInt32, dr.width(p) * rays)
    row, index = lane // rays, lane % rays
    p, n = dr.gather(mi.Point3f, dr.ravel(p), row), dr.gather(mi.Normal3f, dr.ravel(n), row)
    by_cosine = -(-rays // BY_COSINE) if len(windows.quads) else rays
    place = even_numbers(index, dr.gather(mi.UInt32, number, row), seed, 0)
    d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(place))
    if by_cosine < rays:
        to_window = dr.normalize(windows.points(place.x, place.y) - p)
        d = dr.select(index < by_cosine, d, to_window)
    cosine = dr.dot(n, d)
    active, opening = (cosine > 0) & scenes.inner.effects.shines(d), mi.UInt32()
    if scenes.openings is not None:
        opening = mi.UInt32(scenes.openings.first(p, d, active) - NO_OPENING)
    every = []
    for fill in scenes.letting_through:
        mine = active & (opening > 0) if fill else active
        every.append(straight(scenes.fills[fill], p, d, mine))
    density = by_cosine * cosine * dr.inv_pi
    if by_cosine < rays:
        density += (rays - by_cosine) * windows.density(p, d)
    weights = [dr.select(tau > 0, tau * cosine / density, 0) for tau in every]
    bins = patch_index(d, subdivision)
    dr.eval(bins, opening, weights)
    return SkyRays(bins, opening, weights[0] if len(weights) == 1 else dr.concat(weights))
