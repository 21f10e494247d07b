"""Façades as rectangles: where the fill of a wall may change, and what stands there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drcmitsuba.case.facade import Facade
from drcmitsuba.scene.fills import HOLE, WALL

FRAME = "(frame)"
"""Fill of a rectangle: the opaque frame around panes."""


def rectangles_of(
    facades: Sequence[Facade], length: float, height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rectangles of a wall, along the edges of all of several façades, and their fills.

    Returns
    -------
    rectangles : np.ndarray, shape (rectangle, 4)
        Left, right, bottom and top from the foot of the wall [m].
    names : np.ndarray of str, shape (rectangle, façade)
        As from `fill_at`.
    """
    edges = [edges_of(facade, length) for facade in facades]
    x = cut(set().union(*(e[0] for e in edges)), length)
    z = cut(set().union(*(e[1] for e in edges)), height)
    rectangles = between(x, z)
    centre = rectangles[:, :2].mean(axis=1), rectangles[:, 2:].mean(axis=1)
    names = np.stack([fill_at(f, length, *centre) for f in facades], axis=1).astype(str)
    return rectangles, names


def between(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Rectangles between the edges x and z, shape (rectangle, 4), row by row from below."""
    left, bottom = (a.ravel() for a in np.meshgrid(x[:-1], z[:-1]))
    right, top = (a.ravel() for a in np.meshgrid(x[1:], z[1:]))
    return np.stack([left, right, bottom, top], axis=1)


def fill_at(facade: Facade, length: float, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Name the fill of a façade at points.

    Parameters
    ----------
    length : float
        Length of the wall [m].
    x, z : np.ndarray, shape (point,)
        Position along the wall from its foot, and height [m].

    Returns
    -------
    np.ndarray of str, shape (point,)
        Names of materials, `HOLE`, `WALL` or `FRAME`.
    """
    names = np.full(len(x), WALL, dtype=object)
    width, half = length / facade.segments, facade.frame / 2
    segment = np.clip((x / width).astype(int), 0, facade.segments - 1)
    across = x - segment * width
    for strip in facade.strips:
        inside = (z > strip.bottom) & (z < strip.top)
        if strip.segments is not None:
            inside &= np.isin(segment, strip.segments)
        names[inside] = HOLE if strip.material == "open" else strip.material
        if half > 0 and strip.material != WALL:
            pane = (z > strip.bottom + half) & (z < strip.top - half)
            pane &= (across > half) & (across < width - half)
            names[inside & ~pane] = FRAME
    return names


def cut(edges: set[float], most: float) -> np.ndarray:
    """Sorted edges from 0 to `most`; edges closer than 10 µm are merged."""
    every = np.array(sorted({0.0, most, *(e for e in edges if 0 < e < most)}))
    return every[np.r_[True, np.diff(every) > 1e-5]]


def edges_of(facade: Facade, length: float) -> tuple[set[float], set[float]]:
    """Edges along and up a façade where its fill may change [m]."""
    half = facade.frame / 2
    borders = np.arange(facade.segments + 1) * length / facade.segments
    ends = [end for strip in facade.strips for end in (strip.bottom, strip.top)]
    x, z = ({float(e + s) for e in at for s in (-half, 0, half)} for at in (borders, ends))
    return x, z
