"""Search for the film that makes the most of an objective, by gradients, from several starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from drcmitsuba.design.film import LEAST_SPREAD, Film, ParametricFilm
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress

Objective = Callable[[Any], Any]
"""From illuminances, mi.TensorXf (time, sensor) [lx], to one number, mi.Float, smooth in them."""
RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"tilt": (-30.0, 45.0), "spread": (LEAST_SPREAD, 45.0)}
)
"""Where a parametric film is searched for [deg]."""


class Step(NamedTuple):
    """One evaluation of the objective.

    Parameters
    ----------
    start : int
        Which start it belongs to.
    values : dict
        Of the parameters.
    objective : float
    """

    start: int
    values: dict[str, float]
    objective: float


@dataclass(frozen=True)
class FilmSearch:
    """What a search found.

    Parameters
    ----------
    film : Film
        The best film that was met, its parameters plain numbers.
    values : dict
        Of its parameters that were searched.
    objective : float
    history : tuple of Step
        All evaluations, in their order; each gave the objective and all its derivatives.
    """

    film: Any
    values: dict[str, float]
    objective: float
    history: tuple[Step, ...]


@dataclass
class _Evaluations:
    """Objective and gradient over the unit cube, with the history."""

    year: FilmYear
    objective: Objective
    film: Any
    ranges: Mapping[str, tuple[float, float]]
    history: list[Step]

    def at(self, u: np.ndarray, start: int) -> tuple[float, np.ndarray]:
        """Negative objective and its gradient."""
        low, high = np.array(list(self.ranges.values())).T
        values = {
            name: mi.Float(float(v))
            for name, v in zip(self.ranges, low + (high - low) * u, strict=True)
        }
        for v in values.values():
            dr.enable_grad(v)
        found = self.objective(self.year.illuminance(replace(self.film, **values)))
        dr.backward(found)
        slope = np.array([float(dr.grad(v)[0]) for v in values.values()])
        value = float(dr.detach(found).numpy().item())
        if not np.isfinite([value, *slope]).all():
            raise InputError(
                "objective", "value", f"{value:g}, derivatives {slope}",
                "give one that is finite and smooth for all illuminances",
            )  # fmt: skip
        plain = {name: float(dr.detach(v)[0]) for name, v in values.items()}
        self.history.append(Step(start, plain, value))
        return -value, -slope * (high - low)


def optimise_film(
    year: FilmYear, objective: Objective, film: Film | None = None, *,
    ranges: Mapping[str, tuple[float, float]] = RANGES, starts: int = 3, most: int = 25,
    seed: int = 0, progress: Progress = lambda share: None,
) -> FilmSearch:  # fmt: skip
    """Search for parameters of a film that maximise an objective, by L-BFGS-B [1]_.

    Parameters
    ----------
    year : FilmYear
    objective : callable
        From the illuminances (time, sensor) to a `mi.Float` that is maximised.
    film : Film, optional
        Has the parameters that stay, and where the first start begins; `ParametricFilm(0.6)` if
        not given.
    ranges : mapping of str to (low, high)
        Parameters of the film that are searched.
    starts : int
        The first from the film's own values, the others spread evenly over the ranges (Sobol').
    most : int
        Iterations of a start, at most.
    seed : int
        Of the starts.
    progress : callable

    Returns
    -------
    FilmSearch

    Raises
    ------
    InputError
        A range is no range, no such parameter, or the objective is not finite.

    References
    ----------
    .. [1] R. H. Byrd, P. Lu, J. Nocedal, C. Zhu, "A limited memory algorithm for bound constrained
       optimization", SIAM J. Scientific Computing 16(5), 1995.
    """
    film = ParametricFilm(0.6) if film is None else film
    if starts < 1:
        raise InputError("optimise_film", "starts", str(starts), "give 1 or more")
    for name, (low, high) in ranges.items():
        if not hasattr(film, name):
            got = f"no parameter {name!r}"
            raise InputError("optimise_film", "ranges", got, f"name those of {type(film).__name__}")
        if not low < high:
            raise InputError("optimise_film", "ranges", f"{name}: {low:g}, {high:g}", "low < high")
    found = _Evaluations(year, objective, film, ranges, [])
    own = [
        (float(dr.detach(mi.Float(getattr(film, name)))[0]) - low) / (high - low)
        for name, (low, high) in ranges.items()
    ]
    others = qmc.Sobol(len(ranges), rng=seed).random(1 << (starts - 1).bit_length())[: starts - 1]
    for start, u in enumerate([np.clip(own, 0, 1), *others]):
        done = iter(range(1, 1 << 30))

        def tell(_: object, start: int = start, done: Any = done) -> None:
            progress((start + min(next(done) / most, 1)) / starts)

        minimize(
            found.at, u, args=(start,), jac=True, method="L-BFGS-B", callback=tell,
            bounds=[(0, 1)] * len(u), options={"maxiter": most, "ftol": 1e-6, "gtol": 1e-6},
        )  # fmt: skip
        progress((start + 1) / starts)
    best = max(found.history, key=lambda step: step.objective)
    return FilmSearch(
        replace(found.film, **best.values), best.values, best.objective, tuple(found.history)
    )
