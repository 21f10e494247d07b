r"""Rectangular mirrored duct over the ceiling, with an anidolic entry and one bend.

From outside to inside: a straight frame with the cover, a compound parabolic concentrator [1]_, a
channel, a plane mirror at 45° that turns the light down, a shaft through the ceiling. The
concentrator, above and below, has the half angle of acceptance θ; its profile about the axis is

.. math:: r(φ) = \frac{2 f \sin(φ - θ)}{1 - \cos φ} - a, \quad
          d(φ) = L - \frac{2 f \cos(φ - θ)}{1 - \cos φ}, \quad f = a (1 + \sin θ)

with a = half the channel's height, from r = a / sin θ at the entry (φ = 2θ) to r = a at the channel
(φ = θ + 90°).

References
----------
.. [1] R. Winston, J. C. Miñano, P. Benítez, "Nonimaging Optics", Elsevier, 2005, chapter 4.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import Duct
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components.placed_component import PlacedComponent, is_open, recess
from drcmitsuba.scene.geometry import UP, Port, Surface, side_of

STEP = 1.0
"""Largest facet of the concentrator, as an angle φ [deg]."""


def concentrator(height: float, acceptance: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the entry and half heights [m] of a profile that ends at `height`."""
    theta, a = np.radians(acceptance), height / 2
    count = int(np.ceil((90 - acceptance) / STEP)) + 1
    phi = np.linspace(2 * theta, theta + np.pi / 2, count)
    f = a * (1 + np.sin(theta))
    r = 2 * f * np.sin(phi - theta) / (1 - np.cos(phi)) - a
    before = 2 * f * np.cos(phi - theta) / (1 - np.cos(phi))
    return before[0] - before, r


def _profile(source: str, where: str, table: Duct, lip: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths and half heights [m] of a duct from its mouth to its bend."""
    d, r = np.zeros(1), np.full(1, table.height / 2)
    if table.acceptance is not None:
        d, r = concentrator(table.height, table.acceptance)
    d, r = np.concatenate([[0.0], d + 2 * lip]), np.concatenate([r[:1], r])
    if table.above < 2 * lip:
        remedy = f"give at least {2 * lip:.3g} m"
        raise InputError(source, f"{where}.above", f"{table.above:g} m", remedy)
    if table.length - table.height < d[-1] + 1e-3:
        got = f"{table.length:g} m, but entry and bend take {d[-1] + table.height:.4g} m"
        raise InputError(source, f"{where}.length", got, "give a longer one")
    return np.append(d, table.length - table.height), np.append(r, table.height / 2)


def duct(case: Case, name: str, table: Duct) -> PlacedComponent:
    """Build a duct.

    Raises
    ------
    InputError
        The duct is too short for its concentrator and bend, or too close to the ceiling.
    """
    assert case.room is not None
    ceiling, h, end = case.room.size[2], table.height, table.length
    foot, along = side_of(case.room, table.side)
    along = along / np.linalg.norm(along)
    inward = np.cross(UP, along)
    left, right = table.centre - table.width / 2, table.centre + table.width / 2
    far = abs(foot) + abs(along) * max(abs(left), abs(right)) + abs(inward) * end
    lip = recess((far + UP * (ceiling + table.above + h))[None])
    d, r = _profile(case.source, f"components.{name}", table, lip)
    axis, corner = ceiling + table.above + r[0], d[-1]
    low, high = axis - r, axis + r
    under, over = axis - h / 2, axis + h / 2

    def at(s: float, depth: float, z: float) -> np.ndarray:
        return foot + along * s + inward * depth + UP * z

    def side(corners: list[tuple[float, float]]) -> list[np.ndarray]:
        """Both side walls of corners (depth, z) that begin at the entry, lower edge first."""
        first = np.array([at(left, *c) for c in corners])
        second = np.array([at(right, *c) for c in reversed(corners)])
        return [first, second]

    walls: list[np.ndarray] = []
    for i in range(len(d) - 1):
        a, b = d[i], d[i + 1]
        floor = [at(left, a, low[i]), at(right, a, low[i])]
        floor += [at(right, b, low[i + 1]), at(left, b, low[i + 1])]
        roof = [at(left, a, high[i]), at(left, b, high[i + 1])]
        roof += [at(right, b, high[i + 1]), at(right, a, high[i])]
        walls += [np.array(floor), np.array(roof)]
        walls += side([(a, low[i]), (b, low[i + 1]), (b, high[i + 1]), (a, high[i])])
    bend = [at(left, corner, over), at(left, end, under), at(right, end, under)]
    walls.append(np.array([*bend, at(right, corner, over)]))
    for wall in side([(corner, under), (end, under), (corner, over)]):
        walls.append(wall[[0, 1, 2, 2]])
    shaft = [at(left, corner, 0), at(right, corner, 0), at(right, end, 0), at(left, end, 0)]
    for p, q in zip(shaft, shaft[1:] + shaft[:1], strict=True):
        walls.append(np.array([p + UP * ceiling, p + UP * under, q + UP * under, q + UP * ceiling]))
    surfaces = [Surface(f"{name} wall", case.materials[table.mirror], np.array(walls), name)]

    def entry(depth: float) -> np.ndarray:
        return np.array([at(left, depth, low[0]), at(left, depth, high[0]),
                         at(right, depth, high[0]), at(right, depth, low[0])])  # fmt: skip

    def outlet(z: float) -> np.ndarray:  # front upward
        return np.array([p + UP * z for p in shaft])

    if table.cover is not None:
        cover = case.materials[table.cover]
        surfaces.append(Surface(f"{name} {table.cover}", cover, entry(lip)[None], name))
    if table.bottom is not None:
        pane = outlet(ceiling + lip)[[0, 3, 2, 1]]
        material = case.materials[table.bottom]
        surfaces.append(Surface(f"{name} {table.bottom}", material, pane[None], name))
    ports = Port(name, entry(0)), Port(name, outlet(ceiling))
    x, y, _ = outlet(0).T
    hole = np.array([x.min(), x.max(), y.min(), y.max()])
    return PlacedComponent(name, tuple(surfaces), ports, hole, is_open(case, table.bottom))
