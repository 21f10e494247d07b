"""Areas that photons are counted on: the cells of diffuse surfaces, and squares around sensors.

A photon map gives irradiance as flux per area. The area of a cell is all diffuse surface within it
that light can reach. Around a sensor it is a small square in the sensor's plane, a virtual surface
that records the photons that cross it.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import add_at, flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.materials import is_diffuse
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.photons.reached import ReachedSurfaces
from drcmitsuba.transport.rays.bsdf_lookup import number, table

spatial = lazy.module("scipy.spatial")

POINTS = 1024
"""Number of points that measure the area of a whole face of a cell."""
MOST_POINTS = 1 << 23
"""Largest number of these points in a scene; areas in very large scenes are coarser."""
OFFSET = 1e-4
"""Distance of these points from their surface [m]."""
SMALLEST = 0.02
"""Least edge of a square [m]."""
AROUND = 32
"""Number of directions in which a sensor looks for surfaces that limit its square."""
_NONE = 0xFFFFFFFF


@dataclass(frozen=True)
class CellAreas:
    """Areas of the cells of diffuse surfaces."""

    grid: CellGrid
    row: mi.UInt32
    """Row of every key of the grid; `_NONE` without area."""
    area: mi.Float
    """Area of every row [m²]."""

    @classmethod
    def of(
        cls, scene: Scene, grid: CellGrid, seed: int, reached: ReachedSurfaces | None = None
    ) -> CellAreas:
        """Measure the areas by points spread evenly over both sides of all diffuse surfaces.

        Points inside closed bodies do not count: a ray along the normal meets a back. Nor do those
        that `reached` excludes.
        """
        area = dr.zeros(mi.Float64, len(grid))
        every = _triangles([p.quads for p in scene.parts if is_diffuse(p.material)])
        for triangles in _near_and_far(scene, every):
            whole = float(_sizes(triangles).sum())
            count = min(MOST_POINTS, int(np.ceil(whole / grid.size**2 * POINTS)))
            p, n = _spread(triangles, count, seed)
            for facing in (n, -n):
                exposed = _exposed(scene, p, facing)
                if reached is not None:
                    exposed &= reached.counts(p, facing)
                key = grid.key(p, mi.Normal3f(facing))
                add_at(area, mi.Float64(whole / count), key, exposed)
        there = dr.compress(area > 0)
        row = dr.full(mi.UInt32, _NONE, len(grid))
        if dr.width(there):
            dr.scatter(row, dr.arange(mi.UInt32, dr.width(there)), there)
        measured = mi.Float(dr.gather(mi.Float64, area, there))
        dr.eval(row, measured)
        return cls(grid, row, measured)

    def __len__(self) -> int:
        """Count the rows."""
        return dr.width(self.area)

    def at(self, key: mi.UInt32, active: mi.Bool | bool = True) -> tuple[mi.UInt32, mi.Bool]:
        """Rows of keys, and whether they exist."""
        row = dr.gather(mi.UInt32, self.row, key, active)
        return row, (row != _NONE) & active

    def record(
        self, si: mi.SurfaceInteraction3f, d: mi.Vector3f, flux: mi.Float, column: mi.UInt32,
        bins: mi.UInt32, sums: mi.Float64, active: mi.Bool,
    ) -> None:  # fmt: skip
        """Add the flux of photons that arrive along `d` to the cells on their side of surfaces."""
        facing = dr.select(dr.dot(si.n, d) < 0, si.n, -si.n)
        row, known = self.at(self.grid.key(si.p, facing), active)
        dr.scatter_add(sums, mi.Float64(flux), row * bins + column, known)


def _triangles(quads: list[np.ndarray]) -> np.ndarray:
    """Triangles (triangle, 3, 3) of positive area that make up quadrilaterals (quad, 4, 3)."""
    q = np.concatenate([np.zeros((0, 4, 3)), *quads])
    triangles = q[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    return triangles[_sizes(triangles) > 0]


def _near_and_far(scene: Scene, triangles: np.ndarray) -> list[np.ndarray]:
    """Triangles of the rooms of a model, and those that reach beyond; terrain may be vast."""
    if scene.near is None:
        return [triangles] if len(triangles) else []
    low, high = scene.near + [[-1e-3], [1e-3]]
    at = scene.along_walls(triangles)
    near = ((at >= low) & (at <= high)).all(axis=(1, 2))
    return [part for part in (triangles[near], triangles[~near]) if len(part)]


def _sizes(triangles: np.ndarray) -> np.ndarray:
    """Areas of triangles [m²]."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.linalg.norm(np.cross(u, v), axis=1) / 2


def _spread(triangles: np.ndarray, count: int, seed: int) -> tuple[mi.Point3f, mi.Vector3f]:
    """Points spread evenly over triangles (triangle, 3, 3), and their normals."""
    corner = triangles[:, 0]
    u, v = triangles[:, 1] - corner, triangles[:, 2] - corner
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shares = np.cumsum(_sizes(triangles))
    lane = dr.arange(mi.UInt32, count)
    at, table = (mi.Float64(lane) + 0.5) / count, mi.Float64(shares[:-1] / shares[-1])
    which = dr.binary_search(0, len(shares) - 1, lambda i: dr.gather(mi.Float64, table, i) < at)
    a, b = even_numbers(lane, dr.zeros(mi.UInt32, count), seed, 0)
    over = a + b > 1
    a, b = dr.select(over, 1 - a, a), dr.select(over, 1 - b, b)
    c, u_, v_, n = (dr.gather(mi.Vector3f, flat(x), which) for x in (corner, u, v, normal))
    return mi.Point3f(c + a * u_ + b * v_), n


def _exposed(scene: Scene, p: mi.Point3f, n: mi.Vector3f) -> mi.Bool:
    """Whether points on a surface lie outside of all closed bodies, on the side of `n`."""
    if not any(part.closed for part in scene.parts):
        return mi.Bool(True)
    closed = mi.UInt32(table(scene, [part.closed for part in scene.parts], np.uint32))
    si = scene.full.ray_intersect(mi.Ray3f(p + OFFSET * n, n), mi.RayFlags.Minimal, coherent=False)
    of_body = dr.gather(mi.UInt32, closed, number(si.bsdf()), si.is_valid()) == 1
    return ~(si.is_valid() & of_body & (dr.dot(si.n, n) > 0))


@dataclass(frozen=True)
class SensorPlane:
    """Sensors in one plane, and a raster over it that lists the sensors near each field."""

    origin: np.ndarray
    """Corner of the raster [m], shape (3,)."""
    axes: np.ndarray
    """Rows, shape (3, 3): x and y of the raster, and the sensors' normal."""
    edge: float
    """Edge of the raster's fields [m]."""
    count: tuple[int, int]
    """Number of fields along x and y."""
    sensors: np.ndarray
    """Sensors whose square reaches into a field, int, shape (layer, field); −1 for none."""


@dataclass(frozen=True)
class Squares:
    """Squares around sensors, in their planes."""

    planes: tuple[SensorPlane, ...]
    centre: np.ndarray
    """Centres in the raster's axes [m], shape (sensor, 2)."""
    edge: np.ndarray
    """Edges of the squares [m], shape (sensor,)."""

    @classmethod
    def of(cls, scene: Scene, points: np.ndarray, normals: np.ndarray, size: float) -> Squares:
        """Lay squares of at most `size` [m] around sensors.

        No square reaches beyond the room, into furniture, or to the centre of a neighbour in its
        plane, unless that would make its edge smaller than `SMALLEST`.
        """
        if not len(points):
            return cls((), np.zeros((0, 2)), np.zeros(0))
        near = 2 * np.minimum(_to_walls(scene, points), _to_things(scene, points, normals))
        for mine in by_plane(points, normals):
            near[mine] = np.minimum(near[mine], _to_neighbours(points[mine]))
        return cls.around(scene, points, normals, np.clip(near, SMALLEST, size))

    @classmethod
    def around(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, edge: np.ndarray
    ) -> Squares:
        """Lay squares of some edges (sensor,) [m] around sensors."""
        centre = np.zeros((len(points), 2))
        planes = []
        for mine in by_plane(points, normals):
            axes = in_plane(scene, normals[mine[0]])
            at = points[mine] @ axes[:2].T
            centre[mine] = at
            offset = float(points[mine[0]] @ axes[2])
            planes.append(_plane(mine, at, edge, axes, offset))
        return cls(tuple(planes), centre, edge)


def in_plane(scene: Scene, n: np.ndarray) -> np.ndarray:
    """Axes of squares in a plane of normal n, and n, rows of a matrix (3, 3)."""
    turn = np.eye(3) if scene.enclosure is None else scene.enclosure.turn
    x = turn[:, 0] if abs(turn[:, 0] @ n) < 0.7 else turn[:, 2]
    x = x - (x @ n) * n
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(n, x), n])


def by_plane(points: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Sensors of each plane, indices."""
    offset = np.einsum("si,si->s", points, normals)
    keys = np.round(np.column_stack([normals, offset]), 4)
    keys, plane_of = np.unique(keys, axis=0, return_inverse=True)
    return [np.flatnonzero(plane_of.ravel() == k) for k in range(len(keys))]


def _plane(
    mine: np.ndarray, at: np.ndarray, edge: np.ndarray, axes: np.ndarray, height: float
) -> SensorPlane:
    """Raster over the sensors `mine` at positions `at` in their plane."""
    extent = np.ptp(at, axis=0).max()
    near = spatial.cKDTree(at).query(at, 2, p=np.inf)[0][:, 1].min() if len(at) > 1 else 1.0
    # On a regular grid of sensors each field holds one of them.
    field = float(np.clip(near, max(edge[mine].max(), extent / 1000), None))
    low = at.min(axis=0) - field / 2
    reach = edge[mine, None] / 2 * (1 - 1e-6)
    first, last = (np.floor((at + s * reach - low) / field).astype(int) for s in (-1, 1))
    low = low + field * first.min(axis=0)
    last, first = last - first.min(axis=0), first - first.min(axis=0)
    count = last.max(axis=0) + 1
    fields: dict[int, list[int]] = {}
    for sensor, (i0, j0), (i1, j1) in zip(mine, first, last, strict=True):
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                fields.setdefault(j * int(count[0]) + i, []).append(int(sensor))
    layers = np.full((max(map(len, fields.values())), int(count.prod())), -1)
    for index, members in fields.items():
        layers[: len(members), index] = members
    origin = low @ axes[:2] + height * axes[2]
    return SensorPlane(origin, axes, field, (int(count[0]), int(count[1])), layers)


def _to_neighbours(points: np.ndarray) -> np.ndarray:
    """Distance to the nearest other place of a sensor, ∞ without one [m]."""
    places, place = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    if len(places) == 1:
        return np.full(len(points), np.inf)
    nearest = spatial.cKDTree(places).query(places, 2, p=np.inf)[0][:, 1]
    return np.asarray(nearest[place.ravel()])


def _to_walls(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Distance to the nearest wall of the room along its axes [m]."""
    if scene.enclosure is None or not scene.enclosure.is_box:
        return np.full(len(points), np.inf)
    at, size = points @ scene.enclosure.turn, scene.enclosure.size
    return np.minimum(at, size - at)[:, :2].min(axis=1)


def _to_things(scene: Scene, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Distance to the nearest surface in the sensors' planes, in `AROUND` directions [m]."""
    turn = np.eye(3) if scene.enclosure is None else scene.enclosure.turn
    lane = dr.arange(mi.UInt32, len(points) * AROUND)
    sensor, angle = lane // AROUND, mi.Float(lane % AROUND) * (2 * np.pi / AROUND)
    p, n = (dr.gather(mi.Vector3f, flat(a), sensor) for a in (points, normals))
    x = mi.Vector3f(*map(float, turn[:, 0]))
    x = dr.normalize(x - dr.dot(x, n) * n)
    x = dr.select(dr.isfinite(x.x), x, mi.Frame3f(n).s)
    sine, cosine = dr.sincos(angle)
    ray = mi.Ray3f(mi.Point3f(p), cosine * x + sine * dr.cross(n, x))
    t = scene.full.ray_intersect_preliminary(ray, coherent=False).t
    away = (t * dr.maximum(dr.abs(sine), dr.abs(cosine))).numpy()
    return away.reshape(-1, AROUND).min(axis=1)
