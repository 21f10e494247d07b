"""Search for the best tilt of lamellae in few simulations: a coarse grid, then sections.

Every simulation is expensive, and only one number is free. The search uses no gradients: a golden
section [1]_ compares two tilts by the smooth objective among the tilts that hold the limit of ASE.
The optimum is the best of all tilts by the hard numbers; its neighbours are simulated too and give
the slope there.

References
----------
.. [1] J. Kiefer, "Sequential minimax search for a maximum", Proc. AMS 4, 1953.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from drcmitsuba.design.measure import RatedCandidate
from drcmitsuba.design.optimise import SHARPNESS
from drcmitsuba.design.search import History, Optimum
from drcmitsuba.design.tilt import TiltProblem
from drcmitsuba.runtime.progress import Progress, part

GRID = 5
"""Number of tilts in the first grid, without the case's own."""
WALKS = 5
"""Largest number of steps to a neighbour that is better by hard numbers."""
SECTION = (3 - math.sqrt(5)) / 2
"""Fraction of the wider side of an interval at which the golden section cuts it."""

TiltHistory: TypeAlias = History[TiltProblem, RatedCandidate]
TiltOptimum: TypeAlias = Optimum[TiltProblem, RatedCandidate]
At = Callable[[float, str], RatedCandidate]


def optimise_tilt(
    problem: TiltProblem,
    sharpness: float = SHARPNESS[-1],
    progress: Progress = lambda share: None,
) -> TiltOptimum:
    """Find the best tilt to within the problem's step, by smooth twins of a sharpness.

    Where Ctrl-C stopped the search, the optimum is the best tilt so far. Limits: a maximum that is
    narrower than the grid, about ⅙ of the bounds, may be missed.

    Raises
    ------
    KeyboardInterrupt
        The search was stopped before anything was evaluated.
    """
    history: TiltHistory = History(problem)
    return Optimum.of(history, [partial(_sections, sharpness=sharpness)], progress)


def _sections(history: TiltHistory, progress: Progress, sharpness: float) -> None:
    """Coarse grid, golden sections about its best tilt, then steps to better neighbours.

    The progress counts simulations of about as many as there will be.
    """
    problem = history.problem
    grid = _grid(problem)
    widest = max(b - a for a, b in zip(grid[:-2], grid[2:], strict=True))
    sections = math.log(2 * problem.step / widest) / math.log(1 - SECTION)
    total = len(grid) + math.ceil(max(sections, 0)) + 2

    def at(tilt: float, label: str) -> RatedCandidate:
        done = len(problem.simulated)
        problem.simulate(tilt, part(progress, *(min(1, n / total) for n in (done, done + 1))))
        return history.evaluate(problem.free(tilt), label, sharpness)

    merits = [_merit(problem, at(tilt, "grid")) for tilt in grid]
    i = max(range(len(grid)), key=merits.__getitem__)
    bracket = grid[max(i - 1, 0)], grid[i], grid[min(i + 1, len(grid) - 1)]
    _golden_sections(problem, at, bracket, merits[i])
    _walk(history, at)


def _grid(problem: TiltProblem) -> list[float]:
    """First tilts [deg]: the case's own, and evenly spaced tilts that are not next to it."""
    start = round(problem.tilt.start, 4)
    even = np.linspace(problem.tilt.low, problem.tilt.high, GRID).round(4).tolist()
    return sorted([start, *(tilt for tilt in even if abs(tilt - start) >= problem.step)])


def _golden_sections(
    problem: TiltProblem, at: At, bracket: tuple[float, float, float], best: tuple[float, float]
) -> None:
    """Narrow a bracket of tilts [deg] about the best one to the problem's step on either side."""
    left, middle, right = bracket
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


def _walk(history: TiltHistory, at: At) -> None:
    """Evaluate the neighbours of the best tilt, until it has none that is better."""
    problem = history.problem
    for _ in range(WALKS):
        tilt = problem.at(history.best().x)
        neighbours = [t for t in problem.beside(tilt) if t not in problem.simulated]
        for neighbour in neighbours:
            at(neighbour, "beside")
        if not neighbours:
            break


def _merit(problem: TiltProblem, candidate: RatedCandidate) -> tuple[float, float]:
    """Sort key: −(hard ASE above its limit), then smooth objective, or −ASE above the limit."""
    over = max(candidate.hard.ase - problem.goal.ase_limit, 0.0)
    return -over, candidate.smooth.value if problem.holds(candidate) else -candidate.smooth.ase
