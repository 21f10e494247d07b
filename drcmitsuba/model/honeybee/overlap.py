"""Two faces that touch: where both are, and where only one is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.model.plane import Plane
from drcmitsuba.model.polygon import area_vector

Rings = tuple[np.ndarray, ...]
"""Corners of an outline, then of each hole, shape (corner, 3) each."""


@dataclass(frozen=True)
class Overlap:
    """Parts of two touching faces, in the units of the file."""

    both: tuple[Rings, ...]
    """Where both are; fronts face the first face's room."""
    first: tuple[Rings, ...] = ()
    """Where only the first one is."""
    second: tuple[Rings, ...] = ()
    """Where only the second one is."""

    @classmethod
    def of(cls, first: Rings, second: Rings, tolerance: float) -> Overlap:
        """Cut two faces, the front of each away from its room, into their common and other parts.

        Faces whose outlines agree within the tolerance are one; those that lie further apart than
        it have nothing in common.
        """
        inward = (first[0][::-1], *first[1:])
        if not _has_area(inward[0]) or not _has_area(second[0]):
            return cls((inward,))
        plane = Plane.of(inward[0])
        if plane.distance(second[0]) > tolerance:
            return cls((), (inward,), (second,))
        one, other = plane.polygon(inward[:1]), plane.polygon(second[:1])
        if not (one.is_valid and other.is_valid):
            return cls((inward,))
        edge = tolerance * max(one.length, other.length)
        if one.symmetric_difference(other).area <= edge:
            return cls((inward,))
        holes = [plane.polygon([hole]) for hole in (*first[1:], *second[1:])]
        if not all(hole.is_valid for hole in holes):
            return cls((inward,))
        parts = [one & other, one - other, other - one]
        for hole in holes:
            parts = [part - hole for part in parts]
        least = tolerance**2
        return cls(*(tuple(plane.rings(part, least)) for part in parts))


def _has_area(ring: np.ndarray) -> bool:
    return len(ring) > 2 and bool(np.linalg.norm(area_vector(ring)) > 0)
