"""Doubts about the state that a façade takes, as intervals of hours of glare have them.

The shade closes by the direct sun on the sensors, whose noise leaves a few hours in doubt. Draws of
DGP take, in these hours, the state of a draw of the direct sun.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


def draws_of(replicates: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Draws (hour, draw) of values by replicates (replicate, hour) and their weights."""
    mean = replicates.mean(axis=0)
    return np.asarray(mean[:, None] + (replicates - mean).T @ weights)


class StateDoubts(NamedTuple):
    """Other states that the façade may take in some hours of the state `applied`."""

    hours: np.ndarray
    """Time stamps whose state differs between draws, indices, shape (hour,)."""
    drawn: np.ndarray
    """Number of the other state that each draw takes, from 1; 0 for the one applied, shape (hour,
    draw)."""
    replicates: np.ndarray
    """DGP in the other states by each replicate, float32, shape (replicate, other, hour, view)."""

    def in_drawn_states(
        self, values: np.ndarray, counted: np.ndarray, view: int, weights: np.ndarray
    ) -> np.ndarray:
        """DGP of a view in the state of each draw, shape (counted, draw).

        Parameters
        ----------
        values : np.ndarray, shape (counted, draw)
            Draws of DGP in the state applied.
        counted : np.ndarray of int, shape (counted,)
            Their time stamps.
        view : int
        weights : np.ndarray, shape (replicate, draw)
            Weights of the replicates in each draw.
        """
        kept = np.isin(self.hours, counted)
        row, number = np.searchsorted(counted, self.hours[kept]), self.drawn[kept]
        out = values.copy()
        for k, each in enumerate(np.moveaxis(self.replicates[..., kept, view], 1, 0), 1):
            out[row] = np.where(number == k, draws_of(each, weights), out[row])
        return out
