"""A scout: some hundred rays that tell how long the paths in a room will be.

How many rays a simulation traces follows from the case, but for how far paths go until they are
absorbed, leave the room, or are given up. That is found on the case's own surfaces by paths as
transport follows them, coarsely: films scatter evenly, glass does not depend on the angle. Nothing
but the bare closest hit is Mitsuba's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    MirrorMaterial,
)
from drcmitsuba.scene.materials import Lambertian, SurfaceMaterial, channel_of, film
from drcmitsuba.scene.scene import Part, quad_mesh

REFLECTED = 0.3
"""Part of what a film sends on that it sends back."""


class Hit(NamedTuple):
    """What rays meet first.

    Parameters
    ----------
    surface : np.ndarray of int, shape (ray,)
        Number of the material; −1 where nothing is met.
    p, n : np.ndarray, shape (ray, 3)
        Point and the normal of its surface.
    """

    surface: np.ndarray
    p: np.ndarray
    n: np.ndarray


class Scattered(NamedTuple):
    """How rays go on: directions, factors of their throughput, and whether they go by a surface."""

    d: np.ndarray
    weight: np.ndarray
    through: np.ndarray
    straight: np.ndarray


def bare(quads: np.ndarray) -> mi.Scene:
    """Scene of quadrilaterals (quad, 4, 3) alone; quad i is triangles 2i and 2i + 1."""
    return mi.load_dict({"type": "scene", "quads": quad_mesh("quads", quads)})


def closest(scene: mi.Scene, p: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance of what rays (ray, 3) meet first, infinite for nothing, and its triangle."""
    at, way = (mi.Float(np.ascontiguousarray(a, np.float32).ravel()) for a in (p, d))
    lane = dr.arange(mi.UInt32, len(p))
    ray = mi.Ray3f(dr.gather(mi.Point3f, at, lane), dr.gather(mi.Vector3f, way, lane))
    hit = scene.ray_intersect_preliminary(ray, coherent=False)
    t, triangle = hit.t, dr.select(hit.is_valid(), hit.prim_index, 0)
    dr.eval(t, triangle)
    return t.numpy().astype(float), triangle.numpy()


@dataclass(frozen=True)
class Scout:
    """Surfaces of a scene with what they do to light.

    Parameters
    ----------
    scene : mi.Scene or None
        All surfaces as one mesh; None without any.
    corner, u, v : np.ndarray, shape (triangle, 3)
        Corner and two edges [m].
    owner : np.ndarray, shape (triangle,)
        Number of the material.
    materials : tuple of SurfaceMaterial
    components : tuple of str
        That each material belongs to.
    """

    scene: mi.Scene | None
    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    owner: np.ndarray
    materials: tuple[SurfaceMaterial, ...]
    components: tuple[str, ...]

    @classmethod
    def of(cls, parts: tuple[Part, ...]) -> Scout:
        """Take the surfaces of a scene."""
        quads = np.concatenate([np.zeros((0, 4, 3)), *(part.quads for part in parts)])
        owner = np.repeat(np.arange(len(parts)), [len(part.quads) for part in parts])
        corners = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
        return cls(
            bare(quads) if len(quads) else None,
            corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0],
            np.repeat(owner, 2),
            tuple(part.material for part in parts), tuple(part.component for part in parts),
        )  # fmt: skip

    @cached_property
    def normal(self) -> np.ndarray:
        """Unit normals, shape (triangle, 3); 0 for triangles of no area."""
        n = np.cross(self.u, self.v)
        return n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30)

    def meet(self, p: np.ndarray, d: np.ndarray) -> Hit:
        """First surface that rays (ray, 3) meet."""
        if self.scene is None or not len(p):
            return Hit(np.full(len(p), -1), p, d)
        t, triangle = closest(self.scene, p, d)
        met = np.isfinite(t)
        at = p + np.where(met, t, 0)[:, None] * d
        return Hit(np.where(met, self.owner[triangle], -1), at, self.normal[triangle])

    def scatter(self, hit: Hit, d: np.ndarray, rng: np.random.Generator) -> Scattered:
        """Send rays on from what they met, by one lobe drawn at random."""
        out, weight = d.copy(), np.zeros(len(d))
        through, straight = np.zeros(len(d), bool), np.zeros(len(d), bool)
        facing = np.where((d * hit.n).sum(axis=1, keepdims=True) < 0, hit.n, -hit.n)
        for i, material in enumerate(self.materials):
            mine = np.flatnonzero(hit.surface == i)
            if not len(mine):
                continue
            found = _LOBES[type(material)](material, d[mine], hit.n[mine], facing[mine], rng)
            out[mine], weight[mine], through[mine], straight[mine] = found
        return Scattered(out, weight, through, straight)


Lobes = Callable[..., tuple[np.ndarray, np.ndarray | float, np.ndarray, np.ndarray | bool]]


def cosine(n: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Directions about normals (ray, 3) by the cosine law."""
    z = rng.standard_normal(n.shape)
    d = n + z / np.linalg.norm(z, axis=1, keepdims=True)
    return d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-9)


def _mirrored(d: np.ndarray, n: np.ndarray) -> np.ndarray:
    return d - 2 * (d * n).sum(axis=1, keepdims=True) * n


def _diffuse(m: Lambertian, d, n, facing, rng):  # type: ignore[no-untyped-def]
    none = np.zeros(len(d), bool)
    return cosine(facing, rng), channel_of(m.reflectance, -1), none, False


def _mirror(m: MirrorMaterial, d, n, facing, rng):  # type: ignore[no-untyped-def]
    matt = (rng.random(len(d)) >= m.specular)[:, None]
    none = np.zeros(len(d), bool)
    return np.where(matt, cosine(facing, rng), _mirrored(d, facing)), m.reflectance, none, False


def _glass(m: GlazingMaterial, d, n, facing, rng):  # type: ignore[no-untyped-def]
    back = np.where((d * n).sum(axis=1) < 0, m.reflectance, 0.0)
    whole = np.maximum(m.transmittance + back, 1e-9)
    through = rng.random(len(d)) * whole < m.transmittance
    return np.where(through[:, None], d, _mirrored(d, facing)), whole, through, through


def _pane(transmitted: float, reflected: float, d, n, facing, rng):  # type: ignore[no-untyped-def]
    back = np.where((d * n).sum(axis=1) < 0, reflected, 0.0)
    whole = transmitted + back
    through = rng.random(len(d)) * np.maximum(whole, 1e-9) < transmitted
    side = np.where(through[:, None], -facing, facing)
    return cosine(side, rng), whole, through, False


def _diffuser(m: DiffuserMaterial, d, n, facing, rng):  # type: ignore[no-untyped-def]
    return _pane(m.transmittance, m.reflectance, d, n, facing, rng)


def _film(m: BsdfMaterial, d, n, facing, rng):  # type: ignore[no-untyped-def]
    sent = min(1.0, film(m.file).largest_albedo)
    return _pane((1 - REFLECTED) * sent, REFLECTED * sent, d, n, facing, rng)


def _solid(m: DielectricMaterial, d, n, facing, rng):  # type: ignore[no-untyped-def]
    """Refraction and Fresnel's reflection; normals point out of the solid."""
    c = -(d * facing).sum(axis=1)
    eta = np.where((d * n).sum(axis=1) < 0, 1 / m.ior, m.ior)
    below = 1 - eta**2 * (1 - c**2)
    e = np.sqrt(np.maximum(below, 0))
    s, p = (eta * c - e) / (eta * c + e), (c - eta * e) / (c + eta * e)
    back = np.where(below > 0, (s**2 + p**2) / 2, 1.0)
    through = rng.random(len(d)) >= back
    bent = eta[:, None] * d + (eta * c - e)[:, None] * facing
    return np.where(through[:, None], bent, _mirrored(d, facing)), 1.0, through, False


_LOBES: dict[type, Lobes] = {
    Lambertian: _diffuse, MirrorMaterial: _mirror, GlazingMaterial: _glass,
    DiffuserMaterial: _diffuser, BsdfMaterial: _film, DielectricMaterial: _solid,
}  # fmt: skip
