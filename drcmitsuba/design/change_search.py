"""Search for the least change of a façade that reaches a level of a standard.

With few free values, a grid over them is judged in the order of the changed area, so that the first
façade that reaches the level has the least change on the grid; finer grids below it follow. With
more of them, sequential quadratic programming (SLSQP) follows the gradients of the smooth margins,
shifted by their difference from the hard ones, as in `optimise`. What reaches the level is then
moved back towards the façade as it is, on a line and value by value, as long as it still does by
hard numbers.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from scipy.optimize import minimize

from drcmitsuba.design.change_problem import ChangeCandidate, ChangeProblem, Slopes
from drcmitsuba.design.constraints import area_constraints
from drcmitsuba.design.gradient_search import LAST
from drcmitsuba.design.hard_search import FEW
from drcmitsuba.design.optimise import Search
from drcmitsuba.design.search import History, LocalSearch, Optimum
from drcmitsuba.runtime.progress import Progress

LEVELS = {1: 101, 2: 21, 3: 8, 4: 5}
"""Values of each parameter on the grid, by the number of free values; more have no grid."""
GRIDS = 3
"""Number of grids, each within what the one before has found."""
HALVINGS = 10
"""Bisections of the way back to the façade as it is: a thousandth of the change."""

INDISTINCT = 1e-6
"""Difference of a free value that counts as none, as a fraction of its range."""

Of = Callable[[np.ndarray], Any]
"""Function of the free values, shape (free,)."""
ChangeHistory: TypeAlias = History[ChangeProblem, ChangeCandidate]
ChangeOptimum: TypeAlias = Optimum[ChangeProblem, ChangeCandidate]


def least_change(
    problem: ChangeProblem,
    search: Search,
    progress: Progress = lambda share: None,
    known: Sequence[np.ndarray] = (),
) -> ChangeOptimum:
    """Search the least change with which a façade reaches its level.

    Parameters
    ----------
    problem : ChangeProblem
    search : Search
        Sharpness, of which the last two stages are used, and largest number of iterations.
    progress : callable
        Takes the share that is done.
    known : sequence of np.ndarray, shape (free,)
        Façades that are judged first; a search without a grid starts from the best of them, too.

    Returns
    -------
    Optimum
        The best façade so far where Ctrl-C stopped the search; `is_feasible` is False if none that
        was tried reaches the level, and the best is then the one that comes nearest.
    """
    searches: list[LocalSearch] = [partial(_look, [problem.start, *known])]
    if problem.size in LEVELS:
        searches.append(_scan)
    if problem.size > 1:
        searches += [partial(_descend, search, problem.start), partial(_descend, search, None)]
    searches.append(_return)
    if problem.size > 1:
        searches += [partial(_descend, search, None), _return]
    return Optimum.of(History(problem), searches, progress)


def _look(known: Sequence[np.ndarray], history: ChangeHistory, progress: Progress) -> None:
    """Judge known façades, shape (free,) each."""
    for i, x in enumerate(known):
        history.evaluate(np.asarray(x, float), "known")
        progress((i + 1) / len(known))


def _scan(history: ChangeHistory, progress: Progress) -> None:
    """Judge a grid by rising changed area up to the first façade that holds; then a finer one.

    The second grid reaches as far from the façade as it is as that façade does, the third one step
    of the second to both sides; both cover the range of values that change nothing as it is.
    """
    problem, levels, best = history.problem, LEVELS[history.problem.size], None
    low, high = np.zeros(problem.size), np.ones(problem.size)
    for number in range(GRIDS):
        grid = [np.array(x) for x in product(*np.linspace(low, high, levels).T)]
        cost = [problem.cost(x) for x in grid]
        least = (np.inf, np.inf) if best is None else best.cost
        order = sorted((i for i, own in enumerate(cost) if own < least), key=lambda i: cost[i])
        for done, i in enumerate(order):
            candidate = history.evaluate(grid[i], "grid")
            if problem.holds(candidate):
                best = candidate
                break
            progress((number + (done + 1) / len(order)) / GRIDS)
        if best is None:
            return
        centre, reach = best.x, (high - low) / (levels - 1)
        if number == 0:
            centre, reach = problem.start, np.abs(best.x - problem.start)
        reach[_indifferent(problem)] = 1.0
        low, high = np.maximum(centre - reach, 0), np.minimum(centre + reach, 1)


def _indifferent(problem: ChangeProblem) -> np.ndarray:
    """Whether each value changes nothing in the façade as it is, bool, shape (free,)."""
    ends = problem.start + np.eye(problem.size) * (np.array([[[0.0]], [[1.0]]]) - problem.start)
    return np.all([[problem.is_same(x) for x in end] for end in ends], axis=0)


def _return(history: ChangeHistory, progress: Progress) -> None:
    """Move the best façade back towards the façade as it is, while it holds."""
    problem, best = history.problem, history.best()
    if not problem.holds(best):
        return

    def holds(x: np.ndarray) -> bool:
        """Judge a façade, and take it where it holds with less change."""
        nonlocal best
        candidate = history.evaluate(x, "return")
        if not problem.holds(candidate):
            return False
        best = min(best, candidate, key=lambda c: c.cost)
        return True

    def back(to: np.ndarray, halvings: int) -> None:
        """Go to a point, or by bisection as near to it as the façade holds."""
        way = best.x - to
        if holds(to):
            return
        low, high = 0.0, 1.0
        for _ in range(halvings):
            middle = (low + high) / 2
            low, high = (low, middle) if holds(to + middle * way) else (middle, high)

    back(problem.start_towards(best.x), HALVINGS)
    start = problem.start_towards(best.x)
    moved = np.flatnonzero(np.abs(best.x - start) > INDISTINCT)
    halvings = HALVINGS // 2 if problem.size <= FEW else 0
    for done, axis in enumerate(moved):
        to = best.x.copy()
        to[axis] = start[axis]
        if problem.cost(to) < best.cost:
            back(to, halvings)
        progress((done + 1) / len(moved))


def _descend(
    search: Search, start: np.ndarray | None, history: ChangeHistory, progress: Progress
) -> None:
    """Minimise the changed area by SLSQP, the level as constraint, in stages of rising sharpness.

    The start, shape (free,), is by default the best façade so far. Where no façade holds, the
    least margin is maximised first. Where there is a problem of few hours, the stages are of it,
    and the last steps of all.
    """
    few, last = history.problem.in_few_hours, search.sharpness[-1]
    stages = [(few, k, search.iterations) for k in search.sharpness[-2:]]
    if few is not history.problem:
        stages.append((history.problem, last, min(LAST, search.iterations)))
    x = history.best().x if start is None else start
    for i, stage in enumerate(stages):
        begin = _Stage(history, x, *stage)
        if not history.problem.holds(history.best()):
            x = begin.raise_least_margin()
            begin = _Stage(history, x, *stage)
        x = begin.lower_change()
        progress((i + 1) / len(stages))


class _Stage:
    """Smooth problems at one sharpness, from x (free,); hard − smooth margins at x shift these.

    The problem is that of the history, or one of few of its hours, which the history does not keep.
    """

    def __init__(
        self, history: ChangeHistory, x: np.ndarray, problem: ChangeProblem, sharpness: float,
        iterations: int,
    ) -> None:  # fmt: skip
        self._history, self._x, self._sharpness = history, x, sharpness
        self._problem, self._iterations = problem, iterations
        self._evaluated: dict[bytes, ChangeCandidate] = {}
        by_all = self._at(x) if problem is history.problem else history.evaluate(x, "gradient")
        self._shift = by_all.margins - self._slopes(x).margins

    def lower_change(self) -> np.ndarray:
        """Least changed area with margins of 0 or more: the last point, shape (free,)."""
        unit = float(self._history.problem.facade.year.tiles.area.sum())
        level = {
            "type": "ineq",
            "fun": lambda p: self._margins(p),
            "jac": lambda p: self._slopes(p).by_margin,
        }
        return self._minimise(
            lambda p: self._at(p).by_degrees / unit,
            lambda p: self._slopes(p).changed / unit,
            [level, *self._window_area()],
        )

    def raise_least_margin(self) -> np.ndarray:
        """Largest of the least margins: the last point, shape (free,)."""
        return self._minimise(
            lambda p: -self._margins(p).min(),
            lambda p: -self._slopes(p).by_margin[np.argmin(self._margins(p))],
            self._window_area(),
        )

    def _window_area(self) -> list[dict[str, Any]]:
        """Constraints on the panes' area."""
        limits = self._history.problem.facade.goal.window_area
        return area_constraints(
            limits, lambda p: self._at(p).window_area, lambda p: self._slopes(p).window
        )

    def _margins(self, x: np.ndarray) -> np.ndarray:
        return self._slopes(x).margins + self._shift

    def _slopes(self, x: np.ndarray) -> Slopes:
        slopes = self._at(x).slopes
        assert slopes is not None
        return slopes

    def _at(self, x: np.ndarray) -> ChangeCandidate:
        # If constraints contradict each other, SLSQP may evaluate NaN: the start replaces it.
        inside = np.clip(np.where(np.isfinite(x), x, self._x), 0, 1)
        key = inside.tobytes()  # value and gradients are asked for one by one
        if key not in self._evaluated:
            settings = inside, "gradient", self._sharpness
            self._evaluated[key] = self._history.tried(self._problem, *settings)
        return self._evaluated[key]

    def _minimise(self, value: Of, gradient: Of, constraints: list[dict[str, Any]]) -> np.ndarray:
        with warnings.catch_warnings():
            # SLSQP warns of points outside the bounds by rounding; `_at` clips them.
            warnings.simplefilter("ignore", RuntimeWarning)
            end = minimize(
                value,
                self._x,
                jac=gradient,
                method="SLSQP",
                bounds=[(0.0, 1.0)] * len(self._x),
                constraints=constraints,
                options={"maxiter": self._iterations, "ftol": 1e-5},
            )
        return self._at(end.x).x
