"""A façade as an optimisation problem: objective and constraints, smooth and hard side by side.

Objective and constraints of one composition, all in per cent:

    maximise   A − cost · (area of the film / area of the tiles)
    subject to ASE ≤ limit,  area of the panes given or within bounds,  hours of glare ≤ limit

with A the sDA, the msDA of the worst month, the least margin of a level of a standard, or the share
of the hours without glare at the worst eye, shade applied. Where the area is the objective:

    maximise   −100 % · (area of the panes / area of the tiles) − cost · …
    subject to A ≥ least,  and as above

or the film's area in place of the panes'.

The optimiser uses the smooth twins and their gradients by reverse mode; every candidate also has
the hard numbers of `metrics`, and only these are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.candidate import UNKNOWN, FacadeCandidate, FacadeScore
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.goal import Goal
from drcmitsuba.design.measure import HARD, Measure, RatedProblem
from drcmitsuba.design.parameters import Factor, Map, Parameter, Values
from drcmitsuba.design.slopes import Graph, LaterSlopes
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.transport.elements.state_illuminances import Illuminances

AREA_TOLERANCE = 2e-3
"""Largest tolerated deviation of the panes' area, as a fraction of the required area."""
HOURS = 480
"""Number of time stamps by which a search comes near to an optimum."""


@dataclass(frozen=True)
class FacadeProblem(RatedProblem):
    """A façade with free parameters, its year, and the goal.

    Parameters
    ----------
    factors : tuple of Factor
        Materials whose transmittance is also a parameter.

    Raises
    ------
    InputError
        Every parameter is fixed, two parameters share a key, or the film is none of the year's
        materials.
    """

    year: FacadeYear
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
        """Parameters that are not fixed."""
        return tuple(p for p in self.parameters if not p.is_fixed)

    @cached_property
    def few_hours(self) -> np.ndarray | None:
        """`HOURS` time stamps, one of each part of the period; None where few are left.

        In equal steps they would fall on some hours of the day more often than on others.
        """
        count = len(self.year.months)
        if count < 2 * HOURS:
            return None
        edges = np.linspace(0, count, HOURS + 1).astype(int)
        return np.random.default_rng(0).integers(edges[:-1], edges[1:])

    @cached_property
    def in_few_hours(self) -> FacadeProblem:
        """Problem of `few_hours`, near the optimum of all; itself where there are none."""
        if self.few_hours is None:
            return self
        year = self.year.at(self.few_hours)
        return replace(self, year=year, goal=self.goal.at(self.few_hours, year.step_hours))

    @property
    def size(self) -> int:
        """Number of free values."""
        return sum(p.count for p in self.free)

    @property
    def start(self) -> np.ndarray:
        """Start, shape (free,): free values as fractions of their ranges, 0 to 1."""
        return self.of_fractions({})

    def films_by_height(self, at: np.ndarray) -> list[np.ndarray]:
        """Designs (free,) of single tiles: a film nowhere, everywhere, above, below, in the middle.

        The tiles lie `at` heights (tile,) between the lowest edge, 0, and the highest, 1. Where the
        windows' area is minimised, the same with the largest windows, of which an aim is likeliest.
        """
        films = (at > 2, at >= 0, at > 0.5, at < 0.5, np.abs(at - 0.5) < 1 / 6)
        windows: list[float | None] = [None]
        least, area = self.goal.least, self.goal.window_area
        if least is not None and least.of == "panes" and area is not None:
            (count,) = (p.count for p in self.parameters if p.key == "window")
            free, whole = (each.sum() for each in np.split(self.year.tiles.area, [count]))
            windows.append(min(1.0, float((area[1] - whole) / free)))
        return [
            self.of_fractions({"film": film.astype(float)} | ({} if w is None else {"window": w}))
            for w in windows
            for film in films
        ]

    def of_fractions(self, fractions: Mapping[str, Any]) -> np.ndarray:
        """Design (free,) of fractions of the ranges by key; other values are those of the start."""
        return np.concatenate(
            [np.full(p.count, fractions.get(p.key, p.start_fraction)) for p in self.free]
        )

    def of_values(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Design (free,) of values in their own units by key; others are those of the start."""
        parts = [
            np.broadcast_to(
                (values[p.key] - p.low) / (p.high - p.low) if p.key in values else p.start_fraction,
                p.count,
            )
            for p in self.free
        ]
        return np.clip(np.concatenate(parts), 0.0, 1.0)

    def named(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters as drawn, in their own units, each of shape (count,)."""
        return self.facade.drawn(self.given(x))

    def given(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters as x gives them, in their own units, each of shape (count,)."""
        x = np.asarray(x, float)
        return self._by_key(np.full, lambda begin, count: x[begin : begin + count])

    def values(self, x: mi.Float) -> dict[str, mi.Float]:
        """Values of all parameters with the gradients of x (free,), each of width count."""
        return self._by_key(
            lambda count, value: dr.full(mi.Float, value, count),
            lambda begin, count: dr.gather(mi.Float, x, dr.arange(mi.UInt32, count) + begin),
        )

    def _by_key(
        self, full: Callable[[int, float], Any], taken: Callable[[int, int], Any]
    ) -> dict[str, Any]:
        """Values by key: `full(count, value)` if fixed, `taken(first, count)` from x if free."""
        values, begin = {}, 0
        for p in self.parameters:
            values[p.key] = full(p.count, p.low)
            if not p.is_fixed:
                values[p.key] = p.low + taken(begin, p.count) * (p.high - p.low)
                begin += p.count
        return values

    def illuminance(self, values: Values) -> tuple[mi.TensorXf, Illuminances]:
        """Composition (tile, material) and E (time, sensor) [lx] at values of the parameters."""
        share = self.facade.share(values)
        return share, self.year.illuminance(share, scale=self.scale(values))

    def scale(self, values: Values) -> dict[str, Any]:
        """Factors of the light that comes in by materials whose transmittance is free."""
        return {
            name: values[factor.parameter.key] / now
            for factor in self.factors
            for name, now in factor.now.items()
        }

    def evaluate(self, x: np.ndarray, sharpness: float) -> FacadeCandidate:
        """Evaluate x (free,), 0 to 1 between the bounds: scores, and gradients of the smooth ones.

        Smooth twins have the given sharpness; with 0, hard numbers alone are computed.
        """
        for slopes in self._latest:  # a search asks for the gradients of a design at once, or never
            slopes.let_go()
        x = np.array(x, float)
        values = self.values(mi.Float(np.clip(x, 0, 1).astype(np.float32)))
        scale = self.scale(values)
        if sharpness == HARD:
            share, E = self.illuminance(values)
            film, window = self._area(share, self.goal.film), self.window_area(share)
            hard = self._hard(share, E, float(film[0]), float(window[0]), scale)
            smooth = replace(UNKNOWN, glare=None if hard.glare is None else np.nan)
            return FacadeCandidate(x, HARD, smooth, hard, share.numpy(), None)
        graph, smooth, share, E = self._graph(x, sharpness)
        hard = self._hard(share, E, smooth.film_area, smooth.window_area, scale)
        self._latest[:] = [LaterSlopes(graph, lambda: self._graph(x, sharpness)[0])]
        return FacadeCandidate(x, sharpness, smooth, hard, share.numpy(), self._latest[0])

    @cached_property
    def _latest(self) -> list[LaterSlopes]:
        """Gradients of the latest design, which may hold their graph; none before the first."""
        return []

    def _graph(
        self, x: np.ndarray, sharpness: float
    ) -> tuple[Graph, FacadeScore, mi.TensorXf, Illuminances]:
        """Smooth numbers of x (free,) with and without gradients, composition and E [lx]."""
        free = mi.Float(np.clip(x, 0, 1).astype(np.float32))
        dr.enable_grad(free)
        values = self.values(free)
        share, E = self.illuminance(values)
        window, film = self.window_area(share), self._area(share, self.goal.film)
        glare, seen = None, self.year.eyes
        if seen is not None:
            weights = self.year.weights(share, self.scale(values))
            glare = self.measure.glare_smooth(seen, weights, E, sharpness)
        aim, ase = self.measure.smooth(E, sharpness, glare)
        value = self._value(aim, film, window)
        smooth = FacadeScore(*(float(v[0]) for v in (value, aim, ase, film, window)))
        outputs = {"value": value, "ase": ase, "area": window}
        if self.goal.least is not None:
            outputs["aim"] = aim
        if glare is not None:
            outputs["glare"] = glare
            smooth = replace(smooth, glare=float(glare[0]))
        return Graph(free, outputs), smooth, share, E

    def hard(self, share: np.ndarray) -> FacadeScore:
        """Rate any composition (tile, material) by hard numbers, such as a named variant."""
        composition = mi.TensorXf(np.asarray(share, np.float32))
        film, window = self._area(composition, self.goal.film), self.window_area(composition)
        E = self.year.illuminance(composition)
        return self._hard(composition, E, float(film[0]), float(window[0]))

    def area_error(self, score: Any) -> float:
        """Deviation of a score's `window_area` as a fraction; 0 within `AREA_TOLERANCE`."""
        if self.goal.window_area is None:
            return 0.0
        low, high = self.goal.window_area
        error = max(low - score.window_area, score.window_area - high, 0.0) / max(high, 1e-9)
        return error if error > AREA_TOLERANCE else 0.0

    def glare_excess(self, score: Any) -> float:
        """Hours with glare beyond their limit [%]; 0 without one."""
        limit = self.goal.glare_limit
        return 0.0 if limit is None else max(score.glare - limit, 0.0)

    def numbers(self, candidate: FacadeCandidate) -> dict[str, float]:
        """Columns of the history: scores [%] and areas [m²]."""
        hard, smooth = candidate.hard, candidate.smooth
        columns = {"film_m2": hard.film_area, "window_m2": hard.window_area}
        if hard.glare is not None and smooth.glare is not None:
            columns |= {"glare": hard.glare, "smooth_glare": smooth.glare}
        return super().numbers(candidate) | columns

    def details(self, candidate: FacadeCandidate) -> dict[str, Any]:
        """Further entries of `optimum.json`: the composition of every tile by material."""
        columns = zip(self.year.materials, candidate.share.T, strict=True)
        entries = {k: [round(float(v), 5) for v in column] for k, column in columns}
        names = getattr(self.year.tiles, "names", ())
        return ({"panes": [*names]} if names else {}) | {"composition": entries}

    @cached_property
    def measure(self) -> Measure:
        """Rules by which the year is rated."""
        goal, year = self.goal, self.year
        return Measure(goal.rules, goal.aim, year.months, year.groups, goal.requirement)

    def _hard(
        self, share: mi.TensorXf, E: Illuminances, film: float, window: float,
        scale: dict[str, mi.Float] | None = None,
    ) -> FacadeScore:  # fmt: skip
        """Hard score of a composition with illuminances E and areas of film and panes [m²]."""
        E = self.year.built(share, E, scale)
        glare, seen = None, self.year.eyes
        if seen is not None:
            glare = self.measure.glare_hard(seen, self.year.weights(share, scale), E)
        aim, ase = self.measure.hard(E, glare)
        value = self._value(aim, film, window)
        return FacadeScore(value, aim, ase, film, window, self.goal.margin(aim), glare)

    def _value(self, aim: Any, film: Any, window: Any) -> Any:
        """Objective [%] of an aim [%] and areas of film and panes [m²]."""
        tiles = float(self.year.tiles.area.sum())
        return self.goal.value(aim, film * (1 / tiles), window * (1 / tiles))

    def window_area(self, share: mi.TensorXf) -> mi.Float:
        """Area of all panes [m²]."""
        return float(self.year.tiles.area.sum()) - self._area(share, "wall")

    def _area(self, share: mi.TensorXf, material: str) -> mi.Float:
        """Area of a material [m²]."""
        tiles, materials = share.shape
        column = dr.arange(mi.UInt32, tiles) * materials + self.year.materials.index(material)
        area = mi.Float(self.year.tiles.area.astype(np.float32))
        return dr.sum(dr.gather(mi.Float, share.array, column) * area)
