"""Search for the best façade: by gradients from several starts, or by a sweep, then by a pattern.

The optimum is the best of all evaluations by the hard numbers. These change in steps of one sensor,
without gradients: if few values are free, a pattern search by hard numbers follows that by
gradients of their smooth twins. Where only one value or two are free, a sweep takes its place.

Where the least area is looked for, the aim is raised until a façade reaches its least value, and is
a constraint like ASE from then on. Where a sweep over limits of ASE meets a better façade, the
search goes on from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from drcmitsuba.case.design import Design
from drcmitsuba.design.area_search import FacadeHistory, lower_area
from drcmitsuba.design.candidate import EQUAL, FacadeCandidate
from drcmitsuba.design.gradient_search import LAST, QUICK, continuation
from drcmitsuba.design.hard_search import (
    FEW,
    QUICK_PATTERN,
    best_within,
    from_sketches,
    pattern_search,
    scan,
    sweep,
    sweeps,
)
from drcmitsuba.design.measure import ASE_TOLERANCE
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.search import History, LocalSearch, Optimum, row, run
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress

SHARPNESS = (4.0, 8.0, 16.0, 32.0)

FacadeOptimum: TypeAlias = Optimum[FacadeProblem, FacadeCandidate]


@dataclass(frozen=True)
class Search:
    """Settings of the search for a façade, see the keys of `[design]`.

    Raises
    ------
    InputError
        There is no start, no iteration or no stage.
    """

    starts: int = 4
    sharpness: tuple[float, ...] = SHARPNESS
    iterations: int = 20
    seed: int = 0

    @classmethod
    def of(cls, design: Design) -> Search:
        """Settings that `[design]` states."""
        return cls(design.starts, design.sharpness, design.iterations, design.seed)

    def __post_init__(self) -> None:
        if self.starts < 1 or self.iterations < 1 or not self.sharpness:
            got = f"{self.starts} starts, {self.iterations} iterations, {self.sharpness}"
            raise InputError("optimise", "search", got, "give at least one of each")


@dataclass(frozen=True)
class Front:
    """Pareto front of the objective and ASE; `finished` is False if the sweep was stopped.

    `points` are the candidates that no other one in the history beats in both, by rising ASE.
    """

    problem: FacadeProblem
    points: tuple[FacadeCandidate, ...]
    history: FacadeHistory
    finished: bool

    @property
    def optimum(self) -> FacadeOptimum:
        """Best façade of all evaluations, those of the optimum before the front included."""
        return Optimum(self.problem, self.history.best(), self.history, self.finished)

    def save(self, file: Path) -> None:
        """Write the points as CSV, whole or not at all."""
        columns = [*row(self.problem, self.history.best())]
        table = pd.DataFrame([row(self.problem, point) for point in self.points], columns=columns)
        storage.save_csv(table, file)


def optimise(
    problem: FacadeProblem,
    search: Search = Search(),
    progress: Progress = lambda share: None,
    known: Sequence[np.ndarray] = (),
) -> FacadeOptimum:
    """Maximise the objective of a façade within its constraints.

    Parameters
    ----------
    problem : FacadeProblem
    search : Search
    progress : callable
        Takes the share that is done.
    known : sequence of np.ndarray, shape (free,)
        Designs that are evaluated first, such as named variants; the best one is a further start,
        so that the optimum is no worse than any of them.

    Returns
    -------
    Optimum
        The best façade so far where Ctrl-C stopped the search.

    Raises
    ------
    KeyboardInterrupt
        The search was stopped before anything was evaluated.
    """
    limit, sharpness, last = problem.goal.ase_limit, search.sharpness, search.sharpness[-1]
    last_steps = LAST
    searches: list[LocalSearch] = [partial(scan, known, last)] if len(known) else []
    starts: list[np.ndarray | None] = [None] if len(known) else []
    if sweeps(problem):
        start = partial(from_sketches, label="sweep", ase_limit=limit)
        searches, starts = [*searches, partial(sweep, last), start], [None]
        sharpness, last_steps = (last,), QUICK
    else:
        rng = np.random.default_rng(search.seed)
        starts.append(problem.start)
        starts += [rng.random(problem.size) for _ in range(search.starts - 1)]
    for i, x in enumerate(starts, 1):
        stages = f"start {i}", x, sharpness, search.iterations, last_steps, limit
        searches.append(partial(continuation, *stages))
    searches += _by_hard_numbers(problem)
    return Optimum.of(History(problem), searches, progress)


def pareto(
    optimum: FacadeOptimum,
    limits: Sequence[float],
    search: Search = Search(),
    progress: Progress = lambda share: None,
) -> Front:
    """Sweep the limit of ASE downwards; each search starts from the optimum under the one above.

    Other limits lead out of local optima: where the sweep has met a façade that is better under the
    problem's own limit, a search from there follows, so that no point of the front belies
    `Front.optimum`.

    Parameters
    ----------
    optimum : Optimum
        Optimum whose best façade is the first start; its evaluations belong to the front, too.
    limits : sequence of float
        Limits of ASE [%].
    search : Search
        Settings; only the last two stages are used, since the starts are good.
    progress : callable
        Takes the share that is done.

    Returns
    -------
    Front
        Front of all evaluations made, also where Ctrl-C stopped the sweep.
    """
    problem, before = optimum.problem, optimum.history
    history = replace(before, steps=list(before.steps))
    stages = search.sharpness[-2:], search.iterations, QUICK
    falling = sorted(limits, reverse=True)
    searches: list[LocalSearch] = [
        partial(_under, limit, higher, *stages)
        for limit, higher in zip(falling, [None, *falling], strict=False)
    ]

    def again(history: FacadeHistory, progress: Progress) -> None:
        if history.best() is optimum.best:
            return
        if not history.sketches:
            limit = problem.goal.ase_limit
            continuation("from the front", None, *stages, limit, history, progress)
        for refine in _by_hard_numbers(problem):
            refine(history, progress)

    finished = run(history, [*searches, again], progress)
    points = tuple(nondominated(problem, history.candidates))
    return Front(problem, points, history, optimum.finished and finished)


def _under(
    limit: float, higher: float | None, sharpness: Sequence[float], iterations: int,
    last_steps: int, history: FacadeHistory, progress: Progress,
) -> None:  # fmt: skip
    """Search under a limit of ASE [%], unless every façade so far is above the `higher` one.

    The best candidate under the limit itself, met on the way to others, may lie far from its
    optimum; the highest limit has no other start.
    """
    label, start = f"ASE ≤ {limit:g} %", None
    if higher is not None:
        above = best_within(history, higher)
        if above.hard.ase > higher + ASE_TOLERANCE:
            return
        start = above.x
    if history.sketches:
        from_sketches(history, progress, label=label, ase_limit=limit, lengths=QUICK_PATTERN)
    else:
        continuation(label, start, sharpness, iterations, last_steps, limit, history, progress)


def _by_hard_numbers(problem: FacadeProblem) -> list[LocalSearch]:
    """Searches by hard numbers that follow those by gradients."""
    limit = problem.goal.ase_limit
    searches: list[LocalSearch] = []
    if problem.size <= FEW:
        searches.append(partial(pattern_search, label="pattern", ase_limit=limit))
    return [*searches, lower_area] if problem.goal.least is not None else searches


def nondominated(
    problem: FacadeProblem, candidates: Sequence[FacadeCandidate]
) -> list[FacadeCandidate]:
    """Candidates of the required area that none beats in both objective and ASE, by rising ASE."""
    kept = [
        c
        for c in candidates
        if problem.area_error(c.hard) == 0 == problem.glare_excess(c.hard) and c.hard.holds_aim
    ]
    kept.sort(key=lambda c: (c.hard.ase, -c.hard.value, -c.sharpness))
    front: list[FacadeCandidate] = []
    for candidate in kept:
        if not front or candidate.hard.value > front[-1].hard.value + EQUAL:
            front.append(candidate)
    return front
