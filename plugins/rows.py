"""Conditional distributions of a measured BSDF, one row for each cell of the fixed direction.

One direction of a pair is given and selects the row; the other is looked up or drawn. A row lists
the cells of the other direction, the file's leaf of each, and the running sum of f times projected
solid angle. A draw is one binary search, and its density is exactly f cos θ / albedo. The rows of
all components (transmission and reflection, both sides) follow each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.klems_basis import KlemsBasis, KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree

MOST_ENTRIES = 1 << 25
"""Largest number of cells in all rows together: two full trees of rank 4 and depth 6."""


@dataclass
class Rows:
    """Rows of cells, stored one after the other.

    Parameters
    ----------
    first : mi.UInt32, shape (row + 1,)
        First entry of every row.
    leaf : mi.UInt32, shape (entry,)
        Number of the cell's leaf in the file.
    code : mi.UInt32, shape (entry,)
        Morton code or number of the other direction's cell, ascending in a row.
    weight : np.ndarray, shape (entry,)
        Projected solid angle of every cell [sr].
    steps : int
        Number of halvings of a binary search in the longest row.
    sum : mi.Float, shape (entry,)
        Running sum of f · weight [1] in a row.
    albedo : mi.Float, shape (row,)
        Sum of f · weight [1] of the whole row.
    """

    first: mi.UInt32
    leaf: mi.UInt32
    code: mi.UInt32
    weight: np.ndarray
    steps: int
    sum: mi.Float | None = None
    albedo: mi.Float | None = None

    @classmethod
    def of(
        cls, row: np.ndarray, leaf: np.ndarray, code: np.ndarray, weight: np.ndarray, rows: int
    ) -> Rows:
        """Rows of unsorted entries; the first four arrays have one value per entry."""
        order = np.lexsort((code, row))
        first = np.searchsorted(row[order], np.arange(rows + 1))
        longest = int(np.diff(first).max(initial=1))
        return cls(
            first=mi.UInt32(first.astype(np.uint32)),
            leaf=mi.UInt32(leaf[order].astype(np.uint32)),
            code=mi.UInt32(code[order].astype(np.uint32)),
            weight=weight[order],
            steps=max(1, int(longest - 1).bit_length()),
        )

    def update(self, values: np.ndarray) -> None:
        """Sum the rows anew for values f [1/sr] of the leaves, shape (leaf,)."""
        first = self.first.numpy()
        running = np.concatenate([[0], np.cumsum(values[self.leaf.numpy()] * self.weight)])
        start = running[first[:-1]]
        own = running[1:] - np.repeat(start, np.diff(first))
        self.sum = mi.Float(own.astype(np.float32))
        self.albedo = mi.Float((running[first[1:]] - start).astype(np.float32))

    def _search(self, row, is_above, active):
        """First entry of a row for which `is_above(entry)` holds; the last if there is none."""
        low = dr.gather(mi.UInt32, self.first, row, active)
        high = dr.gather(mi.UInt32, self.first, row + 1, active)
        active = active & (high > low)
        last = dr.select(active, high - 1, low)
        high = last
        for _ in range(self.steps):
            middle = (low + high) >> 1
            above = is_above(middle, active)
            low = dr.select(above, low, dr.minimum(middle + 1, last))
            high = dr.select(above, middle, high)
        return low, active

    def find(self, row, code, active):
        """Entry that holds the cell with Morton code (or number) `code`; mask of filled rows."""

        def above(entry, active):
            # The last entry whose code is not above `code` holds it.
            following = dr.minimum(entry + 1, dr.width(self.code) - 1)
            return dr.gather(mi.UInt32, self.code, following, active) > code

        return self._search(row, above, active)

    def draw(self, row, u, active):
        """Entry of a row, drawn with probability f · weight / albedo; mask of filled rows."""
        target = u * dr.gather(mi.Float, self.albedo, row, active)
        return self._search(
            row, lambda entry, on: dr.gather(mi.Float, self.sum, entry, on) > target, active
        )


def of_trees(trees: list[TensorTree | None], fixed: str, depth: int) -> Rows:
    """Rows of trees of rank 4 (either direction fixed) or 3 (the incident one).

    Row c · cells + k belongs to component c and to the finest cell k of the fixed direction. A
    tree's values are the numbers of its leaves.

    Raises
    ------
    ValueError
        The rows have more than `MOST_ENTRIES` cells together.
    """
    axes = max((t.rank for t in trees if t is not None), default=4) - 2
    cells = 1 << axes * depth
    parts, total = [], 0
    for component, tree in enumerate(trees):
        if tree is None:
            continue
        a, b = tree.incident_cells(), tree.outgoing_cells()
        if fixed == "outgoing":
            a, b = b, a
        a, b = a << axes * (depth - tree.depth), b << 2 * (depth - tree.depth)
        for level in np.unique(tree.level):
            mine = np.flatnonzero(tree.level == level)
            span = 1 << axes * (depth - int(level))
            total += len(mine) * span
            if total > MOST_ENTRIES:
                raise ValueError("the tree is too fine to be sampled; reduce it (rttree_reduce)")
            row = (component * cells + a[mine, None] + np.arange(span)).ravel()
            leaf = np.repeat(tree.value[mine].astype(np.int64), span)
            weight = np.full(len(leaf), np.pi / 4.0 ** int(level), np.float32)
            numbers = (a.astype(np.uint32) for a in (row, leaf, np.repeat(b[mine], span)))
            parts.append((*numbers, weight))
    row, leaf, code, weight = (np.concatenate(x) for x in zip(*parts, strict=True))
    return Rows.of(row, leaf, code, weight, len(trees) * cells)


def of_matrices(matrices: list[KlemsMatrix | None], fixed: str, basis: KlemsBasis) -> Rows:
    """Rows of matrices over one basis, one entry per patch; the values are the leaves' numbers."""
    n = len(basis)
    parts = []
    for component, matrix in enumerate(matrices):
        if matrix is None:
            continue
        outgoing, incident = (a.ravel() for a in np.indices((n, n)))
        a, b = (incident, outgoing) if fixed == "incident" else (outgoing, incident)
        leaf = matrix.value.astype(np.int64).ravel()
        parts.append((component * n + a, leaf, b, basis.projected_solid_angle[b]))
    row, leaf, code, weight = (np.concatenate(x) for x in zip(*parts, strict=True))
    return Rows.of(row, leaf, code, weight, len(matrices) * n)
