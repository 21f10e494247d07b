"""Search by gradients: SLSQP in stages, while the smooth twins become sharper [1]_.

Smooth and hard numbers differ, so each stage shifts the limits by their difference at its start.

References
----------
.. [1] D. Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28, 1988.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import minimize

from drcmitsuba.design.area_search import FacadeHistory
from drcmitsuba.design.candidate import FacadeCandidate
from drcmitsuba.design.constraints import aim_constraint, area_constraints, limit_constraint
from drcmitsuba.design.hard_search import best_within
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.runtime.progress import Progress

LAST = 12
"""Largest number of steps by all hours, after those by few."""
QUICK = 5
"""The same for a point of a Pareto front, and after a sweep."""
EVALUATIONS = 3
"""Largest number of evaluations for each step: where no façade holds the limits, SLSQP does not end
by itself."""
LACK = 1e-4
"""Sum of what constraints lack that counts as nothing [–]."""


def continuation(
    label: str, start: np.ndarray | None, sharpness: Sequence[float], iterations: int,
    last_steps: int, ase_limit: float | None,
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
    few, last = problem.in_few_hours, sharpness[-1]
    stages = [(few, iterations, k) for k in sharpness]
    if few is not problem:
        stages.append((problem, min(last_steps, iterations), last))
    for i, (of, steps, k) in enumerate(stages):
        x = stage(of, steps, x, k)
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
            is_start = problem is history.problem and (inside == begin.x).all()
            evaluated[key] = begin if is_start else history.tried(problem, inside, label, sharpness)
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

    def short(point: np.ndarray) -> tuple[bool, float]:
        """Whether a point lacks what a constraint asks for; then by how much, else its value."""
        lacks = [
            abs(c["fun"](point)) if c["type"] == "eq" else max(0.0, -c["fun"](point))
            for c in constraints
        ]
        lack = float(np.sum(lacks))
        return (True, lack) if lack > LACK else (False, value(point))

    with warnings.catch_warnings():
        # SLSQP warns of points outside the bounds by rounding; `at` clips them.
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            end = minimize(
                value,
                x,
                jac=slope,
                method="SLSQP",
                bounds=[(0.0, 1.0)] * len(x),
                constraints=constraints,
                options={"maxiter": iterations, "ftol": 1e-5},
            )
            return at(end.x).x
        except _SpentError:  # its last point may be one that a line search has tried in vain
            return min((c.x for c in evaluated.values()), key=short)
