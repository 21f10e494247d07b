"""Straight-through peaks: the part of a BSDF that is a view through the pane.

A file of finite resolution spreads undeviated light over the cell that holds its direction. Where
that cell stands out from its neighbours, the excess is taken out of the BSDF and becomes a
transmittance of the undeviated ray, as Radiance's aBSDF does, so that sun and view stay sharp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from drcmitsuba_plugins.klems_basis import KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree, morton, unpack

RATIO = 1.5
"""A cell is a peak if its value exceeds this many times its neighbours' mean, as in Radiance."""
LEAST_SHARE = 0.02
"""A peak with less than this share of the transmitted light is noise or the flank of a lobe."""


@dataclass(frozen=True)
class Split:
    """A transmission component and its straight-through part.

    Parameters
    ----------
    rest : TensorTree or KlemsMatrix
        The component without its peak.
    through : np.ndarray, shape (incident cell,)
        Transmittance of the undeviated ray for every finest incident cell or patch.
    share : float
        Fraction of the transmitted light that goes straight through, mean over all incidences.
    """

    rest: TensorTree | KlemsMatrix
    through: np.ndarray
    share: float

    @property
    def stands_out(self) -> bool:
        """True if the peak's share is above noise."""
        return self.share >= LEAST_SHARE


def split(component: TensorTree | KlemsMatrix) -> Split:
    """Take the straight-through peak out of a transmission component.

    Parameters
    ----------
    component : TensorTree or KlemsMatrix

    Returns
    -------
    Split
    """
    if isinstance(component, KlemsMatrix):
        rest, through = _of_matrix(component)
        weight = component.incident.projected_solid_angle
    elif component.rank == 4:
        rest, through = _of_tree(component)
        weight = np.ones(len(through))
    else:
        rest, through = _of_isotropic_tree(component)
        # Rings of equal width: their area grows with the radius; the unused half has no area.
        radius = 1 - 2 * (np.arange(len(through)) + 0.5) / max(len(through), 2)
        weight = np.maximum(radius, 0)
    total = float(weight @ component.albedos())
    return Split(rest, through, float(weight @ through) / total if total > 0 else 0.0)


def _excess(value: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Difference f − neighbours' f [1/sr] of cells; 0 where a cell does not stand out."""
    above = value > RATIO * around
    return np.where(above, value - np.where(above, around, 0), 0.0)


def _of_matrix(matrix: KlemsMatrix) -> tuple[KlemsMatrix, np.ndarray]:
    """Rest and straight transmittance of a matrix; undeviated light keeps its patch number."""
    basis = matrix.outgoing
    if matrix.incident is not basis:
        return matrix, np.zeros(len(matrix.incident))
    solid_angle = basis.projected_solid_angle
    radius = 2 * np.sqrt(solid_angle / np.pi)
    turn = np.arange(8) * np.pi / 4
    xy = basis.centres[:, None, :2] + radius[:, None, None] * np.stack(
        [np.cos(turn), np.sin(turn)], axis=-1
    )
    inside = np.hypot(*np.moveaxis(xy, -1, 0)) < 1
    z = np.sqrt(np.maximum(0, 1 - (xy**2).sum(axis=-1)))
    near = basis.patch(xy[..., 0], xy[..., 1], z)
    own = np.arange(len(basis))
    counts = inside & (near != own[:, None])
    values = np.where(counts, matrix.value[near, own[:, None]], 0).sum(axis=1)
    excess = _excess(matrix.value[own, own], values / np.maximum(counts.sum(axis=1), 1))
    value = matrix.value.copy()
    value[own, own] -= excess
    return replace(matrix, value=value), excess * solid_angle


def _around(tree: TensorTree, points: list[np.ndarray], steps: Sequence[tuple[float, ...]]):
    """Mean f [1/sr] of the neighbours of points inside the cube; ∞ where there are none."""
    total, count = np.zeros(len(points[0])), np.zeros(len(points[0]))
    for step in steps:
        q = [p + s for p, s in zip(points, step, strict=True)]
        inside = np.all([(x > 0) & (x < 1) for x in q], axis=0)
        leaf = np.searchsorted(tree.start, morton(q, tree.depth), "right") - 1
        total += np.where(inside, tree.value[leaf], 0)
        count += inside
    return np.where(count > 0, total / np.maximum(count, 1), np.inf)


_RING = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


def _of_tree(tree: TensorTree) -> tuple[TensorTree, np.ndarray]:
    """Rest and straight transmittance, rank 4: undeviated light keeps its cell (the diagonal)."""
    cells = tree.incident_cells()
    through = np.zeros(1 << 2 * tree.depth)
    value = tree.value.copy()
    diagonal = cells == tree.outgoing_cells()
    for level in np.unique(tree.level[diagonal]):
        mine = np.flatnonzero(diagonal & (tree.level == level))
        side = 0.5 ** int(level)
        corner = unpack(cells[mine], 2, tree.depth)
        centre = [c / (1 << tree.depth) + side / 2 for c in corner]
        steps = [(0.0, 0.0, i * side, j * side) for i, j in _RING]
        excess = _excess(value[mine], _around(tree, centre + centre, steps))
        value[mine] -= excess
        span = 1 << 2 * (tree.depth - int(level))
        covered = (cells[mine, None] + np.arange(span)).ravel()
        through[covered] = np.repeat(excess * np.pi * side**2, span)
    return replace(tree, value=value), through


def _of_isotropic_tree(tree: TensorTree) -> tuple[TensorTree, np.ndarray]:
    """Rest and straight transmittance, rank 3: undeviated light lies on the border of two cells."""
    n = 1 << tree.depth
    through = np.zeros(n)
    value = tree.value.copy()
    excesses = []
    for cell in range(n // 2):
        s0 = np.array([(cell + 0.5) / n])
        leaves = [
            int(np.searchsorted(tree.start, morton([s0, 1 - s0, s2], tree.depth)[0], "right")) - 1
            for s2 in (np.array([0.5 - 1e-9]), np.array([0.5 + 1e-9]))
        ]
        side = 0.5 ** int(tree.level[leaves].min())
        steps = [(0.0, i * side, j * side) for i in (-1, 0, 1) for j in (-1.5, -0.5, 0.5, 1.5)]
        steps = [s for s in steps if s[1] != 0 or abs(s[2]) > side]
        around = _around(tree, [s0, 1 - s0, np.array([0.5])], steps)
        excesses += [
            (cell, i, e) for i, e in zip(leaves, _excess(value[leaves], around), strict=True)
        ]
    # A leaf that spans several incident cells loses the same amount to each.
    if not excesses:
        return tree, through
    cells, leaf, excess = (np.array(a) for a in zip(*excesses, strict=True))
    times = np.maximum(np.bincount(leaf, minlength=len(value)), 1)
    mean = np.bincount(leaf, excess, len(value)) / times
    value -= mean
    np.add.at(through, cells, mean[leaf] * np.pi / 4.0 ** tree.level[leaf])
    return replace(tree, value=value), through
