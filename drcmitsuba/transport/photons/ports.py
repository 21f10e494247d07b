"""Ports of components, where photons start, and what lights them: suns, sky and ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle, sample_disk

from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import is_triangle
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.planar_mirrors import imaged_components
from drcmitsuba.transport.photons.pane_ports import pane_ports
from drcmitsuba.transport.rays.shadow_rays import sun_numbers

OFFSET = 1e-4
"""Distance of a port from a pane, and of photons from their port, per metre of coordinates.

Photons start this far before their port, so that rounding leaves a pane in its plane behind them.
"""
GROUND = 4, 9
"""Rows and columns of the equal parts of the ground, times `patch_ratio`: one source of half of all
directions would have the photons of a single patch of the sky."""
FINEST = 4
"""Largest factor MF for which patches share the photons of one of Tregenza's; beyond it each would
have too few."""


class PhotonSources(NamedTuple):
    """Suns, or parts of the ground and sky patches."""

    centre: np.ndarray
    """Unit vectors to the centres, shape (source, 3)."""
    radius: np.ndarray
    """Angle around the centre that contains the source [rad], shape (source,)."""
    solid_angle: np.ndarray
    """Solid angle [sr], shape (source,)."""
    numbers: np.ndarray
    """Seeds of the random numbers, uint32, shape (source,)."""
    draw: Callable[[Any, Any], Any]
    """Gives a direction to a source, uniform in solid angle, from its index and two uniform
    numbers."""
    bins: np.ndarray
    """Bin of every source, int, shape (source,)."""


def of_suns(suns: np.ndarray, diameter: float) -> PhotonSources:
    """Suns in directions (sun, 3), `diameter` [deg] across."""
    centres = flat(suns)
    radius = np.full(len(suns), np.radians(diameter) / 2)
    return PhotonSources(
        suns, radius, np.full(len(suns), disk_solid_angle(diameter)), sun_numbers(suns),
        lambda sun, uv: sample_disk(dr.gather(mi.Vector3f, centres, sun), diameter, uv),
        np.arange(len(suns)),
    )  # fmt: skip


def patch_ratio(subdivision: int) -> int:
    """Edge of a patch of Tregenza's sky over that of the patches that share its photons."""
    return min(subdivision, FINEST)


def of_sky(subdivision: int) -> PhotonSources:
    """Parts of the ground, and sky patches of Reinhart's MF."""
    patches, parts = Patches(subdivision), _parts_of_ground(patch_ratio(subdivision))
    low, high, west, east = np.concatenate([parts, patches.bounds[1:]]).T
    widest = np.where(low < 0, high, low)
    radius = np.hypot((high - low) / 2, np.cos(widest) * (east - west) / 2)
    radius[-1] = high[-1] - low[-1]
    up, around = (low + high)[: len(parts)] / 2, (west + east)[: len(parts)] / 2
    level = np.cos(up)
    middles = np.stack([level * np.sin(around), level * np.cos(around), np.sin(up)], axis=1)
    columns = [flat(column) for column in (np.sin(low), np.sin(high), west, east)]

    def draw(patch: mi.UInt32, uv: mi.Point2f) -> mi.Vector3f:
        bottom, top, begin, end = (dr.gather(mi.Float, column, patch) for column in columns)
        z = dr.lerp(bottom, top, uv.x)
        sine, cosine = dr.sincos(dr.lerp(begin, end, uv.y))
        level = dr.safe_sqrt(1 - z * z)
        return mi.Vector3f(level * sine, level * cosine, z)

    numbers = np.arange(1, len(patches)), len(patches) + np.arange(len(parts))
    return PhotonSources(
        np.concatenate([middles, patches.directions[1:]]), radius,
        np.concatenate([np.full(len(parts), 2 * np.pi / len(parts)), patches.solid_angles[1:]]),
        np.concatenate(numbers[::-1]).astype(np.uint32), draw,
        np.concatenate([np.zeros(len(parts), int), numbers[0]]),
    )  # fmt: skip


def _parts_of_ground(finer: int) -> np.ndarray:
    """Bounds of the ground's parts: low, high, west and east [rad], shape (part, 4)."""
    rows, columns = (finer * count for count in GROUND)
    heights = -np.arcsin(np.arange(rows + 1) / rows)
    turns = 2 * np.pi * np.arange(columns + 1) / columns
    rings = [(low, high) for high, low in pairwise(heights)]
    return np.array([(*ring, *turn) for ring in rings for turn in pairwise(turns)])


class Start(NamedTuple):
    """Photons on their ports."""

    p: mi.Point3f
    d: mi.Vector3f
    """Direction of travel."""
    flux: mi.Float
    """Flux per unit radiance of the source [m² sr]."""
    source: mi.UInt32
    bin: mi.UInt32
    index: mi.UInt32
    """Number among the photons of the source to the component."""
    component: mi.UInt32
    """Number among the components of the launch."""
    by_pane: mi.Bool
    """Whether the way from the source passes one of `ChangingPanes`."""


@dataclass(frozen=True)
class ComponentPorts:
    """Ports of one component, or of the panes, of a scene."""

    scene: Scene
    quads: np.ndarray
    """Parallelograms, and triangles that repeat their last corner [m], shape (port, 4, 3); fronts
    face the way the light goes."""
    name: str
    """Name of the component; "" stands for the panes."""

    @classmethod
    def of(cls, scene: Scene, *, imaged: bool = False) -> tuple[ComponentPorts, ...]:
        """Collect the ports of each component of a scene, and at last those of the panes.

        Where photons do not count what is `imaged`, ports whose light has images are left out.
        """
        quads: dict[str, list[np.ndarray]] = {}
        apart = frozenset() if imaged or not scene.ports else imaged_components(scene)
        ports = [port for port in scene.ports if port.component not in apart]
        for port in [*ports, *pane_ports(scene, imaged=imaged)] if scene.followed else []:
            quads.setdefault(port.component, []).append(port.quad)
        return tuple(
            cls(scene, np.array(quads[name], float), name)
            for name in sorted(quads, key=lambda name: (not name, name))
        )

    def __len__(self) -> int:
        """Count the ports."""
        return len(self.quads)

    @property
    def edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corner and the two edges from there, shape (port, 3) each [m]."""
        corner = self.quads[:, 0]
        return corner, self.quads[:, 1] - corner, self.quads[:, 3] - corner

    @cached_property
    def area(self) -> np.ndarray:
        """Area of every port, shape (port,) [m²]."""
        across = np.linalg.norm(np.cross(*self.edges[1:]), axis=1)
        return across / (1 + is_triangle(self.quads))

    @cached_property
    def normal(self) -> np.ndarray:
        """Unit normals, the way the light goes, shape (port, 3)."""
        n = np.cross(*self.edges[1:])
        return n / np.linalg.norm(n, axis=1)[:, None]

    @cached_property
    def exposed(self) -> bool:
        """Whether nothing lies before any port, so that all ports face only sky and ground."""
        corners, least = self.scene.corners, -self.offset
        planes = zip(self.quads[:, 0], self.normal, strict=True)
        return all(((corners - q) @ n > least).all() for q, n in planes)

    @cached_property
    def in_line(self) -> bool:
        """Whether light might pass one port after another."""
        n, quads = self.normal, self.quads
        heights = np.einsum("pi,pqci->pqc", n, quads[None] - quads[:, None, :1])
        behind = (heights > self.offset).any(axis=2)
        return bool((behind & (n @ n.T > 1e-6 - 1)).any())

    def could(self, sources: PhotonSources) -> np.ndarray:
        """Upper bound of the area [m²] that ports turn towards sources, shape (source, port)."""
        cosine = -sources.centre @ self.normal.T
        away = np.maximum(np.arccos(np.clip(cosine, -1, 1)) - sources.radius[:, None], 0)
        return self.area * np.clip(np.cos(away), 0, None)

    @cached_property
    def offset(self) -> float:
        """Distance that separates the two sides of a port, and photons from it [m]."""
        return OFFSET * (1 + float(abs(self.quads).max()))

    @property
    def rises_along_v(self) -> bool:
        """Whether the second edge of the first port rises more than the first one."""
        _, u, v = self.edges
        return bool(abs(u[0, 2]) < abs(v[0, 2]))
