"""Tensor trees: piecewise constant BSDFs over pairs of directions, kept as lists of Morton codes.

Directions are mapped to the unit square by the area-preserving map of Shirley and Chiu, so that a
square cell of side h has the projected solid angle π h² [sr]. A tree of rank 4 cuts the hypercube
(incident square × outgoing square), one of rank 3 (radius × outgoing square) for isotropic
materials. The leaves of such a tree, put in the order in which the tree is walked, are intervals
of Morton codes: a look-up is a binary search, and two trees have a common refinement by merging.

References
----------
.. [1] P. Shirley, K. Chiu, "A low distortion map between disk and square", J. Graphics Tools 2(3),
   1997.
.. [2] G. Ward, M. Kurt, N. Bonneel, "Reducing anisotropic BSDF measurement to common practice",
   2014 (tensor tree).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

MAX_DEPTH = 8
"""Levels of a tree: Morton codes of rank 4 then just fill 32 bits."""


def to_square(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in the unit square of points of the unit disk, area-preserving [1]."""
    q = np.pi / 4
    r = np.minimum(np.hypot(x, y), 1)
    phi = np.arctan2(y, x)
    phi = np.where(phi < -q, phi + 2 * np.pi, phi)
    sector = np.clip(np.floor(phi / q + 1).astype(int) // 2, 0, 3)
    turned = (phi - sector * 2 * q) / q * r
    a = np.choose(sector, [r, -turned, -r, turned])
    b = np.choose(sector, [turned, r, -turned, -r])
    # The axes of the disk are borders of cells: rounding must not carry a point across them.
    return _halves(a, x), _halves(b, y)


def _halves(a: np.ndarray, sign: np.ndarray) -> np.ndarray:
    below = np.nextafter(0.5, 0)
    s = (a + 1) / 2
    return np.where(sign < 0, np.minimum(s, below), np.maximum(s, 0.5))


def to_disk(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in the unit disk of points of the unit square, the inverse of `to_square`."""
    a, b = 2 * np.asarray(s, float) - 1, 2 * np.asarray(t, float) - 1
    wide = np.abs(a) > np.abs(b)
    r = np.where(wide, a, b)
    small = np.where(wide, b, a)
    ratio = np.divide(small, r, out=np.zeros_like(small), where=r != 0)
    phi = np.where(wide, np.pi / 4 * ratio, np.pi / 2 - np.pi / 4 * ratio)
    return r * np.cos(phi), r * np.sin(phi)


def to_direction(s: np.ndarray, t: np.ndarray, side: float = 1.0) -> np.ndarray:
    """Unit vectors (…, 3) of points of the square; `side` is the sign of their z."""
    x, y = to_disk(s, t)
    z = np.sqrt(np.maximum(0, 1 - x * x - y * y))
    return np.stack([x, y, side * z], axis=-1)


def morton(coordinates: list[np.ndarray], depth: int) -> np.ndarray:
    """Morton code of points of the unit cube: coordinate i gives bit i of each level's digit."""
    rank = len(coordinates)
    n = 1 << depth
    whole = [np.clip((c * n).astype(np.int64), 0, n - 1) for c in coordinates]
    code = np.zeros(np.shape(whole[0]), np.int64)
    for level in range(depth):
        for i, c in enumerate(whole):
            code |= ((c >> level) & 1) << (rank * level + i)
    return code


def unpack(code: np.ndarray, rank: int, depth: int) -> list[np.ndarray]:
    """Integer coordinates of Morton codes, in units of the finest cells."""
    code = np.asarray(code, np.int64)
    whole = [np.zeros(code.shape, np.int64) for _ in range(rank)]
    for level in range(depth):
        for i in range(rank):
            whole[i] |= ((code >> (rank * level + i)) & 1) << level
    return whole


def _repack(code: np.ndarray, rank: int, depth: int, axes: tuple[int, ...]) -> np.ndarray:
    """Morton code over the given axes of a Morton code of rank `rank`."""
    out = np.zeros(np.shape(code), np.int64)
    for level in range(depth):
        for i, axis in enumerate(axes):
            out |= ((code >> (rank * level + axis)) & 1) << (len(axes) * level + i)
    return out


@dataclass(frozen=True)
class TensorTree:
    """One component of a BSDF: transmission or reflection, light arriving from one side.

    Parameters
    ----------
    rank : int
        4, or 3 for an isotropic material.
    depth : int
        Levels down to the finest cells, of side 2⁻ᵈᵉᵖᵗʰ.
    start : np.ndarray, shape (leaf,)
        Morton code of the first finest cell of every leaf, ascending.
    level : np.ndarray, shape (leaf,)
        Level of every leaf: its side is 2⁻ˡᵉᵛᵉˡ.
    value : np.ndarray, shape (leaf,)
        f [1/sr].
    """

    rank: int
    depth: int
    start: np.ndarray
    level: np.ndarray
    value: np.ndarray

    @classmethod
    def constant(cls, value: float, rank: int = 4) -> TensorTree:
        """Tree of one leaf: a Lambertian component of albedo π·value."""
        zero = np.zeros(1, np.int64)
        return cls(rank, 0, zero, zero, np.array([value], float))

    @classmethod
    def of_grid(cls, grid: np.ndarray) -> TensorTree:
        """Tree of a regular grid, shape (n,) * rank with n a power of two; nothing is merged."""
        rank, depth = grid.ndim, int(grid.shape[0]).bit_length() - 1
        code = np.arange(grid.size, dtype=np.int64)
        value = grid[tuple(unpack(code, rank, depth))].astype(float)
        return cls(rank, depth, code, np.full(grid.size, depth), value)

    def __len__(self) -> int:
        """Count the leaves."""
        return len(self.start)

    @property
    def live(self) -> np.ndarray:
        """Mask of the leaves that directions reach; rank 3 uses half of its first axis."""
        if self.rank == 4 or self.depth == 0:
            return np.ones(len(self), bool)
        s0 = _repack(self.start, 3, self.depth, (0,))
        return s0 < (1 << self.depth) // 2

    def at(self, incident: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """Index of the leaf of pairs of directions (…, 3) that leave the surface, shape (…)."""
        if self.rank == 4:
            points = [
                *to_square(-incident[..., 0], -incident[..., 1]),
                *to_square(outgoing[..., 0], outgoing[..., 1]),
            ]
        else:
            r = np.hypot(incident[..., 0], incident[..., 1])
            turn = np.arctan2(-incident[..., 1], -incident[..., 0])
            c, s = np.cos(turn), np.sin(turn)
            x, y = outgoing[..., 0], outgoing[..., 1]
            radius = np.clip(0.5 - 0.5 * r, 0, 0.5 - 1e-9)
            points = [radius, *to_square(c * x + s * y, c * y - s * x)]
        return np.searchsorted(self.start, morton(points, self.depth), "right") - 1

    def values(self, incident: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """BSDF f [1/sr] of pairs of directions (…, 3), shape (…)."""
        return self.value[self.at(incident, outgoing)]

    def incident_cells(self) -> np.ndarray:
        """Code of every leaf's first incident cell, in a square (rank 4) or on a line (rank 3)."""
        return _repack(self.start, self.rank, self.depth, (0, 1) if self.rank == 4 else (0,))

    def outgoing_cells(self) -> np.ndarray:
        """Morton code in the square of every leaf's first outgoing cell."""
        return _repack(self.start, self.rank, self.depth, (2, 3) if self.rank == 4 else (1, 2))

    def hemispherical(self, incident: np.ndarray) -> np.ndarray:
        """Directional-hemispherical transmittance or reflectance of directions (n, 3), (n,)."""
        if self.rank == 4:
            point = list(to_square(-incident[:, 0], -incident[:, 1]))
        else:
            r = np.hypot(incident[:, 0], incident[:, 1])
            point = [np.clip(0.5 - 0.5 * r, 0, 0.5 - 1e-9)]
        return self.albedos()[morton(point, self.depth)]

    def albedos(self) -> np.ndarray:
        """Directional-hemispherical value of every finest incident cell, shape (incident cell,)."""
        return self._sums(self.incident_cells(), self.rank - 2)

    def _sums(self, cells: np.ndarray, axes: int) -> np.ndarray:
        """∫ f cos θ dω over one direction, for every finest cell (`cells`) of the other."""
        total = np.zeros((1 << axes * self.depth) + 1)
        power = np.pi * self.value / 4.0**self.level
        np.add.at(total, cells, power)
        np.add.at(total, cells + (1 << axes * (self.depth - self.level)), -power)
        return np.maximum(np.cumsum(total)[:-1], 0)  # rounding may leave less than nothing

    def collected(self, outgoing: np.ndarray) -> np.ndarray:
        """∫ f cos θ dω over the incident directions, for outgoing directions (n, 3), shape (n,)."""
        assert self.rank == 4
        sums = self._sums(self.outgoing_cells(), 2)
        return sums[morton(list(to_square(outgoing[:, 0], outgoing[:, 1])), self.depth)]

    def reversed(self) -> TensorTree:
        """Tree with incident and outgoing directions exchanged (rank 4 only)."""
        assert self.rank == 4
        # A direction's incident cell is the complement of its outgoing cell.
        mask = (1 << 4 * self.depth) - 1
        size = np.int64(1) << 4 * (self.depth - self.level)
        flipped = (self.start + size - 1) ^ mask
        code = np.zeros(len(self), np.int64)
        for level in range(self.depth):
            digit = (flipped >> (4 * level)) & 15
            code |= ((digit >> 2) | ((digit & 3) << 2)) << (4 * level)
        order = np.argsort(code)
        return replace(self, start=code[order], level=self.level[order], value=self.value[order])

    def lambertian(self) -> float:
        """Albedo of the Lambertian part: π · the smallest value of f."""
        return float(np.pi * self.value[self.live].min())
