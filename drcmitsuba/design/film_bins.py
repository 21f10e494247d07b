"""Bins from which light reaches a film, and cells of directions in which light leaves the film.

Radiance is constant within an outgoing cell. The cells are the squares of Shirley and Chiu's map of
the hemisphere, 32 × 32 at depth 5, all of one projected solid angle. Tensor trees have the same
cells, so that measured films of this depth or a lower one are represented exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle
from drcmitsuba_plugins.tensor import to_direction, unpack

from drcmitsuba.sky.sun_models import Suns


class Arriving(NamedTuple):
    """Directions that represent the bins, in the pane's frame (+z into the room, +y up).

    Parameters
    ----------
    d : np.ndarray, shape (direction, 3)
        Unit vectors to the source, z < 0.
    weight : np.ndarray, shape (direction,)
        ∫ cos θ dΩ [sr] over the part of the bin that the direction represents.
    bin : np.ndarray, shape (direction,)
        Number of the bin.
    """

    d: np.ndarray
    weight: np.ndarray
    bin: np.ndarray


class CellParts(NamedTuple):
    """Parts of the outgoing cells, the same number for each, cell by cell (cell · part).

    Unit vectors d to the parts' middles, into the room, in the pane's frame; solid angles [sr].
    """

    d: np.ndarray
    solid_angle: np.ndarray


@dataclass(frozen=True, eq=False)
class FilmBins:
    """Bins of the sky and the suns before a film that nothing shades, and its outgoing cells.

    Parameters
    ----------
    frame : np.ndarray, shape (3, 3)
        Rows: the pane's x, y (up) and normal into the room, in the world's frame.
    subdivision : int
        Reinhart's factor MF of the sky.
    depth : int
        2ᵈᵉᵖᵗʰ outgoing cells along each side of the square.
    """

    frame: np.ndarray
    subdivision: int
    suns: Suns
    depth: int = 5

    def __len__(self) -> int:
        """Count the bins: ground, sky patches, suns."""
        return len(Patches(self.subdivision)) + len(self.suns.labels)

    @property
    def cells(self) -> int:
        """Number of outgoing cells."""
        return 1 << 2 * self.depth

    def arriving(self, per_side: int, per_sun: int) -> Arriving:
        """Directions that represent all bins before the pane.

        A Tregenza patch has `per_side`² directions, the ground 32 times as many, a smaller patch of
        a finer sky fewer. On a sun's disk 1 is at its centre, more are on a ring of half its area.
        """
        d, vector, number = _sky(self.subdivision, per_side)
        on_disks = _on_disks(self.suns, per_sun)
        solid_angle = disk_solid_angle(self.suns.diameter) / per_sun
        of_suns = np.repeat(np.arange(len(self.suns.labels)), per_sun)
        d = np.concatenate([d, on_disks])
        weight = -np.concatenate([vector, solid_angle * on_disks]) @ self.frame[2]
        bins = np.concatenate([number, len(Patches(self.subdivision)) + of_suns])
        kept = (weight > 0) & (d @ self.frame[2] < 0)
        return Arriving(d[kept] @ self.frame.T, weight[kept], bins[kept])

    def points(self, count: int) -> np.ndarray:
        """Return `count` points of each outgoing cell, shape (cell · point, 3); for 1 its middle.

        Unit vectors into the room, in the pane's frame, uniform by projected solid angle.
        """
        # Points of Roberts' sequence, shifted in each cell: all points of a lattice's row would
        # have one radius and lie on the same side of a border.
        steps = np.outer(np.arange(count), [0.7548776662466927, 0.5698402909980532])
        shifts = np.random.default_rng(0).random((self.cells, 1, 2))
        within = (steps + (shifts if count > 1 else 0.5)) % 1
        corner = np.stack(unpack(np.arange(self.cells), 2, self.depth), axis=-1)[:, None]
        s, t = np.moveaxis((corner + within) / (1 << self.depth), -1, 0)
        return to_direction(s, t).reshape(-1, 3)

    def parts(self, per_side: int) -> CellParts:
        """Cut each outgoing cell into per_side² parts, even in the angle from the normal."""
        return _parts(self.depth, per_side)


@lru_cache(maxsize=8)
def _parts(depth: int, per_side: int) -> CellParts:
    # For coordinates a > b of the square [−1, 1]², a is the radius and π/4 b/a the azimuth, so that
    # dΩ = r dr dφ / cos θ = π/4 db d(asin a). The cuts are even in asin a: 1/cos θ, infinite at the
    # rim, does not occur.
    low = np.stack(unpack(np.arange(1 << 2 * depth), 2, depth)) / (1 << depth) * 2 - 1
    high = low + 2 * 0.5**depth
    part = np.arange(2 * per_side + 1)[:, None, None] / (2 * per_side)
    even = low + part * (high - low)
    by_angle = np.sin(np.arcsin(low) + part * (np.arcsin(high) - np.arcsin(low)))
    middle = abs(low + high)
    cuts = np.where(middle >= middle[::-1], by_angle, even)  # (cut, axis, cell)
    s, t = cuts[1::2, 0, :].T[:, :, None], cuts[1::2, 1, :].T[:, None, :]
    size = np.diff(cuts[::2], axis=0), np.diff(np.arcsin(cuts[::2]), axis=0)
    (ds, dt), (angle_s, angle_t) = (
        (d[:, 0, :].T[:, :, None], d[:, 1, :].T[:, None, :]) for d in size
    )
    solid_angle = np.pi / 4 * np.where(abs(s) >= abs(t), dt * angle_s, ds * angle_t)
    s, t = np.broadcast_arrays(s, t)
    return CellParts(to_direction((s + 1) / 2, (t + 1) / 2).reshape(-1, 3), solid_angle.ravel())


@lru_cache(maxsize=8)
def _sky(subdivision: int, per_side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parts of the bins, of equal solid angle: middles, ∫ω dΩ, both (part, 3), and bins (part,).

    Directions are in the world's frame.
    """
    d, vector, number = [], [], []
    for b, (low, high, west, east) in enumerate(Patches(subdivision).bounds):
        side = -(-per_side // subdivision)
        rows, columns = (4 * per_side, 8 * per_side) if b == 0 else (side, side)
        sines = np.linspace(np.sin(low), np.sin(high), 2 * rows + 1)[:, None]
        turn = np.linspace(west, east, 2 * columns + 1)
        c = np.sqrt(np.maximum(0, 1 - sines**2))
        middle, across = sines[1::2], turn[1::2]
        d.append(_stacked(c[1::2] * np.sin(across), c[1::2] * np.cos(across), middle))
        # ∫ cos²a da and ∫ sin a cos a da over the height, times integrals over the width.
        level = np.diff((np.arcsin(sines) + sines * c)[::2] / 2, axis=0)
        steep = np.diff(sines[::2] ** 2 / 2, axis=0)
        x, y = -np.diff(np.cos(turn[::2])), np.diff(np.sin(turn[::2]))
        vector.append(_stacked(level * x, level * y, steep * np.diff(turn[::2])))
        number.append(np.full(rows * columns, b))
    return np.concatenate(d), np.concatenate(vector), np.concatenate(number)


def _stacked(*components: np.ndarray) -> np.ndarray:
    """Vectors (vector, 3) of components that are broadcast."""
    return np.stack([a.ravel() for a in np.broadcast_arrays(*components)], axis=-1)


def _on_disks(suns: Suns, count: int) -> np.ndarray:
    """Directions on the suns' disks (sun · count, 3)."""
    z = suns.directions.reshape(-1, 3)
    if count == 1 or len(z) == 0:
        return z
    across = np.cross(z, np.where(abs(z[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turn = 2 * np.pi * np.arange(count)[:, None] / count
    other = np.cross(z, across)
    ring = np.cos(turn) * across[:, None] + np.sin(turn) * other[:, None]
    # The ring encloses half of the disk's area and has the disk's second moment.
    r = np.radians(suns.diameter) / 2 / np.sqrt(2)
    return (np.cos(r) * z[:, None] + np.sin(r) * ring).reshape(-1, 3)
