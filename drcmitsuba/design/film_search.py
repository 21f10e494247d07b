"""Search for the film that maximises an objective: gradient ascent from several starts [1]_.

References
----------
.. [1] R. H. Byrd, P. Lu, J. Nocedal, C. Zhu, "A limited memory algorithm for bound constrained
   optimization", SIAM J. Scientific Computing 16(5), 1995.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from drcmitsuba.design.film import LEAST_SPREAD, Film, ParametricFilm
from drcmitsuba.design.film_problem import FilmCandidate, FilmProblem, LitByFilm, Objective
from drcmitsuba.design.search import History, Optimum
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress

RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"tilt": (-30.0, 45.0), "spread": (LEAST_SPREAD, 45.0)}
)
"""Range in which a parametric film is searched [deg]."""

FilmHistory: TypeAlias = History[FilmProblem, FilmCandidate]


@dataclass(frozen=True)
class FilmOptimum(Optimum[FilmProblem, FilmCandidate]):
    """Best film of a search, and all others."""

    @property
    def film(self) -> Any:
        """Best film, with plain numbers as parameters."""
        return replace(self.problem.film, **self.values)

    @property
    def gradient(self) -> dict[str, float]:
        """Derivatives of the objective at the best film, each per unit of its parameter."""
        return dict(zip(self.values, self.best.gradient.tolist(), strict=True))

    @property
    def gradient_error(self) -> dict[str, float]:
        """Standard errors of `gradient`, from the replicates of the year."""
        return dict(zip(self.values, self.problem.gradient_error(self.best).tolist(), strict=True))

    @property
    def is_within_noise(self) -> bool:
        """True if the derivatives are within their noise: only more paths place the film better."""
        return self.problem.is_within_noise(self.best)


def optimise_film(
    year: LitByFilm, objective: Objective, film: Film | None = None, *,
    ranges: Mapping[str, tuple[float, float]] = RANGES, starts: int = 3, iterations: int = 25,
    seed: int = 0, progress: Progress = lambda share: None,
) -> FilmOptimum:  # fmt: skip
    """Search for parameters of a film that maximise an objective.

    Parameters
    ----------
    year : FilmYear
    objective : callable
        Turns the illuminances (time, sensor) [lx] into a `mi.Float` that is maximised.
    film : Film, optional
        Film of the first start, whose other parameters stay fixed; default
        `ParametricFilm(0.6)`.
    ranges : mapping of str to (low, high)
        Free parameters of the film and their ranges.
    starts : int
        Number of starts: the film's own values first, then points spread evenly over the ranges
        (Sobol').
    iterations : int
        Largest number of iterations of a start.
    seed : int
        Seed of the starts.
    progress : callable
        Called with the fraction of the search that is done.

    Returns
    -------
    FilmOptimum
        The best film so far where Ctrl-C stopped the search.

    Raises
    ------
    InputError
        A range is empty, the film has no such parameter, or the objective is not finite.
    KeyboardInterrupt
        The search was stopped before anything was evaluated.

    Notes
    -----
    A start ends where no derivative exceeds a fourth of its standard error: further steps would
    follow the noise. `FilmOptimum.is_within_noise` is then true; more `paths` or `replicates` of
    the case's accuracy would place the film better, more iterations would not.
    """
    if starts < 1:
        raise InputError("optimise_film", "starts", str(starts), "give 1 or more")
    film = ParametricFilm(0.6) if film is None else film
    problem = FilmProblem(year, objective, film, ranges)
    spread = qmc.Sobol(len(ranges), rng=seed).random(1 << (starts - 1).bit_length())
    points = [problem.start, *spread[: starts - 1]]
    ascent = partial(_gradient_ascent, iterations=iterations)
    searches = [partial(ascent, f"start {i}", x) for i, x in enumerate(points, 1)]
    return FilmOptimum.of(History(problem), searches, progress)


def _gradient_ascent(
    label: str, start: np.ndarray, history: FilmHistory, progress: Progress, iterations: int
) -> None:
    """Gradient ascent by L-BFGS-B from one start, until the gradient is within its noise."""
    problem, begin, done = history.problem, len(history), 0

    def descent(x: np.ndarray) -> tuple[float, np.ndarray]:
        candidate = history.evaluate(x, label)
        return -candidate.objective, -candidate.gradient * problem.width

    def look(x: np.ndarray) -> None:
        nonlocal done
        done += 1
        progress(min(done / iterations, 1))
        own = history.candidates[begin:]
        if problem.is_within_noise(min(own, key=lambda c: float(abs(c.x - x).max()))):
            raise StopIteration

    minimize(
        descent, start, jac=True, method="L-BFGS-B", callback=look,
        bounds=[(0, 1)] * len(start),
        options={"maxiter": iterations, "ftol": 1e-6, "gtol": 1e-6},
    )  # fmt: skip
