"""Variable resolution: sibling cells of a full tree become one leaf where that loses little.

A leaf takes the mean of its cells, so every sum over whole leaves stays as it was: the total over
all pairs of directions, and the hemispherical values averaged over the incident cells of a leaf.
"""

from __future__ import annotations

import numpy as np
from drcmitsuba_plugins.tensor import TensorTree

SIGNIFICANT = 2.0
"""Siblings differ where their χ² exceeds its mean by more than this many standard deviations."""


def _alike(children: np.ndarray, mean: np.ndarray, unit: float, cells: int) -> np.ndarray:
    """Whether siblings, each a mean over `cells` cells, differ no more than ray counts do.

    With one ray adding `unit` to a cell, a cell of mean m has the variance m·unit, and
    χ² = Σ (xᵢ − m)² · cells / (m · unit) is on average the number of siblings less one.
    """
    spread = ((children - mean[:, None]) ** 2).sum(axis=1) * cells
    freedom = children.shape[1] - 1
    limit = freedom + SIGNIFICANT * np.sqrt(2 * freedom)
    return spread <= limit * mean * unit


def merge(
    tree: TensorTree, *, percent: float = 90.0, unit: float = 0.0, tolerance: float = 0.0
) -> TensorTree:
    """Merge the leaves of a full tree.

    Parameters
    ----------
    tree : TensorTree
        Full: all leaves at its depth (`TensorTree.of_grid`).
    percent : float
        Least part of all possible merges that is made [%]. Blocks of siblings with the smallest
        range of values, down to the finest cells, merge first, as in `rttree_reduce`.
    unit : float
        Value that one ray adds to a cell [1/sr]. Siblings that differ no more than counts of rays
        do by chance (χ²) are merged, too; 0 omits this test.
    tolerance : float
        Cells that differ by at most this fraction of their mean are merged, too.

    Returns
    -------
    TensorTree
        Tree of the same depth and the same mean.
    """
    siblings = 1 << tree.rank
    mean = low = high = tree.value
    means, ranges, alike = [mean], [], []
    for level in range(tree.depth - 1, -1, -1):
        children = mean.reshape(-1, siblings)
        mean = children.mean(axis=1)
        low = low.reshape(-1, siblings).min(axis=1)
        high = high.reshape(-1, siblings).max(axis=1)
        means.append(mean)
        ranges.append(high - low)
        cells = siblings ** (tree.depth - level - 1)
        alike.append(_alike(children, mean, unit, cells) | (high - low <= tolerance * mean))
    if not ranges:
        return tree
    every = np.sort(np.concatenate(ranges))
    wanted = int(np.ceil(len(every) * percent / 100))
    threshold = every[wanted - 1] if wanted else 0.0  # equal siblings always merge
    whole = [np.ones(len(tree), bool)]
    for spread, chance in zip(ranges, alike, strict=True):
        below = whole[-1].reshape(-1, siblings).all(axis=1)
        whole.append(below & ((spread <= threshold) | chance))
    start, levels, values = [], [], []
    for up, (mean, is_whole) in enumerate(zip(means, whole, strict=True)):
        above = np.repeat(whole[up + 1], siblings) if up < tree.depth else np.zeros(1, bool)
        kept = np.flatnonzero(is_whole & ~above)
        start.append(kept << tree.rank * up)
        levels.append(np.full(len(kept), tree.depth - up))
        values.append(mean[kept])
    order = np.argsort(np.concatenate(start))
    joined = (np.concatenate(part)[order] for part in (start, levels, values))
    return TensorTree(tree.rank, tree.depth, *joined)
