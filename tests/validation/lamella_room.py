"""A small room with ten mirror lamellae in its window, made by hand: what both programs are given.

4 × 4 × 3 m; the window, 1 × 1 m, is in the middle of the south wall from 1.5 m up. Outside of it
stands a box 0.15 m deep, closed by a pane, and in it the lamellae, 0.1 m deep at a spacing of 0.1 m
and inclined towards the sky, which throw the sun to the ceiling.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.model.materials import GlazingMaterial, Lambertian, MirrorMaterial
from drcmitsuba.scene.geometry import Port, Surface

SIZE = np.array([4.0, 4.0, 3.0])
LEFT, RIGHT, BOTTOM, TOP, DEPTH = 1.5, 2.5, 1.5, 2.5, 0.15
TRANSMISSIVITY = 0.96
"""Radiance's `glass` has it; `radiance.with_glass` gives ours its tables."""
GLASS = GlazingMaterial(type="glazing", transmittance=0.88)
MIRROR = MirrorMaterial(type="mirror", reflectance=0.9)
COMPONENT = "lamellae"


def rectangle(corner: tuple, u: tuple, v: tuple) -> np.ndarray:
    """Rectangle (4, 3) with its front in the direction u × v."""
    c, u_, v_ = (np.array(x, float) for x in (corner, u, v))
    return np.array([c, c + u_, c + u_ + v_, c + v_])


def shell(floor: float = 0.2, ceiling: float = 0.8, walls: float = 0.5) -> list[Surface]:
    """The room with its hole, fronts inward."""
    w, d, h = SIZE
    south = [(0, w, 0, BOTTOM), (0, w, TOP, h), (0, LEFT, BOTTOM, TOP), (RIGHT, w, BOTTOM, TOP)]
    sides = [rectangle((a, 0, low), (0, 0, high - low), (b - a, 0, 0)) for a, b, low, high in south]
    sides += [
        rectangle((0, d, 0), (w, 0, 0), (0, 0, h)),
        rectangle((0, 0, 0), (0, d, 0), (0, 0, h)),
        rectangle((w, 0, 0), (0, 0, h), (0, d, 0)),
    ]
    return [
        Surface("floor", Lambertian(floor), rectangle((0, 0, 0), (w, 0, 0), (0, d, 0))[None]),
        Surface("ceiling", Lambertian(ceiling), rectangle((0, 0, h), (0, d, 0), (w, 0, 0))[None]),
        Surface("walls", Lambertian(walls), np.array(sides)),
    ]


def casing(reflectance: float = 0.3) -> Surface:
    """The four sides of the box outside the window, fronts into it."""
    across, up, y = RIGHT - LEFT, TOP - BOTTOM, -DEPTH
    quads = [
        rectangle((LEFT, y, BOTTOM), (across, 0, 0), (0, DEPTH, 0)),
        rectangle((LEFT, y, TOP), (0, DEPTH, 0), (across, 0, 0)),
        rectangle((LEFT, y, BOTTOM), (0, DEPTH, 0), (0, 0, up)),
        rectangle((RIGHT, y, BOTTOM), (0, 0, up), (0, DEPTH, 0)),
    ]
    return Surface("casing", Lambertian(reflectance), np.array(quads), COMPONENT)


def outer() -> np.ndarray:
    """The front of the box, facing inward."""
    return rectangle((LEFT, -DEPTH, BOTTOM), (0, 0, TOP - BOTTOM), (RIGHT - LEFT, 0, 0))


def pane() -> Surface:
    return Surface("pane", GLASS, outer()[None])


def lamellae(
    count: int = 10, tilt: float = 30.0, mirror: MirrorMaterial = MIRROR, bend: float = 0.0,
    pieces: int = 1,
) -> Surface:  # fmt: skip
    """Mirrors from side to side.

    Parameters
    ----------
    count : int
    tilt : float
        Of their chords to the horizontal [°]; the inner edge is the higher one.
    mirror : MirrorMaterial
    bend : float
        Angle between the tangents at their edges [°]; hollow towards the sky.
    pieces : int
        Flat ones that an arc is made of.
    """
    chord, spacing = 0.1, (TOP - BOTTOM) / count
    half = np.radians(bend / 2)
    angles = np.linspace(-half, half, pieces + 1)
    if bend == 0:
        s, sag = np.linspace(-0.5, 0.5, pieces + 1) * chord, np.zeros(pieces + 1)
    else:
        radius = chord / 2 / np.sin(half)
        s, sag = radius * np.sin(angles), radius * (np.cos(half) - np.cos(angles))
    t = np.radians(tilt)
    y = -DEPTH / 2 + s * np.cos(t) - sag * np.sin(t)
    z = s * np.sin(t) + sag * np.cos(t)
    quads = []
    for i in range(count):
        middle = BOTTOM + (i + 0.5) * spacing
        for k in range(pieces):
            edge = (0, y[k + 1] - y[k], z[k + 1] - z[k])
            quads.append(rectangle((LEFT, y[k], middle + z[k]), (RIGHT - LEFT, 0, 0), edge))
    return Surface("lamellae", mirror, np.array(quads), COMPONENT)


def port(margin: float = 1e-3) -> Port:
    """Just outside of the pane and a little larger: photons have to pass the pane."""
    low, high = LEFT - margin, RIGHT + margin
    corner = (low, -DEPTH - margin, BOTTOM - margin)
    up = TOP - BOTTOM + 2 * margin
    return Port(COMPONENT, rectangle(corner, (0, 0, up), (high - low, 0, 0)))


def receiver(height: float = 0.8) -> np.ndarray:
    """Horizontal rectangle (1, 4, 3) through the room, front up."""
    m = 1e-3
    w, d, _ = SIZE - 2 * m
    return rectangle((m, m, height), (w, 0, 0), (0, d, 0))[None]


def sensors(count: int = 8, height: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    """A grid of count × count points that look up, half a spacing from the walls."""
    x = (np.arange(count) + 0.5) * SIZE[0] / count
    flat = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack([flat, np.full(len(flat), height)])
    return points, np.tile([0.0, 0.0, 1.0], (len(points), 1))


def suns(count: int = 8, lowest: float = 15.0) -> np.ndarray:
    """Directions (sun, 3) to suns before the window, spread in altitude and azimuth.

    From 31° up no sun comes straight between lamellae inclined by 30°.
    """
    k = np.arange(count)
    altitude = np.radians(lowest + (65 - lowest) * (k + 0.5) / count)
    azimuth = np.radians(130 + (k * 0.618034 % 1) * 100)
    flat = np.cos(altitude)
    return np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(altitude)], axis=-1)
