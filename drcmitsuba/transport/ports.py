"""Where photons start: points on the ports of components, aimed from suns, sky and ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.scene import Scene
from drcmitsuba.transport.gather import even_numbers
from drcmitsuba.transport.shadow_rays import straight

PILOT = 4096
"""Rays from a port that tell whether it sees anything of the sky and the ground."""

Draw = Callable[[Any, Any], Any]
"""Direction to a source, by its number and two uniform numbers."""


@dataclass(frozen=True)
class Start:
    """Photons on their ports.

    Parameters
    ----------
    p : mi.Point3f
    d : mi.Vector3f
        Direction of travel.
    flux : mi.Float
        Per unit radiance of the source [m² sr].
    bin : mi.UInt32
    component : mi.UInt32
        Number of the port's component.
    """

    p: mi.Point3f
    d: mi.Vector3f
    flux: mi.Float
    bin: mi.UInt32
    component: mi.UInt32


@dataclass(frozen=True)
class Ports:
    """Ports of a scene.

    Parameters
    ----------
    scene : Scene
    quads : np.ndarray, shape (port, 4, 3)
        Parallelograms [m]; fronts face the way the light goes.
    component : np.ndarray of int, shape (port,)
        Number of the component among `names`.
    names : tuple of str
    """

    scene: Scene
    quads: np.ndarray
    component: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene) -> Ports:
        """Ports of a scene."""
        names = tuple(sorted({part.component for part in scene.parts}))
        quads = np.reshape([port.quad for port in scene.ports], (-1, 4, 3))
        component = np.array([names.index(port.component) for port in scene.ports], dtype=int)
        return cls(scene, quads, component, names)

    def __len__(self) -> int:
        """Count the ports."""
        return len(self.quads)

    @cached_property
    def normal(self) -> np.ndarray:
        """Area times unit normal [m²], shape (port, 3)."""
        return np.cross(self.quads[:, 1] - self.quads[:, 0], self.quads[:, 3] - self.quads[:, 0])

    @cached_property
    def area(self) -> np.ndarray:
        """Of every port [m²]."""
        return np.linalg.norm(self.normal, axis=1)

    @cached_property
    def exposed(self) -> bool:
        """Whether nothing lies before any port: what it faces is sky or ground."""
        n = self.normal / self.area[:, None]
        heights = (self.scene.corners[None] - self.quads[:, :1]) @ n[..., None]
        return bool((heights > -1e-6).all())

    def _columns(self) -> tuple[mi.Float, mi.Float, mi.Float, mi.Float, mi.UInt32]:
        """Corner, edges and unit normal of every port, three numbers each, and component."""
        corner = self.quads[:, 0]
        u, v = self.quads[:, 1] - corner, self.quads[:, 3] - corner
        n = self.normal / self.area[:, None]
        parts = (mi.Float(a.astype(np.float32).ravel()) for a in (corner, u, v, n))
        return (*parts, mi.UInt32(self.component.astype(np.uint32)))

    def _at(self, port: mi.UInt32, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Normal3f, mi.UInt32]:
        """Point on a port, its normal and its component."""
        corner, u, v, n, component = self._columns()
        p = dr.gather(mi.Point3f, corner, port)
        p += uv.x * dr.gather(mi.Vector3f, u, port) + uv.y * dr.gather(mi.Vector3f, v, port)
        return p, dr.gather(mi.Normal3f, n, port), dr.gather(mi.UInt32, component, port)

    def _visible(self, p: mi.Point3f, d: mi.Vector3f, flux: mi.Float) -> mi.Float:
        """Flux that comes to points on ports from where they look."""
        if self.exposed:
            return flux
        return flux * straight(self.scene, None, p, d, flux > 0)

    def from_suns(
        self, suns: np.ndarray, diameter: float, photons: int, first: int, lanes: int, seed: int
    ) -> Start:
        """Photons first … first + lanes − 1 of those from suns, `photons` of each.

        Their points are spread evenly over the ports and the sun's disk.
        """
        centres = mi.Float(suns.astype(np.float32).ravel())
        omega = np.full(len(suns), disk_solid_angle(diameter))
        radius = np.full(len(suns), np.radians(diameter) / 2)

        def draw(sun: mi.UInt32, uv: mi.Point2f) -> mi.Vector3f:
            return sample_disk(dr.gather(mi.Vector3f, centres, sun), diameter, uv)

        could = self.could(suns, radius)
        return self._aimed(could, omega, draw, photons, first, lanes, seed)

    def from_sky(
        self, patches: Patches, bins: np.ndarray, photons: int, first: int, lanes: int, seed: int
    ) -> Start:
        """Photons first … first + lanes − 1 of those from some patches, `photons` of each.

        Bins are counted within `bins`.
        """
        bounds = patches.bounds[bins]
        bounds[:, :2] = np.sin(bounds[:, :2])
        table = [mi.Float(column.astype(np.float32)) for column in bounds.T]

        def draw(index: mi.UInt32, uv: mi.Point2f) -> mi.Vector3f:
            low, high, west, east = (dr.gather(mi.Float, column, index) for column in table)
            z, azimuth = dr.lerp(low, high, uv.x), dr.lerp(west, east, uv.y)
            level = dr.safe_sqrt(1 - z * z)
            sine, cosine = dr.sincos(azimuth)
            return mi.Vector3f(level * sine, level * cosine, z)

        could = self.could(patches.directions[bins], patch_radii(patches)[bins])
        return self._aimed(could, patches.solid_angles[bins], draw, photons, first, lanes, seed)

    def could(self, centres: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """Bound of the area that ports turn towards sources within `radius` [rad] of `centres`.

        Returns
        -------
        np.ndarray, shape (source, port)
            [m²]; 0 where no light of the source can pass the port.
        """
        cosine = -centres @ (self.normal / self.area[:, None]).T
        away = np.maximum(np.arccos(np.clip(cosine, -1, 1)) - radius[:, None], 0)
        return self.area * np.clip(np.cos(away), 0, None)

    def _aimed(
        self, could: np.ndarray, omega: np.ndarray, draw: Draw, photons: int, first: int,
        lanes: int, seed: int,
    ) -> Start:  # fmt: skip
        """Photons of sources, by what ports could get of them [m²] and solid angles [sr].

        A port is chosen by the flux that it could get.
        """
        lane = dr.arange(mi.UInt32, lanes) + dr.opaque(mi.UInt32, first)
        each, count = dr.opaque(mi.UInt32, photons), dr.opaque(mi.UInt32, len(self))
        source, index = lane // each, lane % each
        share = could / np.maximum(could.sum(axis=1, keepdims=True), 1e-30)
        table = mi.Float(np.cumsum(share, axis=1).astype(np.float32).ravel())
        where, at = (even_numbers(index, source, seed, pair) for pair in (0, 1))
        row = source * count
        port = dr.binary_search(
            0, len(self) - 1, lambda i: dr.gather(mi.Float, table, row + i) <= where.x
        )
        chance = dr.gather(mi.Float, mi.Float(share.astype(np.float32).ravel()), row + port)
        before = dr.gather(mi.Float, table, row + port) - chance
        where.x = dr.clip((where.x - before) / chance, 0, 1)
        p, n, component = self._at(port, where)
        d = draw(source, at)
        value = dr.gather(mi.Float, mi.Float(omega.astype(np.float32)), source)
        value *= dr.gather(mi.Float, mi.Float(self.area.astype(np.float32)), port)
        flux = value * dr.maximum(-dr.dot(d, n), 0) / (chance * mi.Float(each))
        flux = self._visible(p, d, dr.select(chance > 0, flux, 0))
        return Start(p, -d, flux, source, component)

    def sky_share(self, seed: int = 0) -> np.ndarray:
        """Share of its cosine-weighted hemisphere that every port sees of sky and ground."""
        if len(self) == 0:
            return np.zeros(0)
        lane = dr.arange(mi.UInt32, len(self) * PILOT)
        port, index = lane // PILOT, lane % PILOT
        p, n, _ = self._at(port, even_numbers(index, port, seed, 0))
        at = even_numbers(index, port, seed, 1)
        d = mi.Frame3f(mi.Normal3f(-n)).to_world(mi.warp.square_to_cosine_hemisphere(at))
        seen = self._visible(p, d, dr.full(mi.Float, 1 / PILOT, dr.width(lane)))
        return np.asarray(dr.block_sum(seen, PILOT).numpy(), float)


def patch_radii(patches: Patches) -> np.ndarray:
    """Largest angle [rad] from the centre of every patch to a point of it, shape (bin,)."""
    low, high, west, east = patches.bounds.T
    widest = np.cos(np.where(low < 0, 0, low)) * (east - west) / 2
    radius = np.hypot((high - low) / 2, widest)
    radius[0], radius[-1] = np.pi / 2, high[-1] - low[-1]
    return radius
