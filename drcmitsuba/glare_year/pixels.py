"""Pixels round an eye: cells of equal solid angle over the sphere, merged where one would do.

A hemisphere is the image of a square in which areas and solid angles are proportional (Shirley and
Chiu's concentric map). Each of its `SIDE`² cells is a *tile*; a tile has `FINER`² rays. Rays that
leave the room, or meet a film, are pixels of their own: the sky, and the glow of a film, change
from ray to ray. Rays of a tile that meet the same surface are one pixel, which stands at the one
nearest to their middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SIDE = 36
"""Tiles along the square of a hemisphere: 4.8e-3 sr each, 4° across."""
FINER = 4
"""Rays along a tile: 3.0e-4 sr each, 1° across."""
ASKEW = 0.1234567
"""Angle by which the square is turned [rad]: along its diagonals rays would meet the corner of a
square room in all heights, where some pass between two walls."""


@dataclass(frozen=True, eq=False)
class EyeRays:
    """Rays from an eye, tile by tile."""

    directions: np.ndarray
    """Unit vectors, shape (ray, 3)."""
    tile: np.ndarray
    """Tile of every ray, int, shape (ray,)."""
    solid_angle: float
    """Solid angle of each ray [sr]."""


def rays(forward: np.ndarray) -> EyeRays:
    """Rays over all that some lines of sight have in front of them.

    Parameters
    ----------
    forward : np.ndarray, shape (view, 3)
        Unit vectors along the lines of sight.
    """
    n = SIDE * FINER
    i = (np.arange(n) + 0.5) / n
    u, v = (grid.ravel() for grid in np.meshgrid(i, i, indexing="ij"))
    up = _concentric(u, v)
    column, row = (np.minimum((x * SIDE).astype(int), SIDE - 1) for x in (u, v))
    tile = column * SIDE + row
    directions = np.concatenate([up, up * [1, 1, -1]])
    tiles = np.concatenate([tile, tile + SIDE**2])
    seen = (directions @ forward.T > 0).any(axis=1)
    order = np.argsort(tiles[seen], kind="stable")
    return EyeRays(directions[seen][order], tiles[seen][order], 2 * np.pi / n**2)


def within(tiles: np.ndarray, count: int, seed: int) -> tuple[np.ndarray, float]:
    """Directions (tile · count², 3) that are even over some tiles, and the solid angle of each.

    Parameters
    ----------
    tiles : np.ndarray of int, shape (tile,)
        Numbers of tiles, as of `EyeRays.tile`.
    count : int
        Number of rows and columns of directions in a tile; each is drawn from a cell of its own.
    seed : int
    """
    lower, tile = np.divmod(tiles[:, None], SIDE**2)
    u, v = np.random.default_rng(seed).random((2, len(tiles), count**2))
    cell = np.arange(count**2)
    u = (tile // SIDE + (cell // count + u) / count) / SIDE
    v = (tile % SIDE + (cell % count + v) / count) / SIDE
    up = _concentric(u.ravel(), v.ravel()).reshape(len(tiles), -1, 3)
    up[..., 2] *= 1 - 2 * lower
    return up.reshape(-1, 3), 2 * np.pi / (SIDE * count) ** 2


def _concentric(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Unit vectors of the upper hemisphere (n, 3) at places of the unit square."""
    a, b = 2 * u - 1, 2 * v - 1
    wide = np.abs(a) > np.abs(b)
    r = np.where(wide, a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        phi = np.where(wide, np.pi / 4 * b / a, np.pi / 2 - np.pi / 4 * a / b)
    phi += ASKEW
    aside = r * np.sqrt(2 - r**2)  # of equal areas: cos θ = 1 − r²
    return np.stack([aside * np.cos(phi), aside * np.sin(phi), 1 - r**2], axis=1)


def merged(tile: np.ndarray, key: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Ray that stands for the rays of one tile with one key, int, shape (ray,).

    Parameters
    ----------
    tile : np.ndarray of int, shape (ray,)
    key : np.ndarray of int, shape (ray,)
        What a ray meets; −1 keeps the ray for itself.
    directions : np.ndarray, shape (ray, 3)
    """
    own = np.arange(len(tile))
    key = np.where(key < 0, key.max(initial=0) + 1 + own, key)
    _, group = np.unique(np.stack([tile, key], axis=1), axis=0, return_inverse=True)
    group = group.ravel()
    total = np.stack([np.bincount(group, directions[:, k]) for k in range(3)], axis=1)
    towards = np.einsum("ri,ri->r", directions, total[group])
    order = np.lexsort((-towards, group))
    first = order[np.r_[True, np.diff(group[order]) > 0]]
    return first[group]
