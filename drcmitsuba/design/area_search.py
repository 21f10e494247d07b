"""The last steps to the least area, by hard numbers: as near to none as the conditions hold."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from drcmitsuba.design.candidate import EQUAL, FacadeCandidate
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.search import History
from drcmitsuba.runtime.progress import Progress

FacadeHistory: TypeAlias = History[FacadeProblem, FacadeCandidate]
HALVINGS = 10
"""Bisections of the way to no area."""
ROUNDS = 3
"""Largest number of rounds: a smaller pane may let a shade open, so that another may shrink."""
SINGLE = 8
"""Largest number of free values of which each is bisected by itself; of more, each may go only."""


def lower_area(history: FacadeHistory, progress: Progress) -> None:
    """Take area from the best façade while it holds: all values together, then one by one.

    Nothing is done where no façade holds.
    """
    problem = history.problem
    if not problem.holds(history.best()):
        return
    each = HALVINGS if problem.size <= SINGLE else 0
    for done in range(ROUNDS):
        before = history.best()
        _lower(history, np.arange(problem.size), HALVINGS)
        for axis in range(problem.size):
            _lower(history, np.array([axis]), each)
        progress((done + 1) / ROUNDS)
        if history.best() is before:
            break


def _none(candidate: FacadeCandidate) -> np.ndarray:
    """Values (free,) of no area; those on which the area does not depend stay."""
    x, slope = candidate.x, candidate.gradient
    return np.where(slope < -EQUAL, 0.0, np.where(slope > EQUAL, 1.0, x))


def _lower(history: FacadeHistory, axes: np.ndarray, halvings: int) -> None:
    """Move some values of the best façade to no area, or by bisection as near as it holds."""
    start = history.best()
    way = np.zeros_like(start.x)
    way[axes] = (_none(start) - start.x)[axes]

    def holds(part: float) -> bool:
        candidate = history.evaluate(start.x + part * way, "least area", start.sharpness)
        return history.problem.holds(candidate)

    if not way.any() or holds(1.0):
        return
    near, far = 0.0, 1.0
    for _ in range(halvings):
        middle = (near + far) / 2
        near, far = (middle, far) if holds(middle) else (near, middle)
