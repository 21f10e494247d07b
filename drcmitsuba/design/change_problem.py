"""The least change of a façade that reaches a level of a standard, as an optimisation problem.

    minimise   A(x) = Σ_tile area · ½ Σ_material |share(x) − share now|
    subject to the level is reached,  area of the panes as in [design]

A is the area that another material takes [m²]. Where glazing has a free transmittance, all panes of
another one that stay as they are count, too; a search by gradients lets them count by degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.change import SAME_VALUE
from drcmitsuba.design.parameters import Factor, Values
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.requirement import Requirement
from drcmitsuba.design.slopes import gradients
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.standards.verdict import Outcome

DIGITS = 4
"""Digits of areas that are compared, in single precision [m²]."""
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
        Gradients of the changed area by degrees and of the panes' area [m²].
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
    by_degrees : float
        Area that changes, panes of another transmittance by the part of its range [m²].
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
    by_degrees: float
    outcome: Outcome
    margins: np.ndarray
    slopes: Slopes | None

    @property
    def cost(self) -> tuple[float, float]:
        """Areas by which changes are compared, see `ChangeProblem.cost` [m²]."""
        return round(self.changed, DIGITS), self.by_degrees

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
    glass : dict of str to float
        Area of all panes as they are by their material [m²], where a transmittance is free.

    Raises
    ------
    InputError
        No values of the parameters within their bounds give the façade as it is, or panes of one
        parameter have several transmittances.
    """

    facade: FacadeProblem
    requirement: Requirement
    now: np.ndarray
    glass: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = self.values_now
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
    def in_few_hours(self) -> ChangeProblem:
        """Problem of `FacadeProblem.few_hours`; itself where there are none."""
        facade, hours = self.facade.in_few_hours, self.facade.few_hours
        if hours is None:
            return self
        asked = self.requirement.at_hours(hours, facade.year.step_hours)
        return replace(self, facade=facade, requirement=asked)

    @cached_property
    def values_now(self) -> Mapping[str, np.ndarray]:
        """Values of the parameters of the façade as it is, (count,) each."""
        values = dict(self.facade.facade.values_of(self.now))
        for factor in self.facade.factors:
            own = {name: tau for name, tau in factor.now.items() if self.glass.get(name)}
            first, *others = (own or factor.now).values()
            if any(abs(tau - first) > SAME_VALUE for tau in others):
                told = ", ".join(f"{name} {tau:g}" for name, tau in own.items())
                remedy = "name panes of one transmittance, or give no range"
                raise InputError("design", factor.parameter.key, f"panes have {told}", remedy)
            values[factor.parameter.key] = np.array([first])
        return values

    @cached_property
    def start(self) -> np.ndarray:
        """Free values of the façade as it is, fractions of their ranges, shape (free,)."""
        return self.facade.of_values(self.values_now)

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
        return self._areas(x)[0]

    def cost(self, x: np.ndarray) -> tuple[float, float]:
        """Area that changes at x (free,), and, where that is the same, by degrees [m²]."""
        changed, by_degrees = self._areas(x)
        return round(changed, DIGITS), by_degrees

    def _areas(self, x: np.ndarray) -> tuple[float, float]:
        values = self.facade.values(mi.Float(np.asarray(x, np.float32)))
        changed, by_degrees = self._changed(self.facade.facade.share(values), values)
        return changed, float(by_degrees[0])

    def evaluate(self, x: np.ndarray, sharpness: float | None = None) -> ChangeCandidate:
        """Evaluate x (free,), 0 to 1: by hard numbers, and with slopes at a sharpness."""
        x = np.clip(np.asarray(x, float), 0, 1)
        free = mi.Float(x.astype(np.float32))
        if sharpness is not None:
            dr.enable_grad(free)
        values = self.facade.values(free)
        share, E = self.facade.illuminance(values)
        window = self.facade.window_area(share)
        changed, by_degrees = self._changed(share, values)
        slopes = None
        if sharpness is not None:
            smooth = self.requirement.smooth(E, sharpness)
            of_changed, of_window, *by_margin = gradients(free, (by_degrees, window, *smooth))
            margins = np.array([float(dr.detach(m)[0]) for m in smooth])
            slopes = Slopes(margins, np.array(by_margin), of_changed, of_window)
        outcome, hard = self.requirement.hard(E)
        areas = changed, float(window[0]), float(by_degrees[0])
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
        slack = candidate.outcome.margin.slack
        value = tuple(-area for area in candidate.cost) if holds else (slack, 0.0)
        return -self.facade.area_error(candidate), float(holds), *value

    def numbers(self, candidate: ChangeCandidate) -> dict[str, float]:
        """Areas [m²] and the hard margin that decides, in its own unit."""
        margin = candidate.outcome.margin
        areas = {"changed_m2": candidate.changed, "window_m2": candidate.window_area}
        return areas | {margin.quantity: margin.value}

    def details(self, candidate: ChangeCandidate) -> dict[str, Any]:
        """Composition of every tile by material."""
        columns = zip(self.facade.year.materials, candidate.share.T, strict=True)
        return {"composition": {k: [round(float(v), 5) for v in column] for k, column in columns}}

    def replaced(self, candidate: ChangeCandidate) -> dict[str, float]:
        """Area of panes that stay, but with another transmittance, by parameter [m²]."""
        return self._replaced(candidate.share, self.facade.named(candidate.x))

    def _replaced(self, share: np.ndarray, values: Values) -> dict[str, float]:
        """Area of panes with another transmittance than now, by parameter [m²].

        What another material takes of them (tile, material) is left out.
        """
        film, lost = self.facade.goal.film, np.maximum(self.now - share, 0)
        own = [name not in ("wall", film) for name in self.facade.year.materials]
        taken = float(self.facade.year.tiles.area @ lost[:, own].sum(axis=1))
        areas = {}
        for factor in self.facade.factors:
            key = factor.parameter.key
            moved = float(dr.detach(values[key])[0]) - float(self.values_now[key][0])
            if abs(moved) > SAME_VALUE:
                areas[key] = max(self._glass(factor) - taken, 0.0)
        return areas

    def _glass(self, factor: Factor) -> float:
        """Area of all panes of a factor's materials [m²]."""
        return sum(self.glass.get(name, 0.0) for name in factor.now)

    def _changed(self, share: mi.TensorXf, values: Values) -> tuple[float, mi.Float]:
        """Area that other materials take than now, or glass of another transmittance [m²].

        The second one counts the panes by the part of the range that their transmittance moves.
        """
        weight = np.repeat(self.facade.year.tiles.area / 2, self.now.shape[1])
        moved = dr.sum(dr.abs(share.array - flat(self.now)) * flat(weight))
        if not self.facade.factors:
            return float(moved[0]), moved
        by_degrees = moved
        for factor in self.facade.factors:
            p = factor.parameter
            if p.is_fixed:
                continue  # it cannot move
            way = dr.abs(values[p.key] - float(self.values_now[p.key][0])) / (p.high - p.low)
            by_degrees = by_degrees + self._glass(factor) * way
        return float(moved[0]) + sum(self._replaced(share.numpy(), values).values()), by_degrees
