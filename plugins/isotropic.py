"""Lobes of isotropic materials: tensor trees of rank 3, by incident radius and outgoing square."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.lobes import OutSquares, SquareLobes, spread, square_code, upper
from drcmitsuba_plugins.rows import Rows, of_trees
from drcmitsuba_plugins.sampling import clamped_index
from drcmitsuba_plugins.tensor import TensorTree, morton

OUT_DEPTH = 6
"""Depth of the grid of outgoing cells, 2ᵈᵉᵖᵗʰ a side; lobes turn with the incident direction."""


def azimuth(xy):
    """Cosine and sine of the azimuth of points of the disk."""
    r = dr.norm(xy)
    inverse = 1 / dr.select(r > 0, r, 1)
    return dr.select(r > 0, xy.x * inverse, 1), xy.y * inverse


class IsotropicLobes(SquareLobes):
    """Lobes of trees of rank 3 for a given incident direction, drawn in proportion to f cos θ.

    The squares of the outgoing direction are turned with the azimuth of the incident one.
    """

    out_depth = OUT_DEPTH
    out_even = False

    def __init__(self, trees: list[TensorTree | None]):
        known = [t for t in trees if t is not None]
        self.depth = max(t.depth for t in known)
        self.cells = 1 << self.depth
        self.rows = of_trees(trees, "incident", self.depth)
        self.side = self._sides(known)

    def row(self, component, given):
        s0 = 0.5 - 0.5 * dr.norm(given.xy)
        return component * self.cells + clamped_index(s0 * self.cells, max(self.cells // 2, 1))

    def value(self, leaves, component, given, other, active):
        c, s = azimuth(-given.xy)
        turned = mi.Point2f(c * other.x + s * other.y, c * other.y - s * other.x)
        code = square_code(turned, self.depth)
        return self.value_at(leaves, component, given, code, active)

    def value_at(self, leaves, component, given, code, active):
        """BSDF f [1/sr] in the outgoing square with the Morton code `code`."""
        entry, filled = self.rows.find(self.row(component, given), code, active)
        leaf = dr.gather(mi.UInt32, self.rows.leaf, entry, filled)
        return dr.gather(mi.Float, leaves, leaf, filled)

    def draw(self, row, given, u, uv, active):
        p = self._point(row, u, uv, active)
        c, s = azimuth(-given.xy)
        return upper(mi.Point2f(c * p.x - s * p.y, s * p.x + c * p.y))


class TurnedLobes(OutSquares):
    """Lobes of tensor trees of rank 3, some of which have the outgoing direction given.

    For a given outgoing direction, the incident directions of one radius lie on a circle of the
    disk, which the map to the square turns into the perimeter of a square: four sides at distance
    a from the centre, with t from −a to a along each. The perimeter crosses the same cells for all
    outgoing radii of one cell, except that it ends within the cell at each corner. A row therefore
    lists (incident radius, side, cell along the side); only directions in a corner are drawn with
    a weight other than 1, between 0 and 2.

    Parameters
    ----------
    trees : list of TensorTree or None
        One tree per component, None where missing; its values are the numbers of the leaves.
    turned : list of bool
        True for the components whose given direction is the tree's outgoing one.
    """

    out_depth = OUT_DEPTH
    out_even = False

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
            covered = np.clip(a - np.abs(t) + 1 / n, 0, 2 / n)  # length of t in the cell
            low, high = 1 - 2 * (i + 1) / n, 1 - 2 * i / n
            weight = (high**2 - low**2) / 2 * np.pi / 4 * covered / a
            row, number = component * half + k, (i * 4 + side) * n + j
            parts.append([x.ravel() for x in (row, leaf.astype(int), number, weight)])
        joined = [np.concatenate(x) for x in zip(*parts, strict=True)]
        self.rows = Rows.of(*joined, rows=len(trees) * half)

    def update(self, values: np.ndarray) -> None:
        """Set the values f [1/sr] of the leaves, shape (leaf,)."""
        self.exact.update(values)
        self.rows.update(values)

    def row(self, component, given):
        """Number of the row of a component and a given direction; turned trees' rows come last."""
        turned = dr.gather(mi.Bool, self.turned, component)
        row = self.first_turned + component * (self.n // 2) + self._cell(given)
        return dr.select(turned, row, self.exact.row(component, given))

    def _split(self, row, active):
        """Mask of the rows that belong to turned trees, and their numbers among these rows."""
        turned = row >= self.first_turned
        return turned & active, dr.select(turned, row - self.first_turned, 0)

    def albedo(self, row, active):
        """Integral of f cos θ over the other direction [1], at the middle of the row's cell."""
        turned, own = self._split(row, active)
        straight = self.exact.albedo(dr.select(turned, 0, row), active & ~turned)
        return dr.select(turned, dr.gather(mi.Float, self.rows.albedo, own, turned), straight)

    def value(self, leaves, component, given, other, active):
        """BSDF f [1/sr] of a component for the given and the other direction."""
        turned = dr.gather(mi.Bool, self.turned, component)
        straight = self.exact.value(leaves, component, given, other, active & ~turned)
        # The row's own cell: rounding cannot put value and row on two sides of a border.
        a, side, t = self._perimeter(given, other)
        x = dr.select(side == 0, a, dr.select(side == 1, -t, dr.select(side == 2, -a, t)))
        y = dr.select(side == 0, t, dr.select(side == 1, a, dr.select(side == 2, -t, -a)))
        n = 1 << self.exact.depth
        i, j = (clamped_index((c + 1) / 2 * n, n) for c in (x, y))
        code = spread(i) | (spread(j) << 1)
        back = self.exact.value_at(leaves, component, other, code, active & turned)
        return dr.select(turned, back, straight)

    def _cell(self, given):
        """Number of the cell that holds the outgoing radius."""
        half = self.n // 2
        return clamped_index(dr.norm(given.xy) * half, half)

    def _perimeter(self, given, other):
        """Middle of the row's cell (a), number of the side, and position t along the side."""
        middle = (2 * mi.Float(self._cell(given)) + 1) / self.n
        c, s = azimuth(-other.xy)
        phi = dr.atan2(c * given.y - s * given.x, c * given.x + s * given.y) / (dr.pi / 2)
        side = dr.round(phi)
        t = (phi - side) * 2 * dr.norm(given.xy)
        return middle, mi.UInt32(mi.Int32(side) + 4) % 4, t

    def draw(self, row, given, u, uv, active):
        """Other direction (z ≥ 0), drawn from a row."""
        turned, own = self._split(row, active)
        straight = self.exact.draw(dr.select(turned, 0, row), given, u, uv, active & ~turned)
        entry, filled = self.rows.draw(own, u, turned)
        number = dr.gather(mi.UInt32, self.rows.code, entry, filled)
        j, side, i = number % self.n, number // self.n % 4, number // (4 * self.n)
        inner = 1 - 2 * (mi.Float(i) + 1) / self.n
        r = dr.sqrt(dr.lerp(dr.square(inner), dr.square(inner + 2 / self.n), uv.x))
        a = dr.norm(given.xy)
        low = dr.maximum(2 * mi.Float(j) / self.n - 1, -a)
        high = dr.minimum(2 * (mi.Float(j) + 1) / self.n - 1, a)
        phi = self._angle(mi.Float(side), dr.lerp(low, high, uv.y), a)
        sin, cos = dr.sincos(phi)
        c, s = azimuth(given.xy)
        p = mi.Point2f(c * cos + s * sin, s * cos - c * sin)  # turned back by φ
        return dr.select(turned, upper(-r * p), straight)

    @staticmethod
    def _angle(side, t, a):
        """Azimuth [rad] of the perimeter's point at t along a side."""
        return dr.pi / 2 * side + dr.pi / 4 * t / dr.maximum(a, 1e-9)

    def density(self, row, given, other, value, active):
        """Probability density of the other direction per projected solid angle [1/sr]."""
        turned, _ = self._split(row, active)
        a = dr.norm(given.xy)
        middle, _, t = self._perimeter(given, other)
        corner = middle - 1 / self.n
        # In a corner cell, the side is as long as the part of the cell within the radius.
        covered = dr.select(dr.abs(t) > corner, 1 / (self.n * dr.maximum(a - corner, 1e-6)), 1)
        scale = dr.select(turned, covered * a / middle, 1)
        albedo = self.albedo(row, active)
        return dr.select(albedo > 0, scale * value / albedo, 0)
