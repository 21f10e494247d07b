"""Search for the best façade: SLSQP from several starts, while the smooth twins become sharper.

Sequential quadratic programming follows the gradients of the smooth twins [1]_. Smooth and hard ASE
differ, so each stage of the continuation shifts the limit by their difference at its start. The
optimum is the best of all evaluations by the hard numbers. Hard numbers change in steps of one
sensor, without gradients: if few values are free, a pattern search by hard numbers follows.

The stages are of few hours, which come near the optimum, and the last steps of all of them. Where
only one value or two are free, a sweep over them takes the place of the stages.

Where the least area is looked for, the aim is raised until a façade reaches its least value, and is
a constraint like ASE from then on.

Where a sweep over limits of ASE meets a better façade, the search goes on from there.

References
----------
.. [1] D. Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28, 1988.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from drcmitsuba.case.design import Design
from drcmitsuba.design.area_search import FacadeHistory, lower_area
from drcmitsuba.design.constraints import (
    aim_constraint,
    area_constraints,
    limit_constraint,
)
from drcmitsuba.design.hard_search import (
    FEW,
    best_within,
    from_sketches,
    pattern_search,
    scan,
    sweep,
    sweeps,
)
from drcmitsuba.design.problem import FacadeCandidate, FacadeProblem
from drcmitsuba.design.search import History, LocalSearch, Optimum, row, run
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress

SHARPNESS = (4.0, 8.0, 16.0, 32.0)
LAST = 5
"""Largest number of steps by all hours, after those by few."""
EVALUATIONS = 3
"""Largest number of evaluations for each step: where no façade holds the limits, SLSQP does not end
by itself."""

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
        table = pd.DataFrame([row(self.problem, point) for point in self.points])
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
    limit, last = problem.goal.ase_limit, search.sharpness[-1]
    searches: list[LocalSearch] = [partial(scan, known, last)] if len(known) else []
    starts: list[np.ndarray | None] = [None] if len(known) else []
    if sweeps(problem):
        start = partial(from_sketches, label="sweep", ase_limit=limit)
        searches, starts = [*searches, partial(sweep, last), start], [None]
        search = replace(search, sharpness=(last,))
    else:
        rng = np.random.default_rng(search.seed)
        starts.append(problem.start)
        starts += [rng.random(problem.size) for _ in range(search.starts - 1)]
    for i, x in enumerate(starts, 1):
        searches.append(partial(_continuation, f"start {i}", x, search, limit))
    searches += _by_hard_numbers(problem)
    return Optimum.of(History(problem), searches, progress)


def pareto(
    optimum: FacadeOptimum,
    limits: Sequence[float],
    search: Search = Search(),
    progress: Progress = lambda share: None,
) -> Front:
    """Sweep the limit of ASE; each search starts from the best candidate so far.

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
    last = replace(search, sharpness=search.sharpness[-2:])
    falling = sorted(limits, reverse=True)
    searches: list[LocalSearch] = [
        partial(_under, limit, higher, last)
        for limit, higher in zip(falling, [100.0, *falling], strict=False)
    ]

    def again(history: FacadeHistory, progress: Progress) -> None:
        if history.best() is optimum.best:
            return
        if not history.sketches:
            _continuation("from the front", None, last, problem.goal.ase_limit, history, progress)
        for refine in _by_hard_numbers(problem):
            refine(history, progress)

    finished = run(history, [*searches, again], progress)
    points = tuple(nondominated(problem, history.candidates))
    return Front(problem, points, history, optimum.finished and finished)


def _under(
    limit: float, higher: float, search: Search, history: FacadeHistory, progress: Progress
) -> None:
    """Search under a limit of ASE [%], unless no façade has held even a higher one."""
    label = f"ASE ≤ {limit:g} %"
    if best_within(history, higher).hard.ase > higher:
        return
    if history.sketches:
        from_sketches(history, progress, label=label, ase_limit=limit)
    else:
        _continuation(label, None, search, limit, history, progress)


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
        if not front or candidate.hard.value > front[-1].hard.value:
            front.append(candidate)
    return front


def _continuation(
    label: str, start: np.ndarray | None, search: Search, ase_limit: float | None,
    history: FacadeHistory, progress: Progress,
) -> None:  # fmt: skip
    """Gradient ascent by SLSQP in stages of rising sharpness, within a limit of ASE [%].

    The start, shape (free,), is by default the best candidate so far. Where the problem has a
    smaller one of few hours, the stages are of it; a short one of all hours ends them.
    """
    problem, x = history.problem, start
    if x is None:
        x = best_within(history, ase_limit).x
    stage = partial(_stage, history, label, ase_limit)
    few, last = problem.in_few_hours, search.sharpness[-1]
    stages = [(few, search.iterations, k) for k in search.sharpness]
    if few is not problem:
        stages.append((problem, min(LAST, search.iterations), last))
    for i, (of, iterations, k) in enumerate(stages):
        x = stage(of, iterations, x, k)
        progress((i + 1) / len(stages))
    end = history.steps[-1].candidate.hard
    beyond = (ase_limit is not None and end.ase > ase_limit) or not end.holds_aim
    if beyond or problem.glare_excess(end) > 0:
        # The stage's start shifted the limits: once more, shifted by the stage's end.
        stage(problem, stages[-1][1], x, last)


class _SpentError(Exception):
    """A stage has had its evaluations."""


def _stage(
    history: FacadeHistory, label: str, ase_limit: float | None, problem: FacadeProblem,
    iterations: int, x: np.ndarray, sharpness: float,
) -> np.ndarray:  # fmt: skip
    """Maximise at one sharpness, and return the last point, shape (free,).

    The problem is that of the history, or one of few of its hours, which the history does not keep.
    """
    evaluated: dict[bytes, FacadeCandidate] = {}
    most = EVALUATIONS * iterations
    begin = history.evaluate(x, label, sharpness)

    def at(point: np.ndarray) -> FacadeCandidate:
        # If constraints contradict each other, SLSQP may evaluate NaN: the start replaces it.
        inside = np.clip(np.where(np.isfinite(point), point, x), 0, 1)
        key = inside.tobytes()  # value and gradients are asked for one by one
        if key not in evaluated:
            if len(evaluated) >= most:
                raise _SpentError
            if problem is not history.problem:
                evaluated[key] = problem.evaluate(inside, sharpness)
            elif (inside == begin.x).all():
                evaluated[key] = begin
            else:
                evaluated[key] = history.evaluate(inside, label, sharpness)
        return evaluated[key]

    def shift(name: str) -> float:
        return float(getattr(begin.hard, name) - getattr(at(x).smooth, name))

    goal = history.problem.goal
    raises_aim = goal.least is not None and not any(c.hard.holds_aim for c in history.candidates)
    constraints = area_constraints(
        goal.window_area, lambda p: at(p).smooth.window_area, lambda p: at(p).area_gradient
    )
    if ase_limit is not None:
        constraints.append(limit_constraint("ase", ase_limit, at, shift("ase")))
    if goal.glare_limit is not None:
        constraints.append(limit_constraint("glare", goal.glare_limit, at, shift("glare")))
    if goal.least is not None and not raises_aim:
        constraints.append(aim_constraint(goal.least.aim, at, shift("aim")))

    def value(point: np.ndarray) -> float:
        smooth = at(point).smooth
        return -(smooth.aim if raises_aim else smooth.value) / 100

    def slope(point: np.ndarray) -> Any:
        gradient = at(point).aim_gradient if raises_aim else at(point).gradient
        assert gradient is not None
        return -gradient / 100

    points = [begin.x]
    with warnings.catch_warnings(), suppress(_SpentError):
        # SLSQP warns of points outside the bounds by rounding; `at` clips them.
        warnings.simplefilter("ignore", RuntimeWarning)
        minimize(
            value,
            x,
            jac=slope,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(x),
            constraints=constraints,
            callback=points.append,
            options={"maxiter": iterations, "ftol": 1e-5},
        )
    return at(points[-1]).x
