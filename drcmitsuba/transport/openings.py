"""Openings of a room, and which points may see which suns through them.

A box tells which points lie in it. Of a room of any shape the sensors are told by rays: none leaves
it where its panes count as walls. What paths from there meet before they pass a pane is in it, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, repeated, row_and_column, vectors_of
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.launch_size import SHADOW_RAYS

CLUSTER = 32
"""Number of neighbouring suns that are traced or skipped together."""
TILE = 128
"""Number of neighbouring suns whose light on cells is gathered together."""
SLACK = 1e-3
"""Width by which openings count as larger on all sides, in doubt [m]."""
RAYS = 256
"""Number of rays by which a point is found to lie in a room of a model."""


Within: TypeAlias = "mi.Bool | bool | None"
"""Whether receivers lie in the room: all of them in a box, each one in the rooms of a model;
None where nobody knows. Looking it up on the device waits for all that is being computed."""


def has_shapeless_rooms(scene: Scene) -> bool:
    """Whether only paths tell which points lie in the rooms of a scene."""
    room = scene.enclosure
    return room is not None and room.spares and room.exits is not None


def in_rooms(scene: Scene, points: np.ndarray) -> np.ndarray | None:
    """Whether points (point, 3) lie in the rooms of a model, shape (point,); None for other scenes.

    No ray from such a point leaves the surfaces, all panes included.
    """
    if not has_shapeless_rooms(scene):
        return None
    block = SHADOW_RAYS // RAYS
    closed = [_is_closed_in(scene, points[i : i + block]) for i in range(0, len(points), block)]
    return np.concatenate([np.zeros(0, bool), *closed])


def within_of(scene: Scene, points: np.ndarray, in_rooms: np.ndarray | None = None) -> Within:
    """Whether points (point, 3) lie in the room; `in_rooms` (point,) tells it for a model."""
    if in_rooms is not None:
        return mi.Bool(in_rooms)
    room = scene.enclosure
    return room.contains(points) if room is not None and room.exits is None else None


def repeated_within(within: Within, times: int) -> Within:
    """Repeat what is known of receivers that stand several times one after another."""
    return within if within is None or isinstance(within, bool) else repeated(within, times)


def within_at(within: Within, row: mi.UInt32) -> Within:
    """Choose what is known of some of the receivers."""
    return within if within is None or isinstance(within, bool) else dr.gather(mi.Bool, within, row)


def _is_closed_in(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Whether all rays from each point meet a surface, shape (point,)."""
    lane = dr.arange(mi.UInt32, len(points) * RAYS)
    p = dr.gather(mi.Point3f, flat(points), lane // RAYS)
    d = mi.warp.square_to_uniform_sphere(even_numbers(lane % RAYS, lane // RAYS, 6, 0))
    hit = scene.full.ray_test(mi.Ray3f(p, d), coherent=False)
    return np.asarray(hit.numpy().reshape(-1, RAYS).all(axis=1))


@dataclass(frozen=True)
class Openings:
    """Openings of a room: rectangles (opening, 4, 3), fronts inward [m].

    Rays that miss all openings are not traced: they would meet a wall.
    """

    quads: np.ndarray
    within: mi.Bool | None = None
    """Whether each point lies in the room; None where all do."""
    occluders: mi.Scene | None = None
    """All that may hide what is seen by the openings, see `Scene.occluders`; None where walls may,
    too: openings then count as larger by `SLACK`."""

    @classmethod
    def of(cls, scene: Scene, points: mi.Float, within: Within = None) -> Openings | None:
        """Openings that points look through; None where all of them may lie outside the room.

        In the rooms of a model are the points of which `within` says so.
        """
        room = scene.enclosure
        if room is None or not room.spares:
            return None
        if room.exits is not None:
            return None if within is None else cls(room.exits, mi.Bool(within))
        if within is None:
            within = room.contains(points.numpy().reshape(-1, 3))
        return cls(room.openings, occluders=scene.occluders) if within else None

    @property
    def are_none(self) -> bool:
        """Whether no point can look out of the room."""
        return len(self.quads) == 0 and (self.within is None or bool(dr.all(self.within)))

    def passed(
        self, row: mi.UInt32, p: mi.Point3f, d: mi.Vector3f, spread: mi.Float | float = 0.0
    ) -> mi.Bool:
        """Whether cones of directions about d from p, the points `row`, may leave the room.

        A ray at angle δ ≤ `spread` [rad] to an axis of incidence θ meets the wall, at distance h,
        within h sin δ / (cos θ cos(θ + δ)) of the point where the axis meets it. In doubt yes.
        """
        result = mi.Bool(False)
        if self.within is not None:
            result = ~dr.gather(mi.Bool, self.within, row)
        for i in range(len(self.quads)):
            result |= self.passed_one(i, p, d, spread)
        return result

    def passed_one(
        self, opening: int, p: mi.Point3f, d: mi.Vector3f, spread: mi.Float | float = 0.0
    ) -> mi.Bool:
        """Whether cones of directions from p may leave the room by one opening, as `passed`."""
        s, c = dr.sincos(mi.Float(spread))
        corner, n, *sides, length = self.axes(opening)
        height, cosine = dr.dot(p - corner, n), -dr.dot(d, n)
        outermost = cosine * c - dr.safe_sqrt(1 - cosine * cosine) * s
        slack = SLACK if self.occluders is None else 0
        margin = dr.select(s > 0, height * s / (cosine * outermost) + SLACK, slack)
        y = p + height / cosine * d - corner
        inside = (height > -1e-3) & (cosine > 0)
        for side, most in zip(sides, length.xy, strict=True):
            along = dr.dot(y, side)
            inside &= (along > -margin) & (along < most + margin)
        return inside | ((s > 0) & (outermost < 0.01) & (cosine > -s))

    def axes(self, opening: int) -> tuple[mi.Vector3f, ...]:
        """Corner, normal, both directions, and their lengths twice, of an opening."""
        return _axes(self.quads.astype(float).tobytes(), str(mi.variant()))[opening]


@lru_cache(maxsize=16)  # every launch in a room asks for the same openings
def _axes(corners: bytes, variant: str) -> list[tuple[mi.Vector3f, ...]]:
    """Values of `Openings.axes` for openings by their corners in double precision, one of each.

    A kernel reads them: as literals they would have it compiled anew for every room.
    """
    quads = np.frombuffer(corners).reshape(-1, 4, 3)
    u, v = (quads[:, k] - quads[:, 0] for k in (1, 3))
    along, up = (np.linalg.norm(edge, axis=1, keepdims=True) for edge in (u, v))
    lengths = np.concatenate([along, up, up], axis=1)
    numbers = np.stack([quads[:, 0], normals(quads), u / along, v / up, lengths], axis=1)
    return [vectors_of(rows) for rows in numbers]


@lru_cache(maxsize=8)  # sensors and cells ask for the same suns
def _clusters(values: bytes) -> np.ndarray:
    """Indices of neighbouring directions, shape (cluster, CLUSTER), padded with −1.

    `values` are the directions in double precision.
    """
    directions = np.frombuffer(values).reshape(-1, 3)

    def sort(index: np.ndarray) -> list[np.ndarray]:
        if len(index) <= CLUSTER:
            return [index]
        axis = int(np.argmax(np.ptp(directions[index], axis=0)))
        half = -(-len(index) // (2 * CLUSTER)) * CLUSTER
        order = index[np.argsort(directions[index, axis], kind="stable")]
        return sort(order[:half]) + sort(order[half:])

    order = np.concatenate(sort(np.arange(len(directions))))  # all clusters but the last are full
    return np.pad(order, (0, -len(order) % CLUSTER), constant_values=-1).reshape(-1, CLUSTER)


def sun_tiles(suns: np.ndarray) -> list[np.ndarray]:
    """Indices of neighbouring suns (sun, 3), `TILE` together."""
    clusters = _clusters(suns.astype(float).tobytes())
    every = (clusters[i : i + TILE // CLUSTER] for i in range(0, len(clusters), TILE // CLUSTER))
    return [tile[tile >= 0] for tile in every]


class SunClusters(NamedTuple):
    """Neighbouring suns, `CLUSTER` together."""

    members: mi.Int32
    """Indices of the suns, shape (cluster · CLUSTER,); −1 for none."""
    axis: mi.Float
    """Mean directions, three numbers each."""
    spread: mi.Float
    """Largest angle from the axis to a sun's centre [rad]."""

    @classmethod
    def of(cls, suns: np.ndarray) -> SunClusters:
        """Clusters of unit vectors (sun, 3)."""
        clusters = _clusters(suns.astype(float).tobytes())
        members = suns[clusters]  # -1 repeats the last sun, which does no harm to the bounds
        axes = members.mean(axis=1)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        cosines = np.einsum("gsi,gi->gs", members, axes)
        spread = np.arccos(np.clip(cosines, -1, 1)).max(axis=1)
        return cls(mi.Int32(clusters.astype(np.int32).ravel()), flat(axes), flat(spread))

    def candidates(
        self, openings: Openings | None, points: mi.Float, normals: mi.Float, radius: float
    ) -> tuple[mi.UInt32, mi.UInt32]:
        """Receivers and clusters of suns of a `radius` [rad] that may see each other, in pairs."""
        count = dr.width(self.spread)
        entry = dr.arange(mi.UInt32, dr.width(points) // 3 * count)
        row, group = row_and_column(entry, count)
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        axis = dr.gather(mi.Vector3f, self.axis, group)
        # Single precision errs by far less than a thousandth of a degree.
        spread = dr.gather(mi.Float, self.spread, group) + dr.opaque(mi.Float, radius + 1e-5)
        possible = dr.dot(n, axis) > -dr.sin(spread)
        if openings is not None:
            possible &= openings.passed(row, p, axis, spread)
        chosen = dr.compress(possible)
        row, group = (dr.gather(mi.UInt32, x, chosen) for x in (row, group))
        dr.eval(row, group)
        return row, group


def hidden_in_disks(
    scene: Scene, points: mi.Float, suns: np.ndarray, diameter: float, within: Within = None
) -> mi.Bool:
    """Whether a slit may show a sun's disk without its edge, flat (point, sun).

    There is no such slit where every opening is wider than a disk's image across the room.
    `points` are positions [m], three numbers each, `within` as for `Openings.of`.
    """
    room, radius = scene.enclosure, np.radians(diameter) / 2
    if room is not None and room.narrowest < 2 * np.tan(radius) * np.linalg.norm(room.size):
        openings = Openings.of(scene, points, within) if room.is_box else Openings(room.openings)
        if openings is not None:
            entry = dr.arange(mi.UInt32, dr.width(points) // 3 * len(suns))
            row, sun = row_and_column(entry, len(suns))
            p, d = dr.gather(mi.Point3f, points, row), dr.gather(mi.Vector3f, flat(suns), sun)
            return openings.passed(row, p, d, dr.opaque(mi.Float, radius))
    return mi.Bool(False)
