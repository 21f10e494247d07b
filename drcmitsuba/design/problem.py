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
from typing import Any, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba import metrics, smooth
from drcmitsuba.basis.year import Illuminances, Year
from drcmitsuba.design.parameters import Factor, Map, Parameter, Values
from drcmitsuba.errors import InputError
from drcmitsuba.uncertainty.rules import Rules

Aim = Literal["sDA", "worst month"]
AREA_TOLERANCE = 2e-3
"""Of the window's area: what it may be off by."""
SOFTEST = 50.0
"""Points of msDA over the sharpness: how near months count as the worst together."""


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
class Score:
    """One composition in numbers.

    Parameters
    ----------
    value : float
        The objective [%].
    aim, ase : float
        What is to be large, and ASE [%].
    film_area, window_area : float
        [m²].
    """

    value: float
    aim: float
    ase: float
    film_area: float
    window_area: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A composition, smooth and hard.

    Parameters
    ----------
    x : np.ndarray, shape (free,)
        Free values, 0 to 1 between their bounds.
    share : np.ndarray, shape (tile, material)
    sharpness : float
        Of the smooth numbers.
    smooth, hard : Score
    gradient, ase_gradient, area_gradient : np.ndarray, shape (free,)
        Of the smooth objective, ASE [%] and of the window's area [m²] by x.
    """

    x: np.ndarray
    share: np.ndarray
    sharpness: float
    smooth: Score
    hard: Score
    gradient: np.ndarray
    ase_gradient: np.ndarray
    area_gradient: np.ndarray


@dataclass(frozen=True)
class Problem:
    """A façade that may be turned, its year, and what is wanted.

    Parameters
    ----------
    year : Year
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

    year: Year
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

    def evaluate(self, x: np.ndarray, sharpness: float) -> Evaluation:
        """Evaluate a composition and its gradients, smooth and hard.

        Parameters
        ----------
        x : np.ndarray, shape (free,)
            0 to 1 between the bounds.
        sharpness : float
            Of the smooth twins.

        Returns
        -------
        Evaluation
        """
        turned = mi.Float(np.clip(x, 0, 1).astype(np.float32))
        dr.enable_grad(turned)
        share, E = self.illuminance(self.values(turned))
        value, aim, ase = self._smooth(share, E, sharpness)
        window, film = self._window_area(share), self._film_area(share)
        numbers = [float(v[0]) for v in (value, aim, ase, film, window)]
        gradients = self._gradients(turned, (value, ase, window))
        return Evaluation(
            x=np.array(x, float),
            share=share.numpy(),
            sharpness=sharpness,
            smooth=Score(*numbers),
            hard=self._hard(E, film=numbers[3], window=numbers[4]),
            gradient=gradients[0],
            ase_gradient=gradients[1],
            area_gradient=gradients[2],
        )

    def hard(self, share: np.ndarray) -> Score:
        """Give the hard numbers of any composition (tile, material), such as a named variant."""
        given = mi.TensorXf(np.asarray(share, np.float32))
        film, window = float(self._film_area(given)[0]), float(self._window_area(given)[0])
        return self._hard(self.year.illuminance(given), film, window)

    def is_feasible(self, score: Score) -> bool:
        """Whether the constraints hold; areas to `AREA_TOLERANCE`."""
        goal = self.goal
        if goal.ase_limit is not None and score.ase > goal.ase_limit + 1e-9:
            return False
        return self.missing_area(score) <= AREA_TOLERANCE

    def missing_area(self, score: Score) -> float:
        """How far the panes are from the area asked for, of that."""
        if self.goal.window_area is None:
            return 0.0
        low, high = self.goal.window_area
        return max(low - score.window_area, score.window_area - high, 0.0) / max(high, 1e-9)

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

    def _smooth(
        self, share: mi.TensorXf, E: Illuminances, k: float
    ) -> tuple[mi.Float, mi.Float, mi.Float]:
        """Objective, what is to be large, and ASE [%], with gradients."""
        rules, t = self.goal.rules, self.goal.rules.metrics
        closed = smooth.shade_closed(E.direct, rules.shade_threshold, rules.shade_area, sharpness=k)
        total = smooth.applied(E.open, E.shaded, closed)
        if self.goal.aim == "sDA":
            aim = smooth.sda(total, t.sda_threshold, t.sda_fraction, sharpness=k)
        else:
            months = smooth.msda(
                total, self.year.months, t.sda_threshold, t.sda_fraction, sharpness=k
            )
            aim = _soft_least(months.array, k / SOFTEST)
        ase = smooth.ase(E.direct, t.ase_threshold, t.ase_hours, rules.step_hours, sharpness=k)
        return aim - self._cost(self._film_area(share)), aim, ase

    def _hard(self, E: Illuminances, film: float, window: float) -> Score:
        """Numbers by `metrics`, of illuminances."""
        rules, t = self.goal.rules, self.goal.rules.metrics
        direct, is_open, shaded = (v.numpy() for v in (E.direct, E.open, E.shaded))
        sun = _dated(direct, self.year.months)
        closed = metrics.shade_closed(sun, rules.shade_threshold, rules.shade_area).values
        total = _dated(np.where(closed[:, None], shaded, is_open), self.year.months)
        if self.goal.aim == "sDA":
            aim = metrics.sda(total, t.sda_threshold, t.sda_fraction)
        else:
            aim = float(np.nanmin(metrics.msda(total, t.sda_threshold, t.sda_fraction)))
        ase = metrics.ase(sun, t.ase_threshold, t.ase_hours, rules.step_hours)
        return Score(aim - self._cost(film), aim, ase, film, window)

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


def _soft_least(values: mi.Float, beta: float) -> mi.Float:
    """Smooth minimum −ln(mean exp(−β·v)) / β; tends to the least as β grows."""
    least = dr.detach(dr.min(values))
    return least - dr.log(dr.mean(dr.exp((least - values) * beta))) / beta


def _dated(values: np.ndarray, months: np.ndarray) -> xr.DataArray:
    """Illuminance with a date in its month for each time stamp."""
    dates = np.datetime64("2001-01", "M") + (np.asarray(months) - 1)
    return xr.DataArray(values, {"time": dates.astype("M8[ns]")}, ("time", "sensor"))
