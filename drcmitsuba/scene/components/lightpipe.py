"""Straight mirrored pipe through the ceiling.

A round pipe has a square frame with a pane at either end, so the hole in the ceiling, the panes and
the ports are squares.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import LightPipe
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components.placed_component import PlacedComponent, is_open, recess
from drcmitsuba.scene.geometry import UP, Port, Surface, quad

BLACK = Lambertian(0.0)


def polygon(centre: tuple[float, float], width: float, sides: int) -> np.ndarray:
    """Corners (side, 2) of a regular polygon around a circle of `width`, counter-clockwise.

    One side faces each of east, north, west and south.
    """
    angle = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    radius = width / 2 / np.cos(np.pi / sides)
    return np.array(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def ring(corners: np.ndarray, z: float) -> np.ndarray:
    """Triangles, as quads (n, 4, 3), between a polygon and its bounding square; front upward."""
    sides = len(corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    square = np.array([high, [low[0], high[1]], low, [high[0], low[1]]])
    triangles = []
    for quarter, corner in enumerate(square):
        for i in range(sides // 4 - 1):  # the sides that face the four winds lie on the square
            a, b = corners[quarter * sides // 4 + i], corners[quarter * sides // 4 + i + 1]
            triangles.append([corner, b, a, a])
    return np.dstack([np.reshape(triangles, (-1, 4, 2)), np.full((len(triangles), 4), z)])


def tube(corners: np.ndarray, low: float, high: float) -> np.ndarray:
    """Walls (side, 4, 3) over a counter-clockwise polygon, fronts inward."""
    p = np.column_stack([corners, np.full(len(corners), low)])
    along = np.roll(p, -1, axis=0) - p
    return np.array([quad(a, UP * (high - low), d) for a, d in zip(p, along, strict=True)])


def lightpipe(case: Case, name: str, pipe: LightPipe) -> PlacedComponent:
    """Build a pipe.

    Raises
    ------
    InputError
        The pipe is too low for its panes.
    """
    assert case.room is not None
    foot = case.room.size[2]
    head = foot + pipe.height
    x, y = pipe.centre
    r = pipe.width / 2
    lip = recess(np.array([[abs(x) + r, abs(y) + r, head]]))
    if pipe.height < 8 * lip:
        got, remedy = f"{pipe.height:g} m", f"give at least {8 * lip:.3g} m"
        raise InputError(case.source, f"components.{name}.height", got, remedy)
    hole = np.array([x - r, x + r, y - r, y + r])
    square = np.array([[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]])
    mirror = case.materials[pipe.mirror]
    surfaces = []
    if pipe.sides == 4:
        surfaces.append(Surface(f"{name} wall", mirror, tube(square, foot, head), name))
    else:
        corners = polygon(pipe.centre, pipe.width, pipe.sides)
        walls = (
            tube(square, foot, foot + 2 * lip),
            tube(corners, foot + 2 * lip, head - 2 * lip),
            tube(square, head - 2 * lip, head),
        )
        lower = ring(corners, foot + 2 * lip)[:, [0, 2, 1, 1]]
        ceiling = Lambertian(case.room.ceiling)
        surfaces += [
            Surface(f"{name} wall", mirror, np.concatenate(walls), name),
            Surface(f"{name} ring", ceiling, lower, name),
            Surface(f"{name} rim", BLACK, ring(corners, head - 2 * lip), name),
        ]

    def across(z: float) -> np.ndarray:
        return quad([x - r, y - r, z], [0, 2 * r, 0], [2 * r, 0, 0])  # front downward

    for key, z in ((pipe.top, head - lip), (pipe.bottom, foot + lip)):
        if key is not None:
            surfaces.append(Surface(f"{name} {key}", case.materials[key], across(z)[None], name))
    ports = Port(name, across(head)), Port(name, across(foot)[[0, 3, 2, 1]])
    return PlacedComponent(name, tuple(surfaces), ports, hole, is_open(case, pipe.bottom))
