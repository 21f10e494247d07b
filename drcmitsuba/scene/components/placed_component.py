"""Component in the room: its surfaces, its ports, and its hole in the ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import Port, Surface

RAY_OFFSET = 1500 * 2.0**-24
"""Distance by which Mitsuba starts rays off a surface, over 1 + the largest coordinate [m]."""
RECESS = 0.005
"""Least distance of a pane behind the mouth of a component [m]."""


@dataclass(frozen=True)
class PlacedComponent:
    """Component in its position, in the room's frame [m]."""

    name: str
    surfaces: tuple[Surface, ...]
    ports: tuple[Port, ...]
    hole: np.ndarray | None = None
    """Hole in the ceiling, shape (4,): lowest and highest x, lowest and highest y [m]."""
    is_open: bool = False
    """Whether straight light may enter by the hole."""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates of all surfaces, shape (3,) each [m]."""
        points = np.concatenate([s.quads.reshape(-1, 3) for s in self.surfaces])
        return points.min(axis=0), points.max(axis=0)


def ray_offset(points: np.ndarray) -> float:
    """Largest distance [m] by which Mitsuba moves rays off surfaces with corners (…, 3).

    The value holds for any rotation of the room. Rays would skip layers closer than this.
    """
    p = np.reshape(points, (-1, 3))
    far = max(float(np.hypot(p[:, 0], p[:, 1]).max()), float(abs(p[:, 2]).max()))
    return RAY_OFFSET * (1 + far)


def is_open(case: Case, bottom: str | None) -> bool:
    """Whether straight light leaves a component by a hole or by a pane of a clear material."""
    return bottom is None or isinstance(case.materials[bottom], GlazingMaterial)


def recess(points: np.ndarray) -> float:
    """Distance of a pane from the mouth around it [m], in doubling steps.

    So the panes of all pipes of a hall lie in few planes, in which photons look for them.
    """
    return float(RECESS * 2 ** np.ceil(np.log2(max(1.0, 4 * ray_offset(points) / RECESS))))


def check_hole(source: str, placed: PlacedComponent, size: tuple[float, float, float]) -> None:
    """Refuse a hole that is not within the ceiling."""
    if placed.hole is None:
        return
    x0, x1, y0, y1 = placed.hole
    if min(x0, y0) < 1e-3 or x1 > size[0] - 1e-3 or y1 > size[1] - 1e-3:
        got = f"its hole, {x0:.4g} to {x1:.4g} and {y0:.4g} to {y1:.4g} m, leaves the ceiling"
        remedy = f"keep it within 0 to {size[0]:g} and 0 to {size[1]:g} m"
        raise InputError(source, f"components.{placed.name}", got, remedy)
