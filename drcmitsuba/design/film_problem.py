"""A film as an optimisation problem: objective, derivatives, and the noise of the derivatives.

An objective is any smooth function of the year's illuminances. Reverse mode differentiates the
estimate of the objective exactly, but other paths give another estimate. The replicates measure
how much the derivatives differ between paths.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.film import Film
from drcmitsuba.runtime.errors import InputError

NOISE_PART = 0.25
"""Derivatives below this fraction of their standard errors count as zero: the film is then within
the same fraction of its own standard error from the film at which they vanish."""
NEAR = 4.0
"""Errors are estimated afresh where derivatives are below this many times that fraction."""


class LitByFilm(Protocol):
    """A year whose light depends on a film, such as `FilmYear`.

    Standard errors of derivatives need a method `leave_one_out`, which iterates over the years
    without one replicate each.
    """

    def illuminance(self, film: Film) -> Any:
        """Argument of the objective, with the gradients of the film's parameters."""


Objective = Callable[[Any], Any]
"""Turns `year.illuminance(film)`, for `FilmYear` E (time, sensor) [lx], into one mi.Float."""


def gradient(
    year: LitByFilm, objective: Objective, film: Any, values: Mapping[str, float]
) -> tuple[float, np.ndarray]:
    """Evaluate an objective and its derivatives (parameter,) by parameters of a film.

    Derivatives are taken at `values` of these parameters, each per unit of its parameter.

    Raises
    ------
    InputError
        The objective or a derivative is not finite.
    """
    attached = {name: mi.Float(value) for name, value in values.items()}
    dr.enable_grad(attached)
    value = objective(year.illuminance(replace(film, **attached)))
    dr.backward(value)
    slopes = np.array([float(dr.grad(v)[0]) for v in attached.values()])
    number = float(dr.detach(value).numpy().item())
    if not np.isfinite([number, *slopes]).all():
        raise InputError(
            "objective", "value", f"{number:g}, derivatives {slopes}",
            "give one that is finite and smooth for all illuminances",
        )  # fmt: skip
    return number, slopes


def gradient_error(
    year: LitByFilm, objective: Objective, film: Any, values: Mapping[str, float]
) -> np.ndarray:
    """Estimate the standard errors (parameter,) of `gradient` by the delete-one jackknife [1]_.

    Every replicate is left out once, se² = (n − 1)/n Σ (g₍ᵣ₎ − ḡ)², so that the error contains the
    noise of the light as well as that of the point at which the objective is differentiated. The
    time is that of n gradients, with n the number of replicates. Errors are NaN where the year has
    no `leave_one_out`.

    References
    ----------
    .. [1] B. Efron, C. Stein, "The jackknife estimate of variance", Annals of Statistics 9, 1981.
    """
    if not hasattr(year, "leave_one_out"):
        return np.full(len(values), np.nan)
    years = year.leave_one_out()
    slopes = np.stack([gradient(each, objective, film, values)[1] for each in years])
    return np.sqrt((len(slopes) - 1) * slopes.var(axis=0))


@dataclass(frozen=True, eq=False)
class FilmCandidate:
    """One film: x (parameter,), 0 to 1 within the ranges, its objective and gradient (parameter,).

    The gradient has the derivatives per unit of the parameters.
    """

    x: np.ndarray
    objective: float
    gradient: np.ndarray


@dataclass(frozen=True, eq=False)
class FilmProblem:
    """A film with free parameters in `ranges` (low, high), its year, and the objective.

    The film's other parameters stay fixed.

    Raises
    ------
    InputError
        A range's low end is not below its high end, or the film has no such parameter.
    """

    year: LitByFilm
    objective: Objective
    film: Any
    ranges: Mapping[str, tuple[float, float]]
    _errors: dict[bytes, np.ndarray] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        for name, (low, high) in self.ranges.items():
            if not hasattr(self.film, name):
                remedy = f"name those of {type(self.film).__name__}"
                raise InputError("optimise_film", "ranges", f"no parameter {name!r}", remedy)
            if not low < high:
                got = f"{name}: {low:g}, {high:g}"
                raise InputError("optimise_film", "ranges", got, "low < high")

    @property
    def start(self) -> np.ndarray:
        """Parameters of the given film as fractions of their ranges, 0 to 1, (parameter,)."""
        values = [float(dr.detach(mi.Float(getattr(self.film, name)))[0]) for name in self.ranges]
        return np.clip((np.array(values) - self.low) / self.width, 0, 1)

    @property
    def low(self) -> np.ndarray:
        """Lower ends of the ranges, shape (parameter,)."""
        return np.array([low for low, _ in self.ranges.values()])

    @property
    def width(self) -> np.ndarray:
        """Widths of the ranges, shape (parameter,)."""
        return np.array([high - low for low, high in self.ranges.values()])

    def named(self, x: np.ndarray) -> dict[str, float]:
        """Values of the parameters in their own units, rounded to float32."""
        values = np.float32(self.low + self.width * x)
        return {name: float(value) for name, value in zip(self.ranges, values, strict=True)}

    def evaluate(self, x: np.ndarray) -> FilmCandidate:
        """Evaluate a film and its derivatives, x (parameter,) 0 to 1 within the ranges."""
        value, slopes = gradient(self.year, self.objective, self.film, self.named(x))
        return FilmCandidate(np.array(x, float), value, slopes)

    def gradient_error(self, candidate: FilmCandidate) -> np.ndarray:
        """Standard errors of the candidate's derivatives per unit; estimated once."""
        key = candidate.x.tobytes()
        if key not in self._errors:
            values = self.named(candidate.x)
            self._errors[key] = gradient_error(self.year, self.objective, self.film, values)
        return self._errors[key]

    def is_within_noise(self, candidate: FilmCandidate) -> bool:
        """True if no derivative that leads inside the ranges exceeds a fourth of its error.

        The candidate's own errors are estimated only where the latest errors leave it in doubt.
        """
        outwards = ((candidate.x <= 0) & (candidate.gradient < 0)) | (
            (candidate.x >= 1) & (candidate.gradient > 0)
        )
        slopes = np.where(outwards, 0.0, abs(candidate.gradient))
        if self._errors:
            latest = next(reversed(self._errors.values()))
            if (slopes > NEAR * NOISE_PART * latest).any():
                return False
        return bool((slopes <= NOISE_PART * self.gradient_error(candidate)).all())

    def merit(self, candidate: FilmCandidate) -> tuple[float, ...]:
        """Sort key of candidates: the objective."""
        return (candidate.objective,)

    def holds(self, candidate: FilmCandidate) -> bool:
        """True: there are no constraints."""
        return True

    def numbers(self, candidate: FilmCandidate) -> dict[str, float]:
        """Columns of the history: objective and derivatives per unit."""
        slopes = zip(self.ranges, candidate.gradient, strict=True)
        return {"objective": candidate.objective} | {f"by_{k}": float(v) for k, v in slopes}

    def details(self, candidate: FilmCandidate) -> dict[str, Any]:
        """Further entries of `optimum.json`: standard errors of the derivatives per unit."""
        errors = zip(self.ranges, self.gradient_error(candidate), strict=True)
        entries: dict[str, Any] = {f"by_{name}_se": float(v) for name, v in errors if v == v}
        return entries | {"within_noise": self.is_within_noise(candidate)}
