"""The search that all design problems share: step, history, loop and optimum.

A local search proposes candidates, and the problem evaluates them. Every evaluated candidate stays
in the history, so that a stopped search has lost nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import pandas as pd

from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import was_stopped
from drcmitsuba.runtime.progress import Progress, part


class SearchProblem(Protocol):
    """Interface of a problem to its search; candidates are of the problem's own kind."""

    @property
    def evaluate(self) -> Callable[..., Any]:
        """Turns x (free,), 0 to 1 between the bounds, and settings into a candidate."""

    def named(self, x: np.ndarray) -> Mapping[str, Any]:
        """Values of the parameters in their own units, one number or an array each."""

    def merit(self, candidate: Any) -> tuple[float, ...]:
        """Sort key of candidates: the largest one is the best."""

    def holds(self, candidate: Any) -> bool:
        """True if the candidate holds the constraints."""

    def numbers(self, candidate: Any) -> dict[str, float]:
        """Columns of the history beside the parameters."""

    def details(self, candidate: Any) -> dict[str, Any]:
        """Further entries of `optimum.json`."""


P = TypeVar("P", bound=SearchProblem)
C = TypeVar("C", bound=Any)
"""An evaluated design: free values `x` (free,), 0 to 1, and its `objective`, which is maximised."""


@dataclass(frozen=True)
class Step(Generic[C]):
    """One evaluation of a search, at a time since the history began [s].

    `label` names the local search that proposed the candidate, such as "ASE ≤ 10 %".
    """

    label: str
    seconds: float
    candidate: C


@dataclass
class History(Generic[P, C]):
    """Evaluations of a problem in their order; `begin` is `time.perf_counter` at the start [s]."""

    problem: P
    steps: list[Step[C]] = field(default_factory=list)
    begin: float = field(default_factory=time.perf_counter)
    sketches: list[C] = field(default_factory=list)
    """Candidates of a smaller problem, from which a search starts; none of them is a result."""

    def __len__(self) -> int:
        """Count the evaluations."""
        return len(self.steps)

    def __iter__(self) -> Iterator[Step[C]]:
        """Iterate over the steps, the first one first."""
        return iter(self.steps)

    @property
    def candidates(self) -> list[C]:
        """Candidates of all steps."""
        return [step.candidate for step in self.steps]

    def evaluate(self, x: np.ndarray, label: str, *settings: float) -> C:
        """Evaluate a design with the problem's settings, and keep the candidate."""
        candidate: C = self.problem.evaluate(x, *settings)
        self.steps.append(Step(label, time.perf_counter() - self.begin, candidate))
        return candidate

    def tried(self, problem: P, x: np.ndarray, label: str, *settings: float) -> C:
        """Evaluate a design of the own problem; of a smaller one, without keeping it."""
        if problem is self.problem:
            return self.evaluate(x, label, *settings)
        candidate: C = problem.evaluate(x, *settings)
        return candidate

    def best(self, merit: Callable[[C], tuple[float, ...]] | None = None) -> C:
        """Candidate of the largest merit; `merit` replaces the problem's key."""
        return max(self.candidates, key=merit or self.problem.merit)

    @property
    def frame(self) -> pd.DataFrame:
        """Table of one row for each evaluation."""
        return pd.DataFrame(
            {"search": s.label, "seconds": round(s.seconds, 3), **row(self.problem, s.candidate)}
            for s in self.steps
        )


def row(problem: SearchProblem, candidate: Any) -> dict[str, float]:
    """Numbers of a candidate, then its parameters in their own units, one column a value."""
    columns = dict(problem.numbers(candidate))
    for key, value in problem.named(candidate.x).items():
        values = np.atleast_1d(value)
        one = len(values) == 1
        columns |= {key if one else f"{key}_{i}": float(v) for i, v in enumerate(values)}
    return columns


LocalSearch = Callable[[Any, Progress], None]
"""Evaluates designs in a history, one after the other; calls `progress` with the fraction done."""


def run(history: History[Any, Any], searches: Iterable[LocalSearch], progress: Progress) -> bool:
    """Run local searches one after the other, which add to a history; each counts alike.

    Returns True if all came to their end, False if Ctrl-C or a kill ended one of them.

    Raises
    ------
    KeyboardInterrupt
        The search was stopped before anything was evaluated.
    """
    searches = list(searches)
    try:
        for i, search in enumerate(searches):
            search(history, part(progress, i / len(searches), (i + 1) / len(searches)))
            progress((i + 1) / len(searches))
    except (KeyboardInterrupt, RuntimeError) as error:
        if not was_stopped(error) or not history.steps:
            raise
        return False
    return True


T = TypeVar("T", bound="Optimum[Any, Any]")


@dataclass(frozen=True)
class Optimum(Generic[P, C]):
    """Best candidate of a search, and the history of all; `finished` is False if it was stopped."""

    problem: P
    best: C
    history: History[P, C]
    finished: bool

    @classmethod
    def of(
        cls: type[T], history: History[Any, Any], searches: Iterable[LocalSearch],
        progress: Progress,
    ) -> T:  # fmt: skip
        """Run local searches that add to a history, and take the best of all candidates."""
        finished = run(history, searches, progress)
        return cls(history.problem, history.best(), history, finished)

    @property
    def values(self) -> Mapping[str, Any]:
        """Values of the parameters in their own units."""
        return self.problem.named(self.best.x)

    @property
    def objective(self) -> float:
        """Objective of the best candidate."""
        return self.best.objective

    @property
    def evaluations(self) -> int:
        """Number of designs that were evaluated."""
        return len(self.history)

    @property
    def seconds(self) -> float:
        """Time until the last evaluation [s]."""
        return self.history.steps[-1].seconds

    @property
    def is_feasible(self) -> bool:
        """True if the best candidate holds the constraints."""
        return self.problem.holds(self.best)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of `optimum.json`, without smooth ones that were not computed."""
        numbers = row(self.problem, self.best)
        return {
            "finished": self.finished,
            "feasible": self.is_feasible,
            "evaluations": self.evaluations,
            "seconds": round(self.seconds, 3),
            **{name: value for name, value in numbers.items() if not np.isnan(value)},
            **self.problem.details(self.best),
        }

    def save(self, folder: str | Path) -> None:
        """Write `optimum.json` and `history.csv`, each whole or not at all."""
        storage.save_json(self.to_dict(), Path(folder) / "optimum.json")
        storage.save_csv(self.history.frame, Path(folder) / "history.csv")
