"""Lobes of a measured BSDF: values, and directions drawn in proportion to f cos θ.

One of the two directions is given. The classes differ in how directions are cut into cells: squares
of a tensor tree of rank 4, Klems' patches, or, for isotropic trees, radius and relative azimuth.
All take directions in the file's frame (+z to the room, +y up), pointing away from the pane.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.klems_basis import KlemsBasis, KlemsMatrix
from drcmitsuba_plugins.rows import Rows, of_matrices, of_trees
from drcmitsuba_plugins.tensor import TensorTree, morton


def _spread(x):
    """Put zeros between the bits of numbers below 2⁸."""
    x = (x | (x << 4)) & 0x0F0F
    x = (x | (x << 2)) & 0x3333
    return (x | (x << 1)) & 0x5555


def _gathered(x):
    """Take every second bit, the inverse of `_spread`."""
    x = x & 0x5555
    x = (x | (x >> 1)) & 0x3333
    x = (x | (x >> 2)) & 0x0F0F
    return (x | (x >> 4)) & 0x00FF


def square_code(xy, depth: int):
    """Morton code of points of the disk at 2ᵈᵉᵖᵗʰ cells along a side of the square."""
    n = 1 << depth
    s = mi.warp.uniform_disk_to_square_concentric(xy)
    i, j = (mi.UInt32(dr.clip(c * n, 0, n - 1)) for c in (s.x, s.y))
    return _spread(i) | (_spread(j) << 1)


def _upper(xy):
    """Direction above a point of the disk."""
    return mi.Vector3f(xy.x, xy.y, dr.safe_sqrt(1 - dr.squared_norm(xy)))


def _azimuth(xy):
    """Cosine and sine of the azimuth of points."""
    r = dr.norm(xy)
    inverse = 1 / dr.select(r > 0, r, 1)
    return dr.select(r > 0, xy.x * inverse, 1), xy.y * inverse


class SquareLobes:
    """Lobes of tensor trees of rank 4; drawing is exactly proportional to f cos θ.

    Parameters
    ----------
    trees : list of TensorTree or None
        One for each component, their values the numbers of the leaves.
    fixed : {'incident', 'outgoing'}
        Direction that is given.
    """

    def __init__(self, trees: list[TensorTree | None], fixed: str):
        known = [t for t in trees if t is not None]
        self.depth = max(t.depth for t in known)
        self.cells = 1 << 2 * self.depth
        self.sign = -1.0 if fixed == "incident" else 1.0
        self.rows = of_trees(trees, fixed, self.depth)
        self.side = self._sides(known)

    @staticmethod
    def _sides(trees: list[TensorTree]):
        """Side of every leaf's square."""
        side = np.ones(1 + max(int(t.value.max()) for t in trees), np.float32)
        for tree in trees:
            side[tree.value.astype(int)] = 0.5**tree.level
        return mi.Float(side)

    def update(self, values: np.ndarray) -> None:
        """Take over new values of the leaves."""
        self.rows.update(values)

    def row(self, component, given):
        """Row of a component and a direction that is given."""
        return component * self.cells + square_code(self.sign * given.xy, self.depth)

    def albedo(self, row, active):
        """Integral of f cos θ over the other direction."""
        return dr.gather(mi.Float, self.rows.albedo, row, active)

    def value(self, leaves, component, given, other, active):
        """BSDF f [1/sr]; `component` names which."""
        code = square_code(-self.sign * other.xy, self.depth)
        entry, found = self.rows.find(self.row(component, given), code, active)
        leaf = dr.gather(mi.UInt32, self.rows.leaf, entry, found)
        return dr.gather(mi.Float, leaves, leaf, found)

    def draw(self, row, given, u, uv, active):
        """Other direction (its z positive), drawn from a row."""
        return _upper(-self.sign * self._point(row, u, uv, active))

    def _point(self, row, u, uv, active):
        """Point of the disk within a cell that is drawn from a row."""
        entry, found = self.rows.draw(row, u, active)
        code = dr.gather(mi.UInt32, self.rows.code, entry, found)
        side = dr.gather(mi.Float, self.side, dr.gather(mi.UInt32, self.rows.leaf, entry, found))
        corner = mi.Point2f(mi.Float(_gathered(code)), mi.Float(_gathered(code >> 1)))
        s = corner * 0.5**self.depth + uv * side
        return mi.warp.square_to_uniform_disk_concentric(s)

    def density(self, row, given, other, value, active):
        """Probability of the other direction per projected solid angle [1/sr]."""
        albedo = self.albedo(row, active)
        return dr.select(albedo > 0, value / albedo, 0)

    @property
    def out_cells(self) -> int:
        """Cells of the outgoing direction within which the lobes do not change."""
        return self.cells

    def out_cell(self, w):
        """Cell of outgoing directions."""
        return square_code(w.xy, self.depth)

    def out_direction(self, cell, uv):
        """Direction in a cell, evenly by projected solid angle."""
        corner = mi.Point2f(mi.Float(_gathered(cell)), mi.Float(_gathered(cell >> 1)))
        return _upper(mi.warp.square_to_uniform_disk_concentric((corner + uv) * 0.5**self.depth))


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
        """Patch of points of the disk."""
        r2 = dr.squared_norm(xy)
        ring = mi.UInt32(0)
        for limit in np.sin(np.radians(self.basis.limits[1:-1])) ** 2:
            ring += dr.select(r2 >= float(limit), mi.UInt32(1), 0)
        count = dr.gather(mi.UInt32, self.count, ring)
        turn = dr.atan2(xy.y, xy.x) * dr.inv_two_pi
        turn = dr.select(turn < 0, turn + 1, turn)
        # Lanes that a call leaves out see a count of 0, and its remainder would stop the process.
        nearest = mi.UInt32(turn * mi.Float(count) + 0.5) % dr.maximum(count, 1)
        return dr.gather(mi.UInt32, self.first, ring) + nearest

    def row(self, component, given):
        return component * self.cells + self.patch(self.sign * given.xy)

    def value(self, leaves, component, given, other, active):
        patch = self.patch(-self.sign * other.xy)
        first = dr.gather(mi.UInt32, self.rows.first, self.row(component, given), active)
        following = dr.gather(mi.UInt32, self.rows.first, self.row(component, given) + 1, active)
        found = active & (following > first)  # rows are whole or empty
        leaf = dr.gather(mi.UInt32, self.rows.leaf, first + patch, found)
        return dr.gather(mi.Float, leaves, leaf, found)

    def draw(self, row, given, u, uv, active):
        entry, found = self.rows.draw(row, u, active)
        patch = dr.gather(mi.UInt32, self.rows.code, entry, found)
        return _upper(-self.sign * self._within(patch, uv))

    def _within(self, patch, uv):
        """Point of the disk in a patch, evenly by projected solid angle."""
        ring = dr.gather(mi.UInt32, self.ring, patch)
        count = dr.gather(mi.UInt32, self.count, ring)
        within = mi.Float(patch - dr.gather(mi.UInt32, self.first, ring))
        phi = dr.two_pi * (within + uv.y - 0.5) / mi.Float(dr.maximum(count, 1))
        low, high = (dr.gather(mi.Float, self.sin2, ring + k) for k in (0, 1))
        r = dr.sqrt(dr.lerp(low, high, uv.x))
        s, c = dr.sincos(phi)
        return mi.Point2f(r * c, r * s)

    def out_cell(self, w):
        return self.patch(w.xy)

    def out_direction(self, cell, uv):
        return _upper(self._within(cell, uv))


class IsotropicLobes(SquareLobes):
    """Lobes of tensor trees of rank 3, given the incident direction: drawing is exact.

    The squares of the outgoing direction are turned with the azimuth of the incident one.
    """

    def __init__(self, trees: list[TensorTree | None]):
        known = [t for t in trees if t is not None]
        self.depth = max(t.depth for t in known)
        self.cells = 1 << self.depth
        self.rows = of_trees(trees, "incident", self.depth)
        self.side = self._sides(known)

    def row(self, component, given):
        s0 = 0.5 - 0.5 * dr.norm(given.xy)
        half = max(self.cells // 2 - 1, 0)
        return component * self.cells + mi.UInt32(dr.clip(s0 * self.cells, 0, half))

    def value(self, leaves, component, given, other, active):
        c, s = _azimuth(-given.xy)
        turned = mi.Point2f(c * other.x + s * other.y, c * other.y - s * other.x)
        code = square_code(turned, self.depth)
        return self.value_at(leaves, component, given, code, active)

    def value_at(self, leaves, component, given, code, active):
        """BSDF f [1/sr] in a square of the outgoing direction."""
        entry, found = self.rows.find(self.row(component, given), code, active)
        leaf = dr.gather(mi.UInt32, self.rows.leaf, entry, found)
        return dr.gather(mi.Float, leaves, leaf, found)

    def draw(self, row, given, u, uv, active):
        p = self._point(row, u, uv, active)
        c, s = _azimuth(-given.xy)
        return _upper(mi.Point2f(c * p.x - s * p.y, s * p.x + c * p.y))


OUT_DEPTH = 6
"""Isotropic lobes turn with the incident direction: their cells are this fine a grid [levels]."""


class TurnedLobes:
    """Lobes of tensor trees of rank 3 where some are given by the outgoing direction.

    Seen from there, incident directions of one radius put the outgoing one on a circle in the
    tree's disk, which the map to the square turns into the perimeter of a square: four sides a
    from the centre, with t from −a to a along each. It runs through the same cells for all
    outgoing radii within one cell, except that it ends somewhere within the cell at each corner.
    So rows list (incident radius, side, cell along it), and only what falls into a corner is
    drawn by a weight that varies, between 0 and 2.

    Parameters
    ----------
    trees : list of TensorTree or None
        One for each component, their values the numbers of the leaves.
    turned : list of bool
        Components whose trees' outgoing direction is the one that is given.
    """

    def __init__(self, trees: list[TensorTree | None], turned: list[bool]):
        self.exact = IsotropicLobes(trees)
        self.turned = mi.Bool(turned)
        self.first_turned = len(trees) * self.exact.cells
        n = 1 << max(1, self.exact.depth)
        self.n, half = n, n // 2
        parts = []
        for component, tree in enumerate(trees):
            if tree is None or not turned[component]:
                continue
            k, i, side, j = np.meshgrid(*map(np.arange, (half, half, 4, n)), indexing="ij")
            a, t = (2 * k + 1) / n, (2 * j + 1) / n - 1
            x, y = np.choose(side, [a, -t, -a, t]), np.choose(side, [t, a, -t, -a])
            code = morton([(i + 0.5) / n, (x + 1) / 2, (y + 1) / 2], tree.depth)
            leaf = tree.value[np.searchsorted(tree.start, code, "right") - 1]
            covered = np.clip(a - np.abs(t) + 1 / n, 0, 2 / n)  # of t, at the middle of the cell
            low, high = 1 - 2 * (i + 1) / n, 1 - 2 * i / n
            weight = (high**2 - low**2) / 2 * np.pi / 4 * covered / a
            row, number = component * half + k, (i * 4 + side) * n + j
            parts.append([x.ravel() for x in (row, leaf.astype(int), number, weight)])
        joined = [np.concatenate(x) for x in zip(*parts, strict=True)]
        self.rows = Rows.of(*joined, rows=len(trees) * half)

    def update(self, values: np.ndarray) -> None:
        """Take over new values of the leaves."""
        self.exact.update(values)
        self.rows.update(values)

    def row(self, component, given):
        """Row of a component and a direction that is given; those of turned trees come last."""
        turned = dr.gather(mi.Bool, self.turned, component)
        row = self.first_turned + component * (self.n // 2) + self._cell(given)
        return dr.select(turned, row, self.exact.row(component, given))

    def _split(self, row, active):
        """Whether rows belong to turned trees, and their number there."""
        turned = row >= self.first_turned
        return turned & active, dr.select(turned, row - self.first_turned, 0)

    def albedo(self, row, active):
        """Integral of f cos θ over the other direction, at the middle of the row's cell."""
        turned, own = self._split(row, active)
        straight = self.exact.albedo(dr.select(turned, 0, row), active & ~turned)
        return dr.select(turned, dr.gather(mi.Float, self.rows.albedo, own, turned), straight)

    def value(self, leaves, component, given, other, active):
        """BSDF f [1/sr]; `component` names which."""
        turned = dr.gather(mi.Bool, self.turned, component)
        straight = self.exact.value(leaves, component, given, other, active & ~turned)
        # By the row's own cell, so that rounding cannot put value and row on two sides of a border.
        a, side, t = self._perimeter(given, other)
        x = dr.select(side == 0, a, dr.select(side == 1, -t, dr.select(side == 2, -a, t)))
        y = dr.select(side == 0, t, dr.select(side == 1, a, dr.select(side == 2, -t, -a)))
        n = 1 << self.exact.depth
        i, j = (mi.UInt32(dr.clip((c + 1) / 2 * n, 0, n - 1)) for c in (x, y))
        code = _spread(i) | (_spread(j) << 1)
        back = self.exact.value_at(leaves, component, other, code, active & turned)
        return dr.select(turned, back, straight)

    def _cell(self, given):
        """Cell of the outgoing radius."""
        half = self.n // 2
        return mi.UInt32(dr.clip(dr.norm(given.xy) * half, 0, half - 1))

    def _perimeter(self, given, other):
        """Middle of the row's cell, side, and way along it."""
        middle = (2 * mi.Float(self._cell(given)) + 1) / self.n
        c, s = _azimuth(-other.xy)
        phi = dr.atan2(c * given.y - s * given.x, c * given.x + s * given.y) / (dr.pi / 2)
        side = dr.round(phi)
        t = (phi - side) * 2 * dr.norm(given.xy)
        return middle, mi.UInt32(mi.Int32(side) + 4) % 4, t

    def draw(self, row, given, u, uv, active):
        """Other direction (its z positive), drawn from a row."""
        turned, own = self._split(row, active)
        straight = self.exact.draw(dr.select(turned, 0, row), given, u, uv, active & ~turned)
        entry, found = self.rows.draw(own, u, turned)
        number = dr.gather(mi.UInt32, self.rows.code, entry, found)
        j, side, i = number % self.n, number // self.n % 4, number // (4 * self.n)
        inner = 1 - 2 * (mi.Float(i) + 1) / self.n
        r = dr.sqrt(dr.lerp(dr.square(inner), dr.square(inner + 2 / self.n), uv.x))
        a = dr.norm(given.xy)
        low = dr.maximum(2 * mi.Float(j) / self.n - 1, -a)
        high = dr.minimum(2 * (mi.Float(j) + 1) / self.n - 1, a)
        phi = self._angle(mi.Float(side), dr.lerp(low, high, uv.y), a)
        sin, cos = dr.sincos(phi)
        c, s = _azimuth(given.xy)
        p = mi.Point2f(c * cos + s * sin, s * cos - c * sin)  # turned back by φ
        return dr.select(turned, _upper(-r * p), straight)

    @staticmethod
    def _angle(side, t, a):
        """Azimuth of a point of the perimeter."""
        return dr.pi / 2 * side + dr.pi / 4 * t / dr.maximum(a, 1e-9)

    def density(self, row, given, other, value, active):
        """Probability of the other direction per projected solid angle [1/sr]."""
        turned, _ = self._split(row, active)
        a = dr.norm(given.xy)
        middle, _, t = self._perimeter(given, other)
        corner = middle - 1 / self.n
        # In the corner, the way along is as long as the radius has come into the cell.
        covered = dr.select(dr.abs(t) > corner, 1 / (self.n * dr.maximum(a - corner, 1e-6)), 1)
        scale = dr.select(turned, covered * a / middle, 1)
        albedo = self.albedo(row, active)
        return dr.select(albedo > 0, scale * value / albedo, 0)

    @property
    def out_cells(self) -> int:
        """Cells of the outgoing direction within which the lobes hardly change."""
        return 1 << 2 * OUT_DEPTH

    def out_cell(self, w):
        """Cell of outgoing directions."""
        return square_code(w.xy, OUT_DEPTH)

    def out_direction(self, cell, uv):
        """Direction in a cell, evenly by projected solid angle."""
        corner = mi.Point2f(mi.Float(_gathered(cell)), mi.Float(_gathered(cell >> 1)))
        return _upper(mi.warp.square_to_uniform_disk_concentric((corner + uv) * 0.5**OUT_DEPTH))
