"""Search for the best façade: SLSQP from several starts, while the twins are made sharper.

Sequential quadratic programming takes the gradients of the smooth twins [1]_. The twins' ASE is not
yet ASE, so each stage of the continuation moves its limit by what the two differ at its start. What
is found is the best of all evaluations by the hard numbers. These are steps of one sensor, on which
gradients cannot walk: where few values are free, a pattern search [2]_ by hard numbers ends it.

References
----------
.. [1] D. Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28, 1988.
.. [2] R. Hooke, T. A. Jeeves, "'Direct search' solution of numerical and statistical problems",
   Journal of the ACM 8, 1961.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeAlias

import numpy as np
from scipy.optimize import minimize

from drcmitsuba.design.history import E, History, P, row
from drcmitsuba.design.problem import Composed, Problem
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part

SHARPNESS = (4.0, 8.0, 16.0, 32.0)
FEW = 6
"""Free values up to which a pattern search ends the search."""
PATTERN = (0.05, 0.02, 0.01)
"""Its steps, of the range between the bounds."""


@dataclass(frozen=True)
class Search:
    """How to search.

    Parameters
    ----------
    starts : int
        First the parameters' own, then random ones.
    sharpness : tuple of float
        Stages of the continuation.
    iterations : int
        Of SLSQP in each stage, at most.
    seed : int
        Of the random starts.
    """

    starts: int = 4
    sharpness: tuple[float, ...] = SHARPNESS
    iterations: int = 20
    seed: int = 0

    def __post_init__(self) -> None:
        if self.starts < 1 or self.iterations < 1 or not self.sharpness:
            got = f"{self.starts} starts, {self.iterations} iterations, {self.sharpness}"
            raise InputError("optimise", "search", got, "give at least one of each")


@dataclass(frozen=True)
class Optimum(Generic[P, E]):
    """What a search found.

    Parameters
    ----------
    problem : Searched
    best : Evaluation
        Its hard numbers are those to report.
    history : History
        All evaluations.
    finished : bool
        Whether the search came to its end; false where it was stopped.
    """

    problem: P
    best: E
    history: History[P, E]
    finished: bool

    @property
    def evaluations(self) -> int:
        """How many designs were evaluated."""
        return len(self.history.steps)

    @property
    def seconds(self) -> float:
        """Until the last evaluation [s]."""
        return self.history.steps[-1].seconds

    @property
    def is_feasible(self) -> bool:
        """Whether the hard numbers hold the constraints."""
        return self.problem.is_feasible(self.best.hard)

    def as_dict(self) -> dict[str, Any]:
        """Numbers for `optimum.json`."""
        return {
            "finished": self.finished,
            "feasible": self.is_feasible,
            "evaluations": self.evaluations,
            "seconds": round(self.seconds, 3),
            **row(self.problem, self.best),
            **self.problem.details(self.best),
        }

    def save(self, folder: str | Path) -> None:
        """Write `optimum.json` and `history.csv`, each whole or not at all."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        storage.save_json(self.as_dict(), folder / "optimum.json")
        self.history.save(folder / "history.csv")


FacadeOptimum: TypeAlias = Optimum[Problem, Composed]


@dataclass(frozen=True)
class Front:
    """What ASE costs in sDA.

    Parameters
    ----------
    problem : Problem
    points : tuple of Evaluation
        None is beaten by another one in both, by rising ASE.
    history : History
        All evaluations.
    finished : bool
    """

    problem: Problem
    points: tuple[Composed, ...]
    history: History[Problem, Composed]
    finished: bool

    def save(self, file: Path) -> None:
        """Write the points as CSV, whole or not at all."""
        import pandas as pd

        frame = pd.DataFrame([row(self.problem, point) for point in self.points])
        storage.save_text(frame.to_csv(index=False, float_format="%.6g"), file)


def optimise(
    problem: Problem,
    search: Search = Search(),
    progress: Progress = lambda share: None,
    known: Sequence[np.ndarray] = (),
) -> FacadeOptimum:
    """Find the best values of a problem.

    Parameters
    ----------
    problem : Problem
    search : Search
    progress : callable
        Told the share that is done.
    known : sequence of np.ndarray, shape (free,)
        Such as named variants. They are evaluated first, and the best of them is a further start:
        what is found is no worse than they are.

    Returns
    -------
    Optimum
        Stopped by Ctrl-C, the best so far.

    Raises
    ------
    KeyboardInterrupt
        It was stopped before anything was evaluated.
    """
    history: History[Problem, Composed] = History(problem)
    rng = np.random.default_rng(search.seed)
    with history.until_stopped() as stopped:
        random = [rng.random(problem.size) for _ in range(search.starts - 1)]
        for x in known:
            history.evaluate(np.asarray(x, float), search.sharpness[-1], "known")
        first = history.best()
        starts = [*([] if first is None else [first.x]), problem.start, *random]
        for i, x in enumerate(starts):
            told = part(progress, 0.95 * i / len(starts), 0.95 * (i + 1) / len(starts))
            _continue(history, x, search, f"start {i + 1}", told)
        if problem.size <= FEW:
            _pattern(history, part(progress, 0.95, 1.0))
        progress(1.0)
    best = history.best()
    assert best is not None
    return Optimum(problem, best, history, not stopped)


def pareto(
    optimum: FacadeOptimum,
    limits: Sequence[float],
    search: Search = Search(),
    progress: Progress = lambda share: None,
) -> Front:
    """Sweep the limit of ASE, each search from the best of the ones before.

    Parameters
    ----------
    optimum : Optimum
        Its best is where the first search starts; its evaluations count too.
    limits : sequence of float
        Of ASE [%].
    search : Search
        Of its stages the last two are taken, since the starts are good.
    progress : callable
        Told the share that is done.

    Returns
    -------
    Front
        Of all evaluations; stopped by Ctrl-C, of those until then.
    """
    history = History(optimum.problem, list(optimum.history.steps))
    short = replace(search, sharpness=search.sharpness[-2:])
    with history.until_stopped() as stopped:
        for i, limit in enumerate(sorted(limits, reverse=True)):
            near = history.best(limit)
            assert near is not None
            told = part(progress, i / len(limits), (i + 1) / len(limits))
            _continue(history, near.x, short, f"ASE ≤ {limit:g} %", told, limit)
    points = tuple(history.front())
    return Front(optimum.problem, points, history, optimum.finished and not stopped)


def _continue(
    history: History[Problem, Composed],
    x: np.ndarray,
    search: Search,
    label: str,
    progress: Progress,
    ase_limit: float | None = None,
) -> None:
    """Go through the stages of the continuation from one start."""
    limit = history.problem.goal.ase_limit if ase_limit is None else ase_limit
    stages = search.sharpness
    for i, k in enumerate(stages):
        x = _stage(history, x, k, limit, search.iterations, label)
        beyond = limit is not None and history.steps[-1].found.hard.ase > limit
        if beyond and i + 1 == len(stages):
            # The twins' limit was that of the stage's start: once more, with that of its end.
            _stage(history, x, k, limit, search.iterations, label)
        progress((i + 1) / len(stages))


def _stage(
    history: History[Problem, Composed],
    x: np.ndarray,
    k: float,
    limit: float | None,
    iterations: int,
    label: str,
) -> np.ndarray:
    """Search at one sharpness by SLSQP, in units of 100 % and of the window's area."""
    known: dict[bytes, Composed] = {}

    def at(point: np.ndarray) -> Composed:
        # Where limits contradict each other, SLSQP may ask for NaN: it is shown its start.
        inside = np.clip(np.where(np.isfinite(point), point, x), 0, 1)
        key = inside.tobytes()  # value and gradients are asked for one by one
        if key not in known:
            known[key] = history.evaluate(inside, k, label)
        return known[key]

    constraints = []
    area = history.problem.goal.window_area
    if area is not None:
        low, high = area
        unit = max(high, 1e-9)
        for kind, sign, edge in (("ineq", 1, low), ("ineq", -1, high)):
            constraints.append(
                {
                    "type": "eq" if low == high else kind,
                    "fun": lambda p, s=sign, e=edge: s * (at(p).smooth.window_area - e) / unit,
                    "jac": lambda p, s=sign: s * at(p).area_gradient / unit,
                }
            )
        constraints = constraints[:1] if low == high else constraints
    if limit is not None:
        first = at(x)
        shift = first.hard.ase - first.smooth.ase
        constraints.append(
            {
                "type": "ineq",
                "fun": lambda p: (limit - shift - at(p).smooth.ase) / 100,
                "jac": lambda p: -at(p).ase_gradient / 100,
            }
        )
    with warnings.catch_warnings():
        # SLSQP tells of points outside the bounds by rounding; they are clipped above.
        warnings.simplefilter("ignore", RuntimeWarning)
        found = minimize(
            lambda p: -at(p).smooth.value / 100,
            x,
            jac=lambda p: -at(p).gradient / 100,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(x),
            constraints=constraints,
            options={"maxiter": iterations, "ftol": 1e-5},
        )
    return at(found.x).x


def _pattern(history: History[Problem, Composed], progress: Progress) -> None:
    """Walk along the axes by hard numbers, from the best, with ever smaller steps."""
    for i, length in enumerate(PATTERN):
        best = history.best()
        assert best is not None
        for _ in range(20):
            for axis in range(len(best.x)):
                for way in (length, -length):
                    moved = best.x.copy()
                    moved[axis] = np.clip(moved[axis] + way, 0, 1)
                    if moved[axis] != best.x[axis]:
                        history.evaluate(moved, best.sharpness, "pattern")
            now = history.best()
            assert now is not None
            if now.hard.value <= best.hard.value and now.hard.ase >= best.hard.ase:
                break
            best = now
        progress((i + 1) / len(PATTERN))
