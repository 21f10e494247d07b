"""Random buildings of polygons: rooms in a row, with windows, roof lights and partitions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from pydantic import TypeAdapter

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian, Material
from tests.model_rooms import case_of, layer, prism
from tests.validation.fuzz.boxes import pane

MATERIAL: TypeAdapter = TypeAdapter(Material)
"""Material of a table."""
LEAST = 0.6
"""Least width and height of a pane [m]."""


@dataclass(frozen=True)
class Row:
    """Rooms from x = 0 on, the first walls to the south."""

    ends: np.ndarray
    """Places of the walls across the row, x [m]."""
    depth: float
    height: float

    @property
    def outline(self) -> list[tuple[float, float]]:
        """Corners of the floor [m]."""
        end = self.ends[-1]
        return [(0, 0), (end, 0), (end, self.depth), (0, self.depth)]

    def window(self, rng: np.random.Generator, left: float, right: float, y: float) -> np.ndarray:
        """Window in the wall at y = 0 or y = depth, its front outward, shape (4, 3) [m]."""
        (x0, x1), (z0, z1) = between(rng, left, right), between(rng, 0, self.height)
        corners = np.array([[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]])
        return corners if y == 0 else corners[::-1]

    def roof_light(self, rng: np.random.Generator, left: float, right: float) -> np.ndarray:
        """Roof light of a room, shape (4, 3) [m]."""
        (x0, x1), (y0, y1), z = between(rng, left, right), between(rng, 0, self.depth), self.height
        return np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])

    def partition(self, x: float) -> np.ndarray:
        """Whole wall across the row, shape (4, 3) [m]."""
        z, y = self.height, self.depth
        return np.array([[x, 0, 0], [x, 0, z], [x, y, z], [x, y, 0]])

    def hole(self, rng: np.random.Generator, x: float) -> np.ndarray:
        """Part of a wall across the row, shape (4, 3) [m]."""
        (y0, y1), (z0, z1) = between(rng, 0, self.depth), between(rng, 0, self.height)
        return np.array([[x, y0, z0], [x, y0, z1], [x, y1, z1], [x, y1, z0]])


def random_building(rng: np.random.Generator) -> Case:
    """Rooms in a row with panes of two materials, at any place, turned by any angle about z."""
    widths = rng.uniform(2.5, 5, rng.integers(1, 4))
    row = Row(np.concatenate([[0.0], np.cumsum(widths)]), rng.uniform(3, 7), rng.uniform(2.4, 4))
    (floor_rho, ceiling_rho, wall_rho, rho), placed = rng.uniform(0.05, 0.85, 4), placing(rng)
    low, high, walls = prism(row.outline, row.height)
    windows: dict[int, list[np.ndarray]] = {0: [], 1: [], 2: [], 3: []}
    lights: list[np.ndarray] = []
    for left, right in pairwise(row.ends):
        if rng.random() < 0.8 or not windows[0]:
            windows[0].append(row.window(rng, left, right, 0.0))
        if rng.random() < 0.4:
            windows[2].append(row.window(rng, left, right, row.depth))
        if rng.random() < 0.3:
            lights.append(row.roof_light(rng, left, right))
    layers = [
        layer("floor", Lambertian(floor_rho), placed(low)),
        layer("ceiling", Lambertian(ceiling_rho), placed(high), holes=placed(lights)),
    ]
    for number, wall in enumerate(walls):
        holes = placed(windows[number])
        layers.append(layer(f"wall {number}", Lambertian(wall_rho), placed(wall), holes=holes))
    panes = [*windows[0], *windows[2], *lights]
    for x in row.ends[1:-1]:
        kind, hole = rng.choice(["opaque", "glass", "door"]), row.hole(rng, x)
        holes = [] if kind == "opaque" else [placed(hole)]
        wall = placed(row.partition(x))
        layers.append(layer(f"partition at {x:.1f} m", Lambertian(rho), wall, holes=holes))
        panes += [hole] if kind == "glass" else []
    tables = rng.permutation([pane(rng), pane(rng, {"glazing": 0.7, "diffuser": 0.3})])
    of_pane = rng.integers(2, size=len(panes))
    for number in np.unique(of_pane):
        its = [placed(panes[i]) for i in np.flatnonzero(of_pane == number)]
        layers.append(layer(f"pane {number}", MATERIAL.validate_python(tables[number]), *its))
    if rng.random() < 0.5:
        layers.append(layer("body", Lambertian(rho), *placed(body(rng, row))))
    sensors = {
        "floors": ["floor"], "spacing": round(row.depth / 4, 2), "margin": 0.3,
        "height": round(rng.uniform(0.1, 1.2), 2),
    }  # fmt: skip
    return case_of(*layers, sensors=sensors)


def placing(rng: np.random.Generator):
    """Function that turns polygons about z by any angle, and moves them."""
    angle, away = np.radians(rng.choice([0.0, 90.0, rng.uniform(0, 360)])), rng.uniform(-30, 30, 3)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return lambda polygons: np.asarray(polygons, float) @ turned + away if len(polygons) else []


def body(rng: np.random.Generator, row: Row) -> list[np.ndarray]:
    """Faces of a box that stands in the first room, fronts outward."""
    (x0, x1), (y0, y1) = between(rng, 0, row.ends[1]), between(rng, 0, row.depth)
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    bottom, top, sides = prism(outline, rng.uniform(0.3, 1.5))
    return [np.array(face, float)[::-1] for face in (bottom, top, *sides)]  # from fronts inward


def between(rng: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    """Ends of a random interval, 0.1 m within two others [m]."""
    length = rng.uniform(LEAST, high - low - 0.2)
    start = rng.uniform(low + 0.1, high - 0.1 - length)
    return start, start + length
