"""Draws by how far they move an entry: most of them move none over a few standard errors.

E* − Ē = Σ_r w_r (E_r − Ē) is at most |w − w̄| · |E_r − Ē|, the inequality of Cauchy and Schwarz: its
`reach` in standard errors is the length of the weights. An entry farther from its threshold is on
the side of its mean in that draw. So few entries need all draws, and most the farthest alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.metrics.intervals.rules import DRAWS

FEWER = (DRAWS, 440, 304, 200, 120, 40)
"""Numbers of draws that entries are told apart by: those that reach farthest; multiples of eight,
see `bootstrap_counts.sums`."""
MARGIN = 1e-4
"""Share of its distance by which an entry counts as nearer: beyond the rounding of the draws."""


@dataclass(frozen=True)
class Reach:
    """Draws by their reach, the farthest first."""

    order: np.ndarray
    """Numbers of the draws, int, shape (draw,)."""
    limits: np.ndarray
    """Largest reach of the draws that come after each of `FEWER` but the first, in standard errors,
    shape (level,)."""

    @classmethod
    def of(cls, weights: np.ndarray, others: np.ndarray | None) -> Reach:
        """Sort the draws.

        `weights` (replicate, draw) are those of the replicates' differences from their mean,
        `others` (group, draw) those of the errors that no replicate holds, where there are any.
        """
        n = len(weights)
        squares = n * (n - 1) * ((weights - weights.mean(axis=0)) ** 2).sum(axis=0, dtype=float)
        if others is not None:
            squares += (others**2).max(axis=0)
        order = np.argsort(-squares, kind="stable")
        return cls(order, np.sqrt(squares[order[list(FEWER[1:])]]))

    def levels(self, missing: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Level of entries, which are on the side of their means in all draws after `FEWER[level]`.

        `missing` is the distance from the threshold, `error` the standard error [lx], shape
        (entry,) each.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (1 - MARGIN) * np.abs(missing) / error
        far[missing == 0] = 0  # as far as an entry without an error lies
        return np.searchsorted(self.limits, far, side="right")
