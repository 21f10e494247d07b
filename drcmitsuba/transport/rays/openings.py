"""Openings of a room, and which directions from which points may leave it by them.

A box tells which points lie in it. Of a room of any shape the sensors are told by rays: none leaves
it where its panes count as walls. What paths from there meet before they pass a pane is in it, too.
In a building each point asks the openings of its own room.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import (
    flat,
    flat_indices,
    repeated,
    row_and_column,
    vectors_of,
)
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.scene import Scene
from drcmitsuba.scene.surfaces import Enclosure

SLACK = 1e-3
"""Width by which openings count as larger on all sides, in doubt [m]."""
MOST = 24
"""Largest number of openings that are tested one by one for each ray; where there are more, as in a
building of many rooms, it costs less to trace all rays."""
RAYS = 256
"""Number of rays by which a point is found to lie in a room of a model."""


Within: TypeAlias = "mi.UInt32 | bool | None"
"""Room within which receivers lie: whether all of them in that of a box; of each one the number of
its room in a model, from 1 on, and 0 outside; None where nobody knows. Looking it up on the device
waits for all that is being computed."""


Opening: TypeAlias = "int | mi.UInt32"
"""Index of an opening: one for all points, or one for each."""
_UNTOLD = 0xFFFFFFFF
"""Number of openings of a room whose openings tell nothing."""


def has_shapeless_rooms(scene: Scene) -> bool:
    """Whether only paths tell which points lie in the rooms of a scene."""
    room = scene.enclosure
    return room is not None and room.spares and not room.is_box


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
    """Room of points (point, 3); in a model `in_rooms` (point,) gives its number, or whether."""
    if in_rooms is not None:
        return flat_indices(in_rooms)
    room = scene.enclosure
    return room.contains(points) if room is not None and room.is_box else None


def repeated_within(within: Within, times: int) -> Within:
    """Repeat what is known of receivers that stand several times one after another."""
    return within if within is None or isinstance(within, bool) else repeated(within, times)


def within_at(within: Within, row: mi.UInt32) -> Within:
    """Choose what is known of some of the receivers."""
    known = within is not None and not isinstance(within, bool)
    return dr.gather(mi.UInt32, within, row) if known else within


def _is_closed_in(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Whether all rays from each point meet a surface, shape (point,)."""
    lane = dr.arange(mi.UInt32, len(points) * RAYS)
    p = dr.gather(mi.Point3f, flat(points), lane // RAYS)
    d = mi.warp.square_to_uniform_sphere(even_numbers(lane % RAYS, lane // RAYS, 6, 0))
    hit = scene.full.ray_test(mi.Ray3f(p, d), coherent=False)
    return np.asarray(hit.numpy().reshape(-1, RAYS).all(axis=1))


class Cone(NamedTuple):
    """Cones of directions as an opening sees them, each about an axis."""

    along: mi.Float
    up: mi.Float
    """Distances that the axis moves along both sides per distance from the opening's plane [–]."""
    wider: mi.Float
    """Distance by which a cone reaches beyond its axis per distance from the plane [–]; 0 for rays,
    without meaning where the cone grazes."""
    faces: mi.Bool
    """Whether the axis leads out of the room; without meaning where the cone grazes."""
    grazes: mi.Bool
    """Whether the cone touches the opening's plane, almost."""

    def packed(self) -> mi.Float:
        """Four numbers for each cone, one after another."""
        kind = dr.select(self.grazes, 2, dr.select(self.faces, mi.Float(1), 0))
        numbers = dr.ravel(mi.Vector4f(self.along, self.up, self.wider, kind))
        dr.eval(numbers)
        return numbers

    @classmethod
    def unpacked(cls, numbers: mi.Float, index: mi.UInt32) -> Cone:
        """Chosen cones of those that have been packed."""
        along, up, wider, kind = dr.gather(mi.Vector4f, numbers, index)
        return cls(along, up, wider, kind > 0.5, kind > 1.5)


@dataclass(frozen=True)
class Openings:
    """Openings of rooms: rectangles (opening, 4, 3), fronts inward [m].

    Rays that miss all openings of their room are not traced: they would meet a wall.
    """

    quads: np.ndarray
    within: mi.UInt32 | None = None
    """Room within which each point lies, 0 outside; None where all lie in the same one."""
    occluders: mi.Scene | None = None
    """All that may hide what is seen by the openings, see `Scene.occluders`; None where walls may,
    too: openings then count as larger by `SLACK`."""
    counts: tuple[int, ...] | None = None
    """Number of openings of every room, which follow one another, from that of number 0 on; None
    where all rooms have all openings. Where a room has −1 of them, all rays are traced."""

    @classmethod
    def of(cls, scene: Scene, points: mi.Float, within: Within = None) -> Openings | None:
        """Openings that points look through; None where all of them may lie outside the room.

        In the rooms of a model are the points of which `within` says so.
        """
        room = scene.enclosure
        if room is None or not room.spares:
            return None
        if not room.is_box:
            if within is None or isinstance(within, bool):
                return None
            if room.exits_by_room is not None:
                return cls._of_rooms(room.exits_by_room, within)
            if room.exits is None or len(room.exits) > MOST:
                return None
            return cls(room.exits, within)
        if within is None:
            within = room.contains(points.numpy().reshape(-1, 3))
        return cls(room.openings, occluders=scene.occluders) if within else None

    @classmethod
    def _of_rooms(cls, exits: tuple[np.ndarray, ...], within: mi.UInt32) -> Openings:
        """Openings of several rooms, by the number of each from 1 on."""
        few = [len(own) <= MOST for own in exits]
        counts = [len(own) if fit else -1 for own, fit in zip(exits, few, strict=True)]
        kept = [own for own, fit in zip(exits, few, strict=True) if fit]
        return cls(np.concatenate([np.zeros((0, 4, 3)), *kept]), within, counts=(-1, *counts))

    @property
    def are_none(self) -> bool:
        """Whether no point can look out of its room."""
        if len(self.quads):
            return False
        every = dr.arange(mi.UInt32, 0 if self.within is None else dr.width(self.within))
        return self.within is None or not bool(dr.any(self.are_elsewhere(every)))

    def passed(
        self, row: mi.UInt32, p: mi.Point3f, d: mi.Vector3f, spread: mi.Float | float = 0.0
    ) -> mi.Bool:
        """Whether cones of directions about d from p, the points `row`, may leave the room.

        A ray at angle δ ≤ `spread` [rad] to an axis of incidence θ meets the wall, at distance h,
        within h sin δ / (cos θ cos(θ + δ)) of the point where the axis meets it. In doubt yes.
        """
        if self.within is None:
            return self._passed_any(row, p, d, spread)
        return _passed_any(self, row, p, d, mi.Float(spread), self.are_elsewhere(row))

    def _passed_any(
        self, row: mi.UInt32, p: mi.Point3f, d: mi.Vector3f, spread: mi.Float | float
    ) -> mi.Bool:
        """Whether cones may leave a room by any of its openings, as `passed`."""
        result = mi.Bool(False)
        for opening, there in self.of_points(row):
            result |= there & self.passed_one(opening, p, d, spread)
        return result

    def are_elsewhere(self, row: mi.UInt32) -> mi.Bool:
        """Whether the points `row` lie outside all rooms, where openings tell nothing."""
        if self.within is None:
            return mi.Bool(False)
        room = dr.gather(mi.UInt32, self.within, row)
        if self.counts is None:
            return room == 0
        return dr.gather(mi.UInt32, _ends(self.counts, str(mi.variant()))[1], room) == _UNTOLD

    def of_points(self, row: mi.UInt32) -> list[tuple[Opening, mi.Bool]]:
        """Openings that the points `row` look through, each with whether there is one."""
        if self.counts is None:
            return [(i, mi.Bool(True)) for i in range(len(self.quads))]
        room = dr.gather(mi.UInt32, self.within, row)
        first, count = (
            dr.gather(mi.UInt32, x, room) for x in _ends(self.counts, str(mi.variant()))
        )
        count = dr.select(count == _UNTOLD, 0, count)
        most = max(self.counts)
        return [(dr.select(k < count, first + k, 0), k < count) for k in range(most)]

    def passed_one(
        self, opening: Opening, p: mi.Point3f, d: mi.Vector3f, spread: mi.Float | float = 0.0
    ) -> mi.Bool:
        """Whether cones of directions from p may leave the room by one opening, as `passed`."""
        return self.passed_by(opening, p, self.cone(opening, d, spread))

    def cone(self, opening: Opening, d: mi.Vector3f, spread: mi.Float | float = 0.0) -> Cone:
        """Cones of directions about d as an opening sees them, for `passed_by`."""
        s, c = dr.sincos(mi.Float(spread))
        _, n, *sides, _ = self.axes(opening)
        cosine = -dr.dot(d, n)
        outermost = cosine * c - dr.safe_sqrt(1 - cosine * cosine) * s
        wider = dr.select(s > 0, s / (cosine * outermost), 0)
        grazes = (s > 0) & (outermost < 0.01) & (cosine > -s)
        far = 1 / cosine  # one division for both sides
        along, up = (far * dr.dot(d, side) for side in sides)
        return Cone(along, up, wider, cosine > 0, grazes)

    def passed_by(self, opening: Opening, p: mi.Point3f, cone: Cone) -> mi.Bool:
        """Whether cones from p, as this opening sees them, may leave the room by it."""
        corner, n, *sides, length = self.axes(opening)
        height = dr.dot(p - corner, n)
        slack = SLACK if self.occluders is None else 0
        margin = dr.select(cone.wider > 0, height * cone.wider + SLACK, slack)
        inside = (height > -1e-3) & cone.faces
        for side, most, slope in zip(sides, length.xy, (cone.along, cone.up), strict=True):
            place = dr.dot(p - corner, side) + height * slope
            inside &= (place > -margin) & (place < most + margin)
        return inside | cone.grazes

    def axes(self, opening: Opening) -> tuple[mi.Vector3f, ...]:
        """Corner, normal, both directions, and their lengths twice, of an opening."""
        own = self.quads.astype(float).tobytes(), str(mi.variant())
        if isinstance(opening, int):
            return _axes(*own)[opening]
        table = _table(*own)
        return tuple(dr.gather(mi.Vector3f, table, 5 * opening + k) for k in range(5))


@symbolic
def _passed_any(
    openings: Openings, row: mi.UInt32, p: mi.Point3f, d: mi.Vector3f, spread: mi.Float,
    passed: mi.Bool,
) -> mi.Bool:  # fmt: skip
    """`Openings.passed` of points that are not `passed` anyway: many others cost no test."""
    if dr.hint(~passed, exclude=[openings]):
        passed = openings._passed_any(row, p, d, spread)
    return passed


@lru_cache(maxsize=16)  # every launch in a room asks for the same openings
def _axes(corners: bytes, variant: str) -> list[tuple[mi.Vector3f, ...]]:
    """Values of `Openings.axes` for openings by their corners in double precision, one of each.

    A kernel reads them: as literals they would have it compiled anew for every room.
    """
    return [vectors_of(rows) for rows in _numbers(corners)]


@lru_cache(maxsize=4)
def _table(corners: bytes, variant: str) -> mi.Float:
    """Values of `Openings.axes` for openings by their corners, five vectors each."""
    return flat(_numbers(corners))


@lru_cache(maxsize=4)
def _ends(counts: tuple[int, ...], variant: str) -> tuple[mi.UInt32, mi.UInt32]:
    """First opening of every room and the number of its openings; `_UNTOLD` for −1 of them."""
    number = np.array(counts)
    own = np.maximum(number, 0)
    return flat_indices(np.cumsum(own) - own), flat_indices(np.where(number < 0, _UNTOLD, number))


def _numbers(corners: bytes) -> np.ndarray:
    """Values of `Openings.axes`, shape (opening, 5, 3)."""
    quads = np.frombuffer(corners).reshape(-1, 4, 3)
    u, v = (quads[:, k] - quads[:, 0] for k in (1, 3))
    along, up = (np.linalg.norm(edge, axis=1, keepdims=True) for edge in (u, v))
    lengths = np.concatenate([along, up, up], axis=1)
    return np.stack([quads[:, 0], normals(quads), u / along, v / up, lengths], axis=1)


def hidden_in_disks(
    scene: Scene, points: mi.Float, suns: np.ndarray, diameter: float, within: Within = None
) -> mi.Bool:
    """Whether a slit may show a sun's disk without its edge, flat (point, sun).

    There is no such slit where every opening is wider than a disk's image across the room.
    `points` are positions [m], three numbers each, `within` as for `Openings.of`.
    """
    room, radius = scene.enclosure, np.radians(diameter) / 2
    if room is None or room.narrowest >= 2 * np.tan(radius) * _sight(room, points, within):
        return mi.Bool(False)
    by_room = room.exits_by_room is not None
    is_told = room.is_box or by_room
    openings = Openings.of(scene, points, within) if is_told else Openings(room.openings)
    if openings is None:
        return mi.Bool(False)
    entry = dr.arange(mi.UInt32, dr.width(points) // 3 * len(suns))
    row, sun = row_and_column(entry, len(suns))
    p, d = dr.gather(mi.Point3f, points, row), dr.gather(mi.Vector3f, flat(suns), sun)
    passed = openings.passed(row, p, d, dr.opaque(mi.Float, radius))
    return passed & ~openings.are_elsewhere(row) if by_room else passed


def _sight(room: Enclosure, points: mi.Float, within: Within) -> float:
    """Largest distance across a room in which points lie [m], or across all rooms."""
    if room.exits_by_room is None or within is None or isinstance(within, bool):
        return float(np.linalg.norm(room.size))
    p, number = points.numpy().reshape(-1, 3), within.numpy()
    each = (
        np.concatenate([p[number == i], own.reshape(-1, 3)])
        for i, own in enumerate(room.exits_by_room, 1)
    )
    return max((float(np.linalg.norm(np.ptp(box, axis=0))) for box in each if len(box)), default=0)
