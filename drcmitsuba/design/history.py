"""Every evaluation of a search, as it went, and the best of them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import pandas as pd

from drcmitsuba.design.measure import Evaluation
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import was_stopped

AREA_TOLERANCE = 2e-3
"""Of the window's area: what it may be off by."""


class Searched(Protocol):
    """What a search asks of a problem; scores and evaluations are of the problem's own kind."""

    @property
    def goal(self) -> Any:
        """`aim` and `ase_limit`."""
        ...

    def evaluate(self, x: np.ndarray, sharpness: float) -> Any:
        """Evaluate a design; x is 0 to 1 between the bounds."""
        ...

    def named(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameters, in their own units."""
        ...

    def missing_area(self, score: Any) -> float:
        """How far the panes are from the area asked for, of that."""
        ...

    def is_feasible(self, score: Any) -> bool:
        """Whether the constraints hold."""
        ...

    def numbers(self, score: Any) -> dict[str, float]:
        """Further columns of the history."""
        ...

    def details(self, found: Any) -> dict[str, Any]:
        """What else `optimum.json` tells."""
        ...


P = TypeVar("P", bound=Searched)
E = TypeVar("E", bound=Evaluation)


@dataclass(frozen=True)
class Step(Generic[E]):
    """One evaluation of a search.

    Parameters
    ----------
    label : str
        Which search: "start 1", "ASE ≤ 10 %".
    seconds : float
        Since the history began [s].
    found : Evaluation
    """

    label: str
    seconds: float
    found: E


@dataclass
class History(Generic[P, E]):
    """Evaluations of a problem, in the order in which they were made.

    It grows while a search runs, so that a search that is stopped has lost nothing.

    Parameters
    ----------
    problem : Searched
    """

    problem: P
    steps: list[Step[E]] = field(default_factory=list)
    begin: float = field(default_factory=time.perf_counter)

    def evaluate(self, x: np.ndarray, sharpness: float, label: str) -> E:
        """Evaluate and keep it."""
        found: E = self.problem.evaluate(x, sharpness)
        self.steps.append(Step(label, time.perf_counter() - self.begin, found))
        return found

    def best(self, ase_limit: float | None = None) -> E | None:
        """The evaluation with the largest hard value that holds the constraints by hard numbers.

        Where none holds them, that with the least ASE among those with the window's area; None
        before the first evaluation. Of equal ones it is that of the highest smooth value at the
        highest sharpness, so that a plateau of the hard metric is not left at its edge.

        Parameters
        ----------
        ase_limit : float, optional
            In place of the goal's [%].
        """
        if not self.steps:
            return None
        limit = self.problem.goal.ase_limit if ase_limit is None else ase_limit
        limit = np.inf if limit is None else limit + 1e-9

        def merit(found: E) -> tuple[float, ...]:
            missing = self.problem.missing_area(found.hard)
            area = missing if missing > AREA_TOLERANCE else 0.0
            over = max(found.hard.ase - limit, 0.0)
            return -area, -over, found.hard.value, found.sharpness, found.smooth.value

        return max((step.found for step in self.steps), key=merit)

    def front(self) -> list[E]:
        """Evaluations that no other one beats in both what is to be large and ASE, by ASE."""
        missing = self.problem.missing_area
        kept = [s.found for s in self.steps if missing(s.found.hard) <= AREA_TOLERANCE]
        kept.sort(key=lambda e: (e.hard.ase, -e.hard.value, -e.sharpness))
        front: list[E] = []
        for found in kept:
            if not front or found.hard.value > front[-1].hard.value:
                front.append(found)
        return front

    @property
    def frame(self) -> pd.DataFrame:
        """One row for each evaluation."""
        return pd.DataFrame(
            [
                {
                    "search": s.label,
                    "seconds": round(s.seconds, 3),
                    **row(self.problem, s.found),
                }
                for s in self.steps
            ]
        )

    def save(self, file: Path) -> None:
        """Write the rows as CSV, whole or not at all."""
        storage.save_text(self.frame.to_csv(index=False, float_format="%.6g"), file)

    @contextmanager
    def until_stopped(self) -> Iterator[list[bool]]:
        """End the work within at Ctrl-C, where there is something to keep; tells whether it was."""
        stopped: list[bool] = []
        try:
            yield stopped
        except (KeyboardInterrupt, RuntimeError) as error:
            if not was_stopped(error) or not self.steps:
                raise
            stopped.append(True)


def row(problem: Searched, found: Evaluation) -> dict[str, float]:
    """Numbers of an evaluation, and its parameters in their own units."""
    aim = "sDA" if problem.goal.aim == "sDA" else "worst_msDA"
    numbers = {
        "sharpness": found.sharpness,
        "value": found.hard.value,
        aim: found.hard.aim,
        "ASE": found.hard.ase,
        "smooth_value": found.smooth.value,
        f"smooth_{aim}": found.smooth.aim,
        "smooth_ASE": found.smooth.ase,
        **problem.numbers(found.hard),
    }
    for key, values in problem.named(found.x).items():
        one = len(values) == 1
        numbers |= {key if one else f"{key}_{i}": float(v) for i, v in enumerate(values)}
    return numbers
