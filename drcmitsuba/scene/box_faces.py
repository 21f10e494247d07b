"""Faces of a box room that are of one material, but for an aperture with panes and frames.

A ray from within meets such a face in closed form, which takes a fraction of the time of a search
among the triangles of walls (`transport.rays.first_hit`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.surfaces import NEAR, Enclosure


class _Bounds(NamedTuple):
    """Lowest and highest coordinates of rectangles along the axes, shape (rectangle, 3) each."""

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def on_face(cls, corners: np.ndarray, size: np.ndarray, axis: int, place: float) -> _Bounds:
        """Bounds of those quads (quad, 4, 3) that lie in a face of a box."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        inside = ((low > -NEAR) & (high < size + NEAR)).all(axis=1)
        inside &= (abs(low[:, axis] - place) < NEAR) & (abs(high[:, axis] - place) < NEAR)
        return cls(low[inside], high[inside])

    def area(self, axis: int) -> float:
        """Area of the rectangles, which lie across an axis, in sum."""
        return float(np.delete(np.maximum(self.high - self.low, 0), axis, axis=1).prod(1).sum())

    def common(self, other: _Bounds) -> _Bounds:
        """Part of each rectangle within a single one."""
        return _Bounds(np.maximum(self.low, other.low), np.minimum(self.high, other.high))


@dataclass(frozen=True)
class BoxFaces:
    """Faces of a box: of low and of high x, y and z in the room's frame."""

    parts: tuple[int, ...]
    """Index of the part of the scene that is all of a face outside of its aperture."""
    apertures: np.ndarray
    """Rectangles around all else in the faces, world frame [m], shape (aperture, 4, 3), fronts
    inward."""

    @classmethod
    def of(cls, room: Enclosure, parts: Sequence[Surface]) -> BoxFaces | None:
        """Find the faces among the parts of a scene; None where one has several materials."""
        if not parts:
            return None
        corners = [part.quads @ room.turn for part in parts]
        holes, largest_of, apertures = room.openings @ room.turn, [], []
        for axis, side in product(range(3), (0, 1)):
            face = [_Bounds.on_face(q, room.size, axis, side * room.size[axis]) for q in corners]
            largest = int(np.argmax([bounds.area(axis) for bounds in face]))
            others = [bounds for i, bounds in enumerate(face) if i != largest]
            others.append(_Bounds.on_face(holes, room.size, axis, side * room.size[axis]))
            low, high = (np.concatenate(column) for column in zip(*others, strict=True))
            main, free = face[largest].area(axis), float(np.delete(room.size, axis).prod())
            if len(low):
                aperture = _Bounds(low.min(axis=0)[None], high.max(axis=0)[None])
                main -= face[largest].common(aperture).area(axis)
                free -= aperture.area(axis)
                apertures.append(_facing_inward(aperture, axis, side))
            if not np.isclose(main, free, rtol=1e-9, atol=1e-5):
                return None
            largest_of.append(largest)
        return cls(tuple(largest_of), np.reshape(apertures, (-1, 4, 3)) @ room.turn.T)


def _facing_inward(bounds: _Bounds, axis: int, side: int) -> np.ndarray:
    """Rectangle (4, 3) across an axis of a box."""
    (low,), (high,) = bounds
    edges = np.diag(high - low)
    u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
    return quad(low, u, v) if side == 0 else quad(low, v, u)
