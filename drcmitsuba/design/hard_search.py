"""Searches by hard numbers alone: a sweep over one value or two, and a pattern search [1]_.

References
----------
.. [1] R. Hooke, T. A. Jeeves, "'Direct search' solution of numerical and statistical problems",
   Journal of the ACM 8, 1961.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

from drcmitsuba.design.area_search import FacadeHistory
from drcmitsuba.design.candidate import FacadeCandidate
from drcmitsuba.design.measure import HARD
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.runtime.progress import Progress

LEVELS = {1: 101, 2: 15}
"""Levels of every free value in a sweep, by their number."""
SKETCHES = 3
"""Number of designs of a sweep that are evaluated by all hours under a limit."""
APART = 0.1
"""Distance of these, as a fraction of the range between the bounds."""
FEW = 6
"""Largest number of free values for which a pattern search follows the gradient search."""
PATTERN, QUICK_PATTERN = (0.05, 0.02, 0.01), (0.05, 0.02)
"""Lengths of the pattern's steps, as fractions of the range between the bounds; the same for a
point of a Pareto front."""
ROUNDS = 20
"""Largest number of rounds of the pattern with one length."""


def sweeps(problem: FacadeProblem) -> bool:
    """Whether so few values are free that a sweep holds them all."""
    return problem.size in LEVELS


def scan(
    designs: Sequence[np.ndarray], sharpness: float, history: FacadeHistory, progress: Progress
) -> None:
    """Evaluate known designs (free,) one after the other."""
    for i, x in enumerate(designs):
        history.evaluate(np.asarray(x, float), "known", sharpness)
        progress((i + 1) / len(designs))


def sweep(sharpness: float, history: FacadeHistory, progress: Progress) -> None:
    """Sketch designs at all levels of the free values, by few hours.

    The start is evaluated by all hours, and so is each sketch that is better than those before. All
    are rated by hard numbers alone, but where slopes tell how an area gets less, see `lower_area`.
    """
    problem, best = history.problem, None
    sharpness = HARD if problem.goal.least is None else sharpness
    few, levels = problem.in_few_hours, LEVELS[problem.size]
    history.evaluate(problem.start, "start", sharpness)
    for i, level in enumerate(product(np.linspace(0, 1, levels), repeat=problem.size)):
        x = np.array(level)
        sketch = history.tried(few, x, "sweep", sharpness)
        history.sketches.append(sketch)
        if best is None or problem.merit(sketch) > problem.merit(best):
            best = sketch
            if few is not problem:
                history.evaluate(x, "sweep", sharpness)
        progress((i + 1) / levels**problem.size)


def from_sketches(
    history: FacadeHistory, progress: Progress, *, label: str, ase_limit: float | None,
    lengths: Sequence[float] = PATTERN,
) -> None:  # fmt: skip
    """Evaluate the best sketches under a limit of ASE [%], and search by a pattern from there.

    They lie apart: of neighbours, all may pass the limit by all hours.
    """
    key = partial(_merit, history.problem, ase_limit)
    known = {candidate.x.tobytes() for candidate in history.candidates}
    taken: list[np.ndarray] = []
    for sketch in sorted(history.sketches, key=key, reverse=True):
        if len(taken) < SKETCHES and all(np.abs(sketch.x - x).max() > APART for x in taken):
            taken.append(sketch.x)
            if sketch.x.tobytes() not in known:
                history.evaluate(sketch.x, label, sketch.sharpness)
    pattern_search(history, progress, label=label, ase_limit=ase_limit, lengths=lengths)


def best_within(history: FacadeHistory, ase_limit: float | None) -> FacadeCandidate:
    """Best candidate under a limit of ASE [%] in place of the problem's own."""
    return history.best(partial(_merit, history.problem, ase_limit))


def _merit(
    problem: FacadeProblem, ase_limit: float | None, candidate: FacadeCandidate
) -> tuple[float, ...]:
    hard = candidate.hard
    return candidate.merit(ase_limit, problem.area_error(hard), problem.glare_excess(hard))


def pattern_search(
    history: FacadeHistory, progress: Progress, *, label: str, ase_limit: float | None,
    lengths: Sequence[float] = PATTERN,
) -> None:  # fmt: skip
    """Search about the best candidate under a limit of ASE [%], with ever shorter steps."""
    known = {candidate.x.tobytes() for candidate in history.candidates}
    steps, swept = directions(history.problem.size), [s.sharpness for s in history.sketches[:1]]
    for i, length in enumerate(lengths):
        for _ in range(ROUNDS):
            before = best_within(history, ase_limit)
            for x in np.clip(before.x + length * steps, 0, 1):
                if x.tobytes() not in known:
                    known.add(x.tobytes())
                    history.evaluate(x, label, *(swept or [before.sharpness]))
            now = best_within(history, ase_limit)
            if now.hard.rank <= before.hard.rank and now.hard.ase >= before.hard.ase:
                break
        progress((i + 1) / len(lengths))


def directions(size: int) -> np.ndarray:
    """Steps of a pattern (step, free): along the axes, and of two values across them, too."""
    if size > 2:
        return np.concatenate([np.eye(size), -np.eye(size)])
    every = np.array([*product((-1.0, 0.0, 1.0), repeat=size)])
    return every[every.any(axis=1)]
