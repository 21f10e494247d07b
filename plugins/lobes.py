"""Lobes of a measured BSDF: values, and directions drawn in proportion to f cos θ.

One of the two directions is given. The classes differ in how directions are cut into cells: squares
of a tensor tree of rank 4, Klems' patches, or, for isotropic trees, radius and relative azimuth.
All take directions in the file's frame (+z to the room, +y up), pointing away from the pane.
"""

from __future__ import annotations

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.klems_basis import KlemsBasis, KlemsMatrix
from drcmitsuba_plugins.rows import Rows, of_matrices, of_trees
from drcmitsuba_plugins.tensor import TensorTree

DEFENSIVE = 0.05
"""Share of cosine-distributed directions that keeps weights bounded where a table is a mean."""

GRAZED = 0.25
"""Weight of the largest value in such a mean."""


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

    Such a tree knows its lobes by the incident direction only. Values are exact; directions are
    drawn from a table of means over both radii and the relative azimuth, mixed with a share of
    cosine-distributed directions that keeps the weights bounded.

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
        fine = min(64, 1 << self.exact.depth)
        self.components, self.cells, self.azimuths = len(trees), 4 * fine, 8 * fine
        self.radii = max(1, fine // 2)  # just the cells of a turned tree

    def update(self, values: np.ndarray) -> None:
        """Take over new values of the leaves."""
        self.exact.update(values)
        per_row = self.radii * self.azimuths
        rows = self.components * self.cells
        means = self._means(mi.Float(values.astype(np.float32)), rows * per_row)
        code = np.arange(per_row)
        weight = np.pi * (2 * (code // self.azimuths) + 1) / self.radii**2 / self.azimuths
        self.table = Rows.regular(rows, weight)
        self.table.update(means.numpy().astype(float))
        self.mean = means

    def _means(self, leaves, size: int):
        """F over component, given radius, other radius and azimuth: part mean, part maximum.

        The maximum remembers cells of the tree that a cell of the table merely grazes.
        """
        at = dr.arange(mi.UInt32, size)
        sector = mi.Float(at % self.azimuths)
        ring = mi.Float(at // self.azimuths % self.radii)
        row = at // (self.azimuths * self.radii)
        bin_, component = mi.Float(row % self.cells), row // self.cells
        total, most = mi.Float(0), mi.Float(0)
        offsets = (0.05, 0.35, 0.65, 0.95)
        r = (ring + 0.5) / self.radii
        for a, c in itertools.product(offsets, repeat=2):
            given = mi.Vector3f(-(bin_ + a) / self.cells, 0, 1)
            sin, cos = dr.sincos(dr.two_pi / self.azimuths * (sector + c))
            f = self.value(
                leaves, component, given, mi.Vector3f(r * cos, r * sin, 1), mi.Bool(True)
            )
            total, most = total + f, dr.maximum(most, f)
        result = (1 - GRAZED) * total / len(offsets) ** 2 + GRAZED * most
        dr.eval(result)
        return result

    def row(self, component, given):
        """Row of a component and a direction that is given."""
        r = dr.norm(given.xy)
        return component * self.cells + mi.UInt32(dr.clip(r * self.cells, 0, self.cells - 1))

    def albedo(self, row, active):
        """Integral of f cos θ over the other direction, about: it weighs the lobes."""
        return dr.gather(mi.Float, self.table.albedo, row, active)

    def value(self, leaves, component, given, other, active):
        """BSDF f [1/sr]; `component` names which."""
        turned = dr.gather(mi.Bool, self.turned, component)
        incident, outgoing = dr.select(turned, other, given), dr.select(turned, given, other)
        return self.exact.value(leaves, component, incident, outgoing, active)

    def draw(self, row, given, u, uv, active):
        """Other direction (its z positive), drawn from a row."""
        evenly = u < DEFENSIVE
        u = dr.select(evenly, 0, (u - DEFENSIVE) / (1 - DEFENSIVE))
        entry, _ = self.table.draw(row, u, active)
        code = entry % (self.radii * self.azimuths)
        ring = mi.Float(code // self.azimuths)
        r = dr.sqrt(dr.square(ring) + uv.x * (2 * ring + 1)) / self.radii  # even over the area
        sector = mi.Float(code % self.azimuths) + uv.y
        sin, cos = dr.sincos(dr.two_pi / self.azimuths * sector)
        c, s = _azimuth(-given.xy)
        p = mi.Point2f(r * (c * cos - s * sin), r * (s * cos + c * sin))
        return _upper(dr.select(evenly, mi.warp.square_to_uniform_disk_concentric(uv), p))

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

    def density(self, row, given, other, value, active):
        """Probability of the other direction per projected solid angle [1/sr]."""
        ring = mi.UInt32(dr.clip(dr.norm(other.xy) * self.radii, 0, self.radii - 1))
        c, s = _azimuth(-given.xy)
        phi = dr.atan2(c * other.y - s * other.x, c * other.x + s * other.y) * dr.inv_two_pi
        phi = dr.select(phi < 0, phi + 1, phi)
        sector = mi.UInt32(dr.clip(phi * self.azimuths, 0, self.azimuths - 1))
        at = (row * self.radii + ring) * self.azimuths + sector
        albedo = self.albedo(row, active)
        drawn = dr.gather(mi.Float, self.mean, at, active) / dr.select(albedo > 0, albedo, 1)
        return dr.select(albedo > 0, (1 - DEFENSIVE) * drawn + DEFENSIVE * dr.inv_pi, 0)
