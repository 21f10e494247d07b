"""A plane of the model, in which shapes are cut by shapely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from drcmitsuba.model.polygon import area_vector, axes_across

Rings = tuple[np.ndarray, ...]
"""Corners of a polygon's outline, then of its holes, shape (corner, 3) each [m]."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Plane with two axes; (u, v, normal) is right-handed."""

    corner: np.ndarray
    """Point of the plane, shape (3,)."""
    u: np.ndarray
    v: np.ndarray
    normal: np.ndarray

    @classmethod
    def of(cls, ring: np.ndarray) -> Plane:
        """Plane of a polygon (corner, 3) that has an area; its front is the plane's."""
        normal = area_vector(ring)
        normal = normal / np.linalg.norm(normal)
        return cls(ring[0], *axes_across(normal), normal)

    def points(self, uv: np.ndarray) -> np.ndarray:
        """Points (…, 3) at places (…, 2) in the plane [m]."""
        at: np.ndarray = self.corner + uv[..., :1] * self.u + uv[..., 1:] * self.v
        return at

    def distance(self, points: np.ndarray) -> float:
        """Largest distance of points (point, 3) from the plane."""
        return float(np.abs((points - self.corner) @ self.normal).max())

    def polygon(self, rings: Sequence[np.ndarray]) -> Any:
        """Polygon of an outline and holes (corner, 3), as shapely's geometry."""
        flat = [
            np.stack([(r - self.corner) @ self.u, (r - self.corner) @ self.v], 1) for r in rings
        ]
        return shapely.Polygon(flat[0], flat[1:])

    def shape(self, rings: Sequence[np.ndarray]) -> Any:
        """Such a polygon made valid: holes end at its outline, which may not cross itself."""
        return shapely.make_valid(self.polygon(rings))

    def rings(self, shape: Any, least: float = 0.0) -> list[Rings]:
        """Outline and holes (corner, 3) of each polygon of a shape with more than the least area.

        Outlines are counter-clockwise from the front.
        """
        out = []
        for part in shapely.get_parts(shape):
            if part.geom_type == "Polygon" and part.area > least:
                part = shapely.geometry.polygon.orient(part)
                flat = (np.array(ring.coords)[:-1] for ring in (part.exterior, *part.interiors))
                out.append(tuple(map(self.points, flat)))
        return out
