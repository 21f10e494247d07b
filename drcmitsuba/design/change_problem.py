"""The least change of a façade that reaches a level of a standard, as an optimisation problem.

    minimise   A(x) = Σ_tile area · ½ Σ_material |share(x) − share now|
    subject to the level is reached,  area of the panes as in [design]

A is the area that another material takes [m²].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.problem import FacadeProblem, gradients
from drcmitsuba.design.requirement import Requirement
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.standards.verdict import Outcome

SAME = 1e-4
"""Changed area that counts as none, as a fraction of the tiles' area."""


@dataclass(frozen=True)
class Slopes:
    """Smooth margins of a façade and the gradients by x, fractions of the ranges.

    Parameters
    ----------
    margins : np.ndarray, shape (margin,)
    by_margin : np.ndarray, shape (margin, free)
    changed, window : np.ndarray, shape (free,)
        Gradients of the changed area and of the panes' area [m²].
    """

    margins: np.ndarray
    by_margin: np.ndarray
    changed: np.ndarray
    window: np.ndarray


@dataclass(frozen=True, eq=False)
class ChangeCandidate:
    """One façade, judged by the standard's count.

    Parameters
    ----------
    x : np.ndarray, shape (free,)
        Free values as fractions of their ranges, 0 to 1.
    share : np.ndarray, shape (tile, material)
    changed, window_area : float
        Area that changes, and area of all panes [m²].
    outcome : Outcome
    margins : np.ndarray, shape (margin,)
        Hard margins, from `Requirement.hard`.
    slopes : Slopes, optional
        None where no gradient was asked for.
    """

    x: np.ndarray
    share: np.ndarray
    changed: float
    window_area: float
    outcome: Outcome
    margins: np.ndarray
    slopes: Slopes | None

    @property
    def objective(self) -> float:
        """Changed area with its sign turned [m²]: searches maximise."""
        return -self.changed


@dataclass(frozen=True)
class ChangeProblem:
    """A façade with free parameters, the level that it has to reach, and the façade as it is.

    Parameters
    ----------
    facade : FacadeProblem
        Parameters, year and limits of the panes' area; its objective plays no part.
    requirement : Requirement
    now : np.ndarray, shape (tile, material)
        Composition as it is.

    Raises
    ------
    InputError
        No values of the parameters within their bounds give the façade as it is.
    """

    facade: FacadeProblem
    requirement: Requirement
    now: np.ndarray

    def __post_init__(self) -> None:
        values = self.facade.facade.values_of(self.now)
        for p in self.facade.parameters:
            v = values[p.key]
            slack = 1e-6 * max(1.0, abs(p.high))
            if (v < p.low - slack).any() or (v > p.high + slack).any():
                got = f"{p.key} is {np.asarray(v).ravel()[0]:.3g} as the façade is now"
                remedy = f"give a range that holds it, not {p.low:.3g} to {p.high:.3g}"
                raise InputError("design", p.key, got, remedy)
        if self.changed(self.start) > SAME * float(self.facade.year.tiles.area.sum()):
            got = "the façade as it is now is not one window with one film"
            raise InputError("design", "parameters", got, 'give parameters = "strips"')

    @property
    def size(self) -> int:
        """Number of free values."""
        return self.facade.size

    @cached_property
    def start(self) -> np.ndarray:
        """Free values of the façade as it is, fractions of their ranges, shape (free,)."""
        values = self.facade.facade.values_of(self.now)
        parts = [(values[p.key] - p.low) / (p.high - p.low) for p in self.facade.free]
        return np.clip(np.concatenate(parts), 0.0, 1.0)

    def start_towards(self, x: np.ndarray) -> np.ndarray:
        """Values of the façade as it is, shape (free,), taken from x where they change nothing.

        Such a value is the place of a film where there is no film.
        """
        start = self.start
        for i in range(len(start)):
            moved = start.copy()
            moved[i] = x[i]
            start = moved if self.is_same(moved) else start
        return start

    def is_same(self, x: np.ndarray) -> bool:
        """Whether x (free,) is the façade as it is."""
        return self.changed(x) <= SAME * float(self.facade.year.tiles.area.sum())

    def changed(self, x: np.ndarray) -> float:
        """Area that changes at x (free,) [m²]."""
        values = self.facade.values(mi.Float(np.asarray(x, np.float32)))
        return float(self._changed(self.facade.facade.share(values))[0])

    def evaluate(self, x: np.ndarray, sharpness: float | None = None) -> ChangeCandidate:
        """Evaluate x (free,), 0 to 1: by hard numbers, and with slopes at a sharpness."""
        x = np.clip(np.asarray(x, float), 0, 1)
        free = mi.Float(x.astype(np.float32))
        if sharpness is not None:
            dr.enable_grad(free)
        share, E = self.facade.illuminance(self.facade.values(free))
        changed, window = self._changed(share), self.facade.window_area(share)
        slopes = None
        if sharpness is not None:
            smooth = self.requirement.smooth(E, sharpness)
            of_changed, of_window, *by_margin = gradients(free, (changed, window, *smooth))
            margins = np.array([float(dr.detach(m)[0]) for m in smooth])
            slopes = Slopes(margins, np.array(by_margin), of_changed, of_window)
        outcome, hard = self.requirement.hard(E)
        areas = float(changed[0]), float(window[0])
        return ChangeCandidate(x, share.numpy(), *areas, outcome, hard, slopes)

    def named(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters in their own units, each of shape (count,)."""
        return self.facade.named(x)

    def holds(self, candidate: ChangeCandidate) -> bool:
        """Whether a façade reaches the level, with an area of panes that [design] allows."""
        return candidate.outcome.reached and self.facade.area_error(candidate) == 0

    def merit(self, candidate: ChangeCandidate) -> tuple[float, ...]:
        """Sort key: the least change that holds; if none does, the largest of the least margins."""
        holds = self.holds(candidate)
        value = -candidate.changed if holds else candidate.outcome.margin.slack
        return -self.facade.area_error(candidate), float(holds), value

    def numbers(self, candidate: ChangeCandidate) -> dict[str, float]:
        """Areas [m²] and the hard margin that decides, in its own unit."""
        margin = candidate.outcome.margin
        areas = {"changed_m2": candidate.changed, "window_m2": candidate.window_area}
        return areas | {margin.quantity: margin.value}

    def details(self, candidate: ChangeCandidate) -> dict[str, Any]:
        """Composition of every tile by material."""
        columns = zip(self.facade.year.materials, candidate.share.T, strict=True)
        return {"composition": {k: [round(float(v), 5) for v in column] for k, column in columns}}

    def _changed(self, share: mi.TensorXf) -> mi.Float:
        """Area that other materials take than now [m²]."""
        weight = np.repeat(self.facade.year.tiles.area / 2, self.now.shape[1])
        return dr.sum(dr.abs(share.array - flat(self.now)) * flat(weight))
