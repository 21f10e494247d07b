"""Lobes of a measured BSDF: values, and directions drawn in proportion to f cos θ.

One of the two directions is given. The classes differ in their cells of directions: squares of a
tensor tree of rank 4, Klems' patches, or, for isotropic trees, radius and relative azimuth. All
directions are unit vectors of the file's frame (+z to the room, +y up) that leave the pane.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.klems_basis import KlemsBasis, KlemsMatrix
from drcmitsuba_plugins.rows import of_matrices, of_trees
from drcmitsuba_plugins.sampling import clamped_index
from drcmitsuba_plugins.tensor import TensorTree


def spread(x):
    """Put a zero between neighbouring bits of numbers below 2⁸."""
    x = (x | (x << 4)) & 0x0F0F
    x = (x | (x << 2)) & 0x3333
    return (x | (x << 1)) & 0x5555


def gathered(x):
    """Take every second bit, the inverse of `spread`."""
    x = x & 0x5555
    x = (x | (x >> 1)) & 0x3333
    x = (x | (x >> 2)) & 0x0F0F
    return (x | (x >> 4)) & 0x00FF


def square_code(xy, depth: int):
    """Morton code of the cell that holds a point of the disk; a side of the square has 2ᵈᵉᵖᵗʰ."""
    n = 1 << depth
    s = mi.warp.uniform_disk_to_square_concentric(xy)
    i, j = (clamped_index(c * n, n) for c in (s.x, s.y))
    return spread(i) | (spread(j) << 1)


def upper(xy):
    """Unit vector, z ≥ 0, whose projection is a point of the disk."""
    return mi.Vector3f(xy.x, xy.y, dr.safe_sqrt(1 - dr.squared_norm(xy)))


class OutSquares:
    """Cells of outgoing directions: squares of the unit square, 2ᵈᵉᵖᵗʰ along a side.

    `out_even` is true where f is constant within each cell.
    """

    out_depth: int
    out_even = True

    @property
    def out_cells(self) -> int:
        """Number of cells."""
        return 1 << 2 * self.out_depth

    def out_cell(self, w):
        """Morton code of the cell that holds an outgoing direction."""
        return square_code(w.xy, self.out_depth)

    def out_direction(self, cell, uv):
        """Direction drawn from a cell, uniformly by projected solid angle."""
        corner = mi.Point2f(mi.Float(gathered(cell)), mi.Float(gathered(cell >> 1)))
        s = (corner + uv) * 0.5**self.out_depth
        return upper(mi.warp.square_to_uniform_disk_concentric(s))


class SquareLobes(OutSquares):
    """Lobes of tensor trees of rank 4; drawing is exactly proportional to f cos θ.

    Parameters
    ----------
    trees : list of TensorTree or None
        One tree per component, None where missing; its values are the numbers of the leaves.
    fixed : {'incident', 'outgoing'}
        Direction that is given.
    """

    def __init__(self, trees: list[TensorTree | None], fixed: str):
        known = [t for t in trees if t is not None]
        self.depth = max(t.depth for t in known)
        self.out_depth = self.depth
        self.cells = 1 << 2 * self.depth
        self.sign = -1.0 if fixed == "incident" else 1.0
        self.rows = of_trees(trees, fixed, self.depth)
        self.side = self._sides(known)

    @staticmethod
    def _sides(trees: list[TensorTree]):
        """Side of every leaf's outgoing square as a fraction of the unit square, shape (leaf,)."""
        side = np.ones(1 + max(int(t.value.max()) for t in trees), np.float32)
        for tree in trees:
            side[tree.value.astype(int)] = 0.5**tree.level
        return mi.Float(side)

    def update(self, values: np.ndarray) -> None:
        """Set the values f [1/sr] of the leaves, shape (leaf,)."""
        self.rows.update(values)

    def row(self, component, given):
        """Number of the row that lists a component's cells for a given direction."""
        return component * self.cells + square_code(self.sign * given.xy, self.depth)

    def albedo(self, row, active):
        """Integral of f cos θ over the other direction [1], one per row number."""
        return dr.gather(mi.Float, self.rows.albedo, row, active)

    def value(self, leaves, component, given, other, active):
        """BSDF f [1/sr] of a component for the given and the other direction."""
        code = square_code(-self.sign * other.xy, self.depth)
        entry, filled = self.rows.find(self.row(component, given), code, active)
        leaf = dr.gather(mi.UInt32, self.rows.leaf, entry, filled)
        return dr.gather(mi.Float, leaves, leaf, filled)

    def draw(self, row, given, u, uv, active):
        """Other direction (z ≥ 0), drawn from a row in proportion to f cos θ."""
        return upper(-self.sign * self._point(row, u, uv, active))

    def _point(self, row, u, uv, active):
        """Point of the disk, drawn from a row in proportion to f."""
        entry, filled = self.rows.draw(row, u, active)
        code = dr.gather(mi.UInt32, self.rows.code, entry, filled)
        side = dr.gather(mi.Float, self.side, dr.gather(mi.UInt32, self.rows.leaf, entry, filled))
        corner = mi.Point2f(mi.Float(gathered(code)), mi.Float(gathered(code >> 1)))
        s = corner * 0.5**self.depth + uv * side
        return mi.warp.square_to_uniform_disk_concentric(s)

    def density(self, row, given, other, value, active):
        """Probability density of the other direction per projected solid angle [1/sr]."""
        albedo = self.albedo(row, active)
        return dr.select(albedo > 0, value / albedo, 0)


class KlemsLobes(SquareLobes):
    """Lobes of matrices over Klems' patches; drawing is exactly proportional to f cos θ."""

    def __init__(self, matrices: list[KlemsMatrix | None], fixed: str):
        self.basis: KlemsBasis = next(m.incident for m in matrices if m is not None)
        self.cells = len(self.basis)
        self.sign = -1.0 if fixed == "incident" else 1.0
        self.rows = of_matrices(matrices, fixed, self.basis)
        cos2 = np.cos(np.radians(self.basis.limits)) ** 2
        self.sin2 = mi.Float((1 - cos2).astype(np.float32))
        self.count = mi.UInt32(np.array(self.basis.counts, np.uint32))
        self.first = mi.UInt32(self.basis.first.astype(np.uint32))
        self.ring = mi.UInt32(self.basis.ring.astype(np.uint32))

    def patch(self, xy):
        """Number of the patch that holds a point of the disk."""
        r2 = dr.squared_norm(xy)
        ring = mi.UInt32(0)
        for limit in np.sin(np.radians(self.basis.limits[1:-1])) ** 2:
            ring += dr.select(r2 >= float(limit), mi.UInt32(1), 0)
        count = dr.gather(mi.UInt32, self.count, ring)
        turn = dr.atan2(xy.y, xy.x) * dr.inv_two_pi
        turn = dr.select(turn < 0, turn + 1, turn)
        # Inactive lanes read a count of 0, and a remainder by 0 would stop the process.
        nearest = mi.UInt32(turn * mi.Float(count) + 0.5) % dr.maximum(count, 1)
        return dr.gather(mi.UInt32, self.first, ring) + nearest

    def row(self, component, given):
        return component * self.cells + self.patch(self.sign * given.xy)

    def value(self, leaves, component, given, other, active):
        patch = self.patch(-self.sign * other.xy)
        first = dr.gather(mi.UInt32, self.rows.first, self.row(component, given), active)
        following = dr.gather(mi.UInt32, self.rows.first, self.row(component, given) + 1, active)
        filled = active & (following > first)  # a row lists every patch or none
        leaf = dr.gather(mi.UInt32, self.rows.leaf, first + patch, filled)
        return dr.gather(mi.Float, leaves, leaf, filled)

    def draw(self, row, given, u, uv, active):
        entry, filled = self.rows.draw(row, u, active)
        patch = dr.gather(mi.UInt32, self.rows.code, entry, filled)
        return upper(-self.sign * self._within(patch, uv))

    def _within(self, patch, uv):
        """Point of the disk, drawn uniformly from a patch."""
        ring = dr.gather(mi.UInt32, self.ring, patch)
        count = dr.gather(mi.UInt32, self.count, ring)
        within = mi.Float(patch - dr.gather(mi.UInt32, self.first, ring))
        phi = dr.two_pi * (within + uv.y - 0.5) / mi.Float(dr.maximum(count, 1))
        low, high = (dr.gather(mi.Float, self.sin2, ring + k) for k in (0, 1))
        r = dr.sqrt(dr.lerp(low, high, uv.x))
        s, c = dr.sincos(phi)
        return mi.Point2f(r * c, r * s)

    @property
    def out_cells(self) -> int:
        """Number of patches."""
        return self.cells

    def out_cell(self, w):
        return self.patch(w.xy)

    def out_direction(self, cell, uv):
        return upper(self._within(cell, uv))
