"""A composition of a searched façade with its scores, smooth and hard, and their gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.design.measure import RatedCandidate, Score
from drcmitsuba.design.slopes import LaterSlopes

MIXED = 0.01
"""Share of a tile by which it counts as one of several materials [–]."""
EQUAL = 1e-3
"""Objectives within EQUAL are one where areas are compared: in single precision they differ [%]."""


@dataclass(frozen=True)
class FacadeScore(Score):
    """One composition in numbers, with the areas of the film and of all panes [m²].

    `margin` is how far a hard aim lies above the least one [%]; None without one. `glare` is the
    share of the hours with glare at the worst eye [%]; None where it is not asked for.
    """

    film_area: float
    window_area: float
    margin: float | None = None
    glare: float | None = None

    @property
    def holds_aim(self) -> bool:
        """Whether the aim is at least as high as it has to be."""
        return self.margin is None or self.margin >= 0

    @property
    def rank(self) -> tuple[float, ...]:
        """Sort key: objective; with a least aim, what lacks, then area, then what is left over."""
        if self.margin is None:
            return super().rank
        return min(self.margin, 0.0), EQUAL * round(self.value / EQUAL), self.margin


UNKNOWN = FacadeScore(*[np.nan] * 5)
"""Smooth numbers of a design of which hard ones alone were computed."""


@dataclass(frozen=True, eq=False)
class FacadeCandidate(RatedCandidate):
    """One composition with its scores and gradients.

    Parameters
    ----------
    share : np.ndarray, shape (tile, material)
        Composition.
    slopes : LaterSlopes
        Gradients by x, which are computed when they are first asked for: a step that a search
        rejects needs none. None where hard numbers alone were computed.
    """

    smooth: FacadeScore
    hard: FacadeScore
    share: np.ndarray
    slopes: LaterSlopes | None

    @property
    def _slopes(self) -> dict[str, np.ndarray]:
        """Gradients by name."""
        assert self.slopes is not None
        return self.slopes.of

    @property
    def gradient(self) -> np.ndarray:
        """Derivatives of the smooth objective [%], shape (free,)."""
        return self._slopes["value"]

    @property
    def ase_gradient(self) -> np.ndarray:
        """Derivatives of the smooth ASE [%], shape (free,)."""
        return self._slopes["ase"]

    @property
    def area_gradient(self) -> np.ndarray:
        """Derivatives of the panes' area [m²], shape (free,)."""
        return self._slopes["area"]

    @property
    def aim_gradient(self) -> np.ndarray | None:
        """Derivatives of the smooth aim [%], shape (free,); None where it is the objective."""
        return self._slopes.get("aim")

    @property
    def glare_gradient(self) -> np.ndarray | None:
        """Derivatives of the smooth hours with glare [%]; None where these are not asked for."""
        return self._slopes.get("glare")

    @property
    def mixed(self) -> int:
        """Number of tiles of several materials, more than `MIXED` of which is not the largest."""
        return int(np.count_nonzero(self.share.max(axis=1) < 1 - MIXED))
