"""Where photons start: points on the ports of components, aimed from suns, sky and ground."""

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
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.random_streams import even_numbers, even_order
from drcmitsuba.scene.geometry import is_triangle
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.mirrors.planar_mirrors import imaged_components
from drcmitsuba.transport.photons.changing_panes import ChangingPanes
from drcmitsuba.transport.photons.pane_ports import pane_ports
from drcmitsuba.transport.rays.shadow_rays import straight, sun_numbers

OFFSET = 1e-4
"""Distance of a port from a pane, and of photons from their port, per metre of coordinates.

Photons start this far before their port, so that rounding leaves a pane in its plane behind them.
"""
GROUND = 4, 9
"""Rows and columns of the equal parts of the ground: one source of half of all directions would
have the photons of a single patch of the sky."""
PILOT = 4096
"""Number of rays from a port that test its view of sky and ground."""


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


def of_sky(subdivision: int) -> PhotonSources:
    """Parts of the ground, and sky patches of Reinhart's MF."""
    patches, parts = Patches(subdivision), _parts_of_ground()
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


def _parts_of_ground() -> np.ndarray:
    """Bounds of the ground's parts: low, high, west and east [rad], shape (part, 4)."""
    rows, columns = GROUND
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
        corners, least = self.scene.corners, -_offset(self.quads)
        planes = zip(self.quads[:, 0], self.normal, strict=True)
        return all(((corners - q) @ n > least).all() for q, n in planes)

    @cached_property
    def in_line(self) -> bool:
        """Whether light might pass one port after another."""
        n, quads = self.normal, self.quads
        heights = np.einsum("pi,pqci->pqc", n, quads[None] - quads[:, None, :1])
        behind = (heights > _offset(quads)).any(axis=2)
        return bool((behind & (n @ n.T > 1e-6 - 1)).any())

    def _at(self, port: mi.UInt32, uv: mi.Point2f) -> tuple[mi.Point3f, mi.Normal3f]:
        """Point on a port and the port's normal."""
        columns = (*self.edges, self.normal)
        at, u, v, n = (dr.gather(mi.Vector3f, flat(column), port) for column in columns)
        fold = dr.gather(mi.Bool, mi.Bool(is_triangle(self.quads)), port) & (uv.x + uv.y > 1)
        uv = dr.select(fold, 1 - uv, uv)
        return mi.Point3f(at + uv.x * u + uv.y * v), mi.Normal3f(n)

    def _visible(self, p: mi.Point3f, d: mi.Vector3f, flux: mi.Float) -> mi.Float:
        """Flux that reaches points on ports along directions d to the source."""
        if self.in_line:
            flux = dr.select(self._passed(p, d), 0, flux)
        if self.exposed:
            return flux
        return flux * straight(self.scene, p, d, flux > 0)

    def _passed(self, p: mi.Point3f, d: mi.Vector3f) -> mi.Bool:
        """Whether light from directions d passes another port before it reaches the points."""
        corner, u, v = self.edges
        n, area = self.normal, np.linalg.norm(np.cross(u, v), axis=1)[:, None]
        # Products of a point with the dual edges are its coordinates in the parallelogram.
        tables = [flat(a) for a in (corner, np.cross(v, n) / area, np.cross(n, u) / area, n)]
        most = flat(np.where(is_triangle(self.quads), 1.0, 2.0))
        return _crossed(tables, most, dr.opaque(mi.UInt32, len(self)), p, d)

    def could(self, sources: PhotonSources) -> np.ndarray:
        """Upper bound of the area [m²] that ports turn towards sources, shape (source, port)."""
        cosine = -sources.centre @ self.normal.T
        away = np.maximum(np.arccos(np.clip(cosine, -1, 1)) - sources.radius[:, None], 0)
        return self.area * np.clip(np.cos(away), 0, None)

    def start(
        self, sources: PhotonSources, seen: np.ndarray, could: np.ndarray, photons: int, seed: int,
        lane: mi.UInt32, panes: ChangingPanes | None = None,
    ) -> Start:  # fmt: skip
        """Start some of `photons` photons from each of the sources `seen`, numbered by `lane`.

        A port is chosen with a probability proportional to `could`, shape (seen, port). The points
        of one source are spread evenly over the ports and the source. A lane is the place of the
        source in `seen` · photons + the photon's number. Where panes may change, light from the
        ports of panes counts as light that has passed one.
        """
        each, count = dr.opaque(mi.UInt32, photons), dr.opaque(mi.UInt32, len(self))
        place, index = lane // each, self.index(lane, photons)
        source = dr.gather(mi.UInt32, flat_indices(seen), place)
        share = could / could.sum(axis=1, keepdims=True)
        table = flat(np.cumsum(share, axis=1))
        number = dr.gather(mi.UInt32, mi.UInt32(sources.numbers), source)
        where, at = (even_numbers(index, number, seed, pair) for pair in (0, 1))
        row = place * count
        port = dr.binary_search(
            0, len(self) - 1, lambda i: dr.gather(mi.Float, table, row + i) <= where.x
        )
        chance = dr.gather(mi.Float, flat(share), row + port)
        before = dr.gather(mi.Float, table, row + port) - chance
        where.x = dr.clip((where.x - before) / chance, 0, 1)
        p, n = self._at(port, where)
        d = sources.draw(source, at)
        p = mi.Point3f(p + _offset(self.quads) * d)
        flux = dr.gather(mi.Float, flat(sources.solid_angle), source)
        flux *= dr.gather(mi.Float, flat(self.area), port)
        flux *= dr.maximum(-dr.dot(d, n), 0) / (chance * mi.Float(each))
        of_panes = panes is not None and not self.name
        by_pane = dr.opaque(mi.Bool, of_panes, dr.width(lane))  # a literal: compiled anew
        if panes is not None and self.name and panes.stand_before(self.quads, self.normal):
            self.scene.ray_counter.add("shadow", mi.Bool(True), dr.width(lane))
            by_pane = panes.passed(p, d)
        bins = dr.gather(mi.UInt32, flat_indices(sources.bins), source)
        seen_flux = self._visible(p, d, dr.select(chance > 0, flux, 0))
        return Start(p, -d, seen_flux, source, bins, by_pane)

    def index(self, lane: mi.UInt32, photons: int) -> mi.UInt32:
        """Index of the photon of a lane among the `photons` of its source.

        Photons that start side by side, at heights that follow one another, have similar ways: they
        fill the lanes of a processor better.
        """
        _, u, v = self.edges
        order, _ = even_order(photons, 0 if abs(u[0, 2]) >= abs(v[0, 2]) else 1)
        return dr.gather(mi.UInt32, flat_indices(order), lane % dr.opaque(mi.UInt32, photons))

    def sky_share(self, seed: int = 0) -> np.ndarray:
        """Share of its cosine-weighted hemisphere that every port sees of sky and ground."""
        lane = dr.arange(mi.UInt32, len(self) * PILOT)
        port, index = lane // PILOT, lane % PILOT
        p, n = self._at(port, even_numbers(index, port, seed, 0))
        at = even_numbers(index, port, seed, 1)
        d = mi.Frame3f(mi.Normal3f(-n)).to_world(mi.warp.square_to_cosine_hemisphere(at))
        seen = self._visible(p, d, dr.full(mi.Float, 1 / PILOT, dr.width(lane)))
        return np.asarray(dr.block_sum(seen, PILOT).numpy(), float)


@symbolic
def _crossed(
    tables: list[mi.Float], most: mi.Float, count: mi.UInt32, p: mi.Point3f, d: mi.Vector3f
) -> mi.Bool:
    """Whether rays cross any parallelogram (corner, two dual edges, normal) from the front.

    The sum of a point's coordinates is at most `most`: 2, or 1 for a triangle.
    """
    i, crossed = mi.UInt32(0), mi.Bool(False)
    while dr.hint(i < count, exclude=[tables, most, p, d, count]):
        corner, u, v, n = (dr.gather(mi.Vector3f, table, i) for table in tables)
        t = dr.dot(corner - p, n) / dr.dot(d, n)
        at = p + t * d - corner
        a, b = dr.dot(at, u), dr.dot(at, v)
        inside = (a >= 0) & (a < 1) & (b >= 0) & (b < 1) & (a + b < dr.gather(mi.Float, most, i))
        crossed |= (dr.dot(d, n) < 0) & (t > 0) & inside
        i += 1
    return crossed


def _offset(points: np.ndarray) -> float:
    """Offset that separates the two sides of a port, for coordinates (…, 3) [m]."""
    return OFFSET * (1 + float(abs(points).max()))
