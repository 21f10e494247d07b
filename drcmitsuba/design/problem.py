"""What is wanted of a façade, in numbers: objective and constraints, smooth and hard side by side.

Objective and constraints of one composition, all in per cent:

    maximise   A − cost · (area of the film / area of the tiles)
    subject to ASE ≤ limit,  area of the panes given or within bounds

with A the sDA or the msDA of the worst month, shade applied. The optimiser sees the smooth twins
and their gradients by reverse mode; every evaluation has the hard numbers of `metrics` beside them,
and only these are reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.history import AREA_TOLERANCE
from drcmitsuba.design.measure import Aim, Evaluation, Measure, Score
from drcmitsuba.design.parameters import Factor, Map, Parameter, Values
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.transport.facade_basis.year import BasisYear, Illuminances


@dataclass(frozen=True)
class Goal:
    """What is wanted.

    Parameters
    ----------
    rules : Rules
        Thresholds of the metrics and of the shade.
    film : str
        Material whose area costs.
    aim : {'sDA', 'worst month'}
        What is to be large.
    film_cost : float
        Points that a façade full of film has to bring.
    ase_limit : float, optional
        Largest ASE [%].
    window_area : (float, float), optional
        Least and most of all panes together [m²], equal where it is given; else it is free.
    """

    rules: Rules
    film: str
    aim: Aim = "sDA"
    film_cost: float = 0.0
    ase_limit: float | None = None
    window_area: tuple[float, float] | None = None


@dataclass(frozen=True)
class FacadeScore(Score):
    """One composition in numbers.

    Parameters
    ----------
    film_area, window_area : float
        [m²].
    """

    film_area: float
    window_area: float


@dataclass(frozen=True, eq=False)
class Composed(Evaluation):
    """A composition, smooth and hard.

    Parameters
    ----------
    smooth, hard : FacadeScore
    share : np.ndarray, shape (tile, material)
    gradient, ase_gradient, area_gradient : np.ndarray, shape (free,)
        Of the smooth objective, ASE [%] and of the window's area [m²] by x.
    """

    smooth: FacadeScore
    hard: FacadeScore
    share: np.ndarray
    gradient: np.ndarray
    ase_gradient: np.ndarray
    area_gradient: np.ndarray


@dataclass(frozen=True)
class Problem:
    """A façade that may be turned, its year, and what is wanted.

    Parameters
    ----------
    year : BasisYear
    facade : Map
    goal : Goal
    factors : tuple of Factor
        Materials whose transmittance may be turned too.

    Raises
    ------
    InputError
        Nothing may be turned, two parameters share a key, or the film is none of the year's
        materials.
    """

    year: BasisYear
    facade: Map
    goal: Goal
    factors: tuple[Factor, ...] = ()

    def __post_init__(self) -> None:
        keys = [p.key for p in self.parameters]
        if len(set(keys)) < len(keys):
            raise InputError("design", "parameters", f"{sorted(keys)}", "give each its own key")
        if not self.free:
            got = "every value is fixed"
            raise InputError("design", "parameters", got, "give one of them different bounds")
        if self.goal.film not in self.year.materials:
            known = ", ".join(self.year.materials)
            raise InputError("design", "film", f"no material {self.goal.film!r}", f"use {known}")

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, fixed ones too."""
        return (*self.facade.parameters, *(f.parameter for f in self.factors))

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """Those that may be turned."""
        return tuple(p for p in self.parameters if not p.is_fixed)

    @property
    def size(self) -> int:
        """How many numbers may be turned."""
        return sum(p.count for p in self.free)

    @property
    def start(self) -> np.ndarray:
        """Where the parameters start, shape (free,), 0 to 1 between their bounds."""
        at = [np.full(p.count, (p.start - p.low) / (p.high - p.low)) for p in self.free]
        return np.concatenate(at)

    def named(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters, in their own units, each of shape (count,)."""
        found, begin = {}, 0
        for p in self.parameters:
            found[p.key] = np.full(p.count, p.low)
            if not p.is_fixed:
                part = np.asarray(x, float)[begin : begin + p.count]
                found[p.key] = p.low + part * (p.high - p.low)
                begin += p.count
        return found

    def values(self, x: mi.Float) -> dict[str, mi.Float]:
        """Values of all parameters with the gradients of x (free,)."""
        found, begin = {}, 0
        for p in self.parameters:
            found[p.key] = dr.full(mi.Float, p.low, p.count)
            if not p.is_fixed:
                part = dr.gather(mi.Float, x, dr.arange(mi.UInt32, p.count) + begin)
                found[p.key] = p.low + part * (p.high - p.low)
                begin += p.count
        return found

    def illuminance(self, values: Values) -> tuple[mi.TensorXf, Illuminances]:
        """Composition (tile, material) and E of some values."""
        share = self.facade.share(values)
        if not self.factors:
            return share, self.year.illuminance(share)
        scale = {f.material: values[f.parameter.key] / f.now for f in self.factors}
        return share, self.year.illuminance(share, scale=scale)

    def evaluate(self, x: np.ndarray, sharpness: float) -> Composed:
        """Evaluate a composition and its gradients, smooth and hard.

        Parameters
        ----------
        x : np.ndarray, shape (free,)
            0 to 1 between the bounds.
        sharpness : float
            Of the smooth twins.

        Returns
        -------
        Composed
        """
        turned = mi.Float(np.clip(x, 0, 1).astype(np.float32))
        dr.enable_grad(turned)
        share, E = self.illuminance(self.values(turned))
        window, film = self._window_area(share), self._film_area(share)
        aim, ase = self.measure.smooth(E, sharpness)
        value = aim - self._cost(film)
        numbers = [float(v[0]) for v in (value, aim, ase, film, window)]
        gradients = self._gradients(turned, (value, ase, window))
        return Composed(
            x=np.array(x, float),
            share=share.numpy(),
            sharpness=sharpness,
            smooth=FacadeScore(*numbers),
            hard=self._hard(E, film=numbers[3], window=numbers[4]),
            gradient=gradients[0],
            ase_gradient=gradients[1],
            area_gradient=gradients[2],
        )

    def hard(self, share: np.ndarray) -> FacadeScore:
        """Give the hard numbers of any composition (tile, material), such as a named variant."""
        given = mi.TensorXf(np.asarray(share, np.float32))
        film, window = float(self._film_area(given)[0]), float(self._window_area(given)[0])
        return self._hard(self.year.illuminance(given), film, window)

    def is_feasible(self, score: FacadeScore) -> bool:
        """Whether the constraints hold; areas to `AREA_TOLERANCE`."""
        goal = self.goal
        if goal.ase_limit is not None and score.ase > goal.ase_limit + 1e-9:
            return False
        return self.missing_area(score) <= AREA_TOLERANCE

    def missing_area(self, score: FacadeScore) -> float:
        """How far the panes are from the area asked for, of that."""
        if self.goal.window_area is None:
            return 0.0
        low, high = self.goal.window_area
        return max(low - score.window_area, score.window_area - high, 0.0) / max(high, 1e-9)

    def numbers(self, score: FacadeScore) -> dict[str, float]:
        """What the history tells of a composition beside the objective: areas [m²]."""
        return {"film_m2": score.film_area, "window_m2": score.window_area}

    def details(self, found: Composed) -> dict[str, Any]:
        """What else `optimum.json` tells."""
        columns = zip(self.year.materials, found.share.T, strict=True)
        return {"composition": {k: [round(float(v), 5) for v in column] for k, column in columns}}

    @cached_property
    def measure(self) -> Measure:
        """How the year is judged."""
        return Measure(self.goal.rules, self.goal.aim, self.year.months)

    def _hard(self, E: Illuminances, film: float, window: float) -> FacadeScore:
        """Numbers by `metrics`, of illuminances."""
        aim, ase = self.measure.hard(E)
        return FacadeScore(aim - self._cost(film), aim, ase, film, window)

    @staticmethod
    def _gradients(x: mi.Float, outputs: Sequence[mi.Float]) -> list[np.ndarray]:
        """Gradients of several outputs by reverse passes over the one graph."""
        found = []
        for i, y in enumerate(outputs):
            last = i + 1 == len(outputs)
            if dr.grad_enabled(y):
                dr.backward(y, flags=dr.ADFlag.Default if last else dr.ADFlag.ClearInterior)
            found.append(dr.grad(x).numpy().astype(float))
            dr.set_grad(x, 0)
        return found

    def _cost(self, film_area: Any) -> Any:
        """Points that the film costs."""
        return film_area * (self.goal.film_cost / float(self.year.tiles.area.sum()))

    def _film_area(self, share: mi.TensorXf) -> mi.Float:
        """Area of the film [m²]."""
        return self._area(share, self.goal.film)

    def _window_area(self, share: mi.TensorXf) -> mi.Float:
        """Area of all panes [m²]."""
        return float(self.year.tiles.area.sum()) - self._area(share, "wall")

    def _area(self, share: mi.TensorXf, material: str) -> mi.Float:
        """Area of a material [m²]."""
        tiles, materials = share.shape
        column = dr.arange(mi.UInt32, tiles) * materials + self.year.materials.index(material)
        area = mi.Float(self.year.tiles.area.astype(np.float32))
        return dr.sum(dr.gather(mi.Float, share.array, column) * area)
