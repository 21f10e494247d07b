"""Search for the best tilt of lamellae in few simulations: a coarse grid, then sections.

Every simulation is dear, and there is one number to find. So no gradients are followed: a golden
section [1]_ asks only which of two tilts is the better one, by the smooth objective among those
that hold the limit of ASE. What is found is the best of all by the hard numbers, its neighbours
among them, which tell the slope there.

References
----------
.. [1] J. Kiefer, "Sequential minimax search for a maximum", Proc. AMS 4, 1953.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from drcmitsuba.design.history import History
from drcmitsuba.design.measure import Evaluation
from drcmitsuba.design.optimise import SHARPNESS, Optimum
from drcmitsuba.design.tilt import Turned
from drcmitsuba.runtime.progress import Progress, part

GRID = 5
"""Tilts to begin with, beside the case's own."""
WALKS = 5
"""Steps to a neighbour that is the better one by hard numbers, at most."""
SECTION = (3 - math.sqrt(5)) / 2
"""Of the wider side of an interval: the golden section."""

TiltOptimum: TypeAlias = Optimum[Turned, Evaluation]


def turn(
    problem: Turned, sharpness: float = SHARPNESS[-1], progress: Progress = lambda share: None
) -> TiltOptimum:
    """Find the best tilt to within the problem's step.

    Parameters
    ----------
    problem : Turned
    sharpness : float
        Of the smooth twins.
    progress : callable
        Told the share that is done.

    Returns
    -------
    Optimum
        Stopped by Ctrl-C, the best so far.

    Raises
    ------
    KeyboardInterrupt
        It was stopped before anything was evaluated.

    Notes
    -----
    Limits: a maximum that is narrower than the grid, ⅙ of the bounds apart or so, may be missed.
    """
    history: History[Turned, Evaluation] = History(problem)
    low, high = problem.tilt.low, problem.tilt.high
    start = round(problem.tilt.start, 4)
    even = np.linspace(low, high, GRID).round(4).tolist()
    grid = sorted([start, *(tilt for tilt in even if abs(tilt - start) >= problem.step)])
    widest = max(b - a for a, b in zip(grid[:-2], grid[2:], strict=True))
    sections = math.log(2 * problem.step / widest) / math.log(1 - SECTION)
    total = len(grid) + math.ceil(max(sections, 0)) + 2

    def at(tilt: float, label: str) -> Evaluation:
        done = len(problem.known)
        problem.simulate(tilt, part(progress, *(min(1, n / total) for n in (done, done + 1))))
        return history.evaluate(problem.free(tilt), sharpness, label)

    with history.until_stopped() as stopped:
        merits = [_merit(problem, at(tilt, "grid")) for tilt in grid]
        i = max(range(len(grid)), key=merits.__getitem__)
        left, middle, right = grid[max(i - 1, 0)], grid[i], grid[min(i + 1, len(grid) - 1)]
        best = merits[i]
        while right - left > 2 * problem.step:
            is_right = right - middle > middle - left
            side = right - middle if is_right else left - middle
            tilt = round(middle + SECTION * side, 4)
            merit = _merit(problem, at(tilt, "section"))
            if merit > best:
                left, right = (middle, right) if is_right else (left, middle)
                middle, best = tilt, merit
            elif is_right:
                right = tilt
            else:
                left = tilt
        for _ in range(WALKS):
            found = history.best()
            assert found is not None
            beside = [t for t in problem.beside(problem.at(found.x)) if t not in problem.known]
            for tilt in beside:
                at(tilt, "beside")
            if not beside:
                break
        progress(1.0)
    found = history.best()
    assert found is not None
    return Optimum(problem, found, history, not stopped)


def _merit(problem: Turned, found: Evaluation) -> tuple[float, float]:
    """What makes a tilt the better one: that it holds the limit of ASE, then the objective."""
    over = max(found.hard.ase - problem.goal.ase_limit, 0.0)
    return -over, found.smooth.value if problem.is_feasible(found.hard) else -found.smooth.ase
