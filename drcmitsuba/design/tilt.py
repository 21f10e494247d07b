"""Tilt of lamellae as a design variable, by simulations that share their random numbers.

A façade with components has no basis: mirrors that turn send light elsewhere, and every tilt is a
simulation of its own. Differences take the place of gradients,

    dE/dθ = [E(θ + h) − E(θ − h)] / 2h,

one-sided at the bounds. The derivative of the estimate along one path of light would miss what
moves with the edges of the mirrors, of their shadows and of the sun's disk, since a path is either
on the mirror or beside it: a boundary term, which a difference has in it. Simulations of all tilts
take the same seed [1]_: photons start from the same points of ports, sun and sky, and noise leaves
the difference as far as they end in the same cells and squares. That is most of it over a tenth of
a degree, and little over two: a mirror turns light by twice its own turn. Wider steps have less
noise nevertheless, since it is divided by them.

References
----------
.. [1] P. Glasserman, D. Yao, "Some guidelines and guarantees for common random numbers",
   Management Science 38, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.components import StructureComponent
from drcmitsuba.case.toml import shortened
from drcmitsuba.design.measure import Aim, Evaluation, Measure, Score
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.metrics import Interval, accumulate, illuminance
from drcmitsuba.metrics.evaluate_metrics import evaluate_metrics, may_close, rules
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part, silent
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene import components
from drcmitsuba.scene.structures.recipe import Lamellae, load_recipe
from drcmitsuba.schema import luminance
from drcmitsuba.sky.daylight import Daylight, daylight, sources
from drcmitsuba.transport.facade_basis.year import Illuminances


class TiltGoal(NamedTuple):
    """What is wanted.

    Parameters
    ----------
    aim : {'sDA', 'worst month'}
        What is to be large.
    ase_limit : float
        Largest ASE [%].
    """

    aim: Aim
    ase_limit: float


class Simulated(NamedTuple):
    """A year with the lamellae at one tilt.

    Parameters
    ----------
    E : Illuminances
        `shaded` is `open` where there is no direct sun, since no shade closes there.
    aim : Interval
        95 % interval of what is to be large [%].
    """

    E: Illuminances
    aim: Interval


class Slope(NamedTuple):
    """How numbers of a year change with the tilt, by smooth twins.

    Parameters
    ----------
    value, ase : float
        Of the objective and of ASE [% per deg].
    """

    value: float
    ase: float


@dataclass(frozen=True)
class Turned:
    """Lamellae that may be tilted, their year, and what is wanted.

    Parameters
    ----------
    case : Case
    component : str
    light : Daylight
    goal : TiltGoal
    tilt : Parameter
        [deg].
    step : float
        Of the differences [deg].
    known : dict of float to Simulated
        By tilt [deg]; no tilt is simulated twice.

    Notes
    -----
    A year of 2610 hours and 576 sensors is 18 MB for every tilt. Where the lamellae are wider than
    their period, a steep tilt may cost the strip one of them: there the objective has a step.
    """

    case: Case
    component: str
    light: Daylight
    goal: TiltGoal
    tilt: Parameter
    step: float
    known: dict[float, Simulated] = field(default_factory=dict, compare=False)

    @classmethod
    def of(cls, case: Case, stage: Stage = silent) -> Turned:
        """Read it from a case.

        Raises
        ------
        InputError
            The component has no lamellae, they do not fit into their panes at all tilts, or the
            weather is unfit.
        """
        design = case.design
        if design is None or design.component is None:
            got, remedy = "no component is named", 'add component = "…", lamellae of [components]'
            raise InputError(case.source, "design", got, remedy)
        case.refuse_overruled("the search for a tilt")
        component = case.components[design.component]
        assert isinstance(component, StructureComponent)
        structure = load_recipe(component.recipe).structure
        if not isinstance(structure, Lamellae):
            got = f"the recipe of {shortened(design.component)} is of kind {structure.kind}"
            raise InputError(case.source, "design.component", got, "only lamellae are tilted")
        now = structure.tilt if component.tilt is None else component.tilt
        low, high = design.tilt
        tilt = Parameter("tilt", low, high, min(max(now, low), high))
        for end in design.tilt:
            components.place(_tilted(case, design.component, end))
        with stage("sky"):
            light = daylight(case)
        goal = TiltGoal(design.objective, design.ase_limit)
        return cls(case, design.component, light, goal, tilt, design.tilt_step)

    @property
    def measure(self) -> Measure:
        """How a year is judged."""
        asked = rules(self.case, self.light.step_hours)
        return Measure(asked, self.goal.aim, self.light.sky["clock"].dt.month.values)

    def built(self, tilt: float) -> Case:
        """Case with its lamellae at a tilt [deg]."""
        return _tilted(self.case, self.component, tilt)

    def afresh(self, tilt: float) -> Case:
        """Case at a tilt with another seed, for numbers that the search has not chosen."""
        seed = launch_seed(self.case.accuracy.seed, Stream.FRESH_SEED) >> 2  # below a case's limit
        accuracy = self.case.accuracy.model_copy(update={"seed": seed})
        return self.built(tilt).model_copy(update={"accuracy": accuracy})

    def at(self, x: np.ndarray) -> float:
        """Tilt [deg] of a free value; rounded, so that the same tilt is known as the same."""
        return round(self.tilt.low + float(np.ravel(x)[0]) * (self.tilt.high - self.tilt.low), 4)

    def free(self, tilt: float) -> np.ndarray:
        """Free value of a tilt [deg], shape (1,), 0 to 1 between the bounds."""
        return np.array([(tilt - self.tilt.low) / (self.tilt.high - self.tilt.low)])

    def simulate(self, tilt: float, progress: Progress = lambda share: None) -> Simulated:
        """Simulate a tilt [deg], unless it is known, with the case's seed."""
        if tilt not in self.known:
            self.known[tilt] = self._simulated(self.built(tilt), progress)
        return self.known[tilt]

    def evaluate(self, x: np.ndarray, sharpness: float) -> Evaluation:
        """Evaluate a tilt, smooth and hard.

        Parameters
        ----------
        x : np.ndarray, shape (1,)
            0 to 1 between the bounds.
        sharpness : float
            Of the smooth twins.
        """
        E = self.simulate(self.at(x)).E
        aim, ase = (float(v[0]) for v in self.measure.smooth(E, sharpness))
        hard = self.measure.hard(E)
        return Evaluation(
            np.array(x, float), sharpness, Score(aim, aim, ase), Score(hard[0], *hard)
        )

    def beside(self, tilt: float) -> tuple[float, float]:
        """Tilts that the difference at a tilt is taken between [deg]."""
        low, high = max(tilt - self.step, self.tilt.low), min(tilt + self.step, self.tilt.high)
        return round(low, 4), round(high, 4)

    def slope(self, x: np.ndarray, sharpness: float) -> Slope:
        """Differences of the smooth numbers at a tilt, over `step` to both sides.

        One-sided where a bound is nearer. Limits: they have the noise of a difference between two
        tilts, which is not told, and the curvature within the step.
        """
        low, high = self.beside(self.at(x))
        a, b = (self.evaluate(self.free(tilt), sharpness).smooth for tilt in (low, high))
        return Slope((b.value - a.value) / (high - low), (b.ase - a.ase) / (high - low))

    def named(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters [deg]."""
        return {self.tilt.key: np.array([self.at(x)])}

    def missing_area(self, score: Score) -> float:
        """None: the panes stay as they are."""
        return 0.0

    def is_feasible(self, score: Score) -> bool:
        """Whether ASE holds its limit."""
        return score.ase <= self.goal.ase_limit + 1e-9

    def numbers(self, score: Score) -> dict[str, float]:
        """Further columns of the history: none."""
        return {}

    def details(self, found: Evaluation) -> dict[str, Any]:
        """What else `optimum.json` tells; the slope only where no simulation is missing for it."""
        tilt = self.at(found.x)
        aim = self.known[tilt].aim
        told: dict[str, Any] = {"simulations": len(self.known), "low": aim.low, "high": aim.high}
        told["intervals_overlap"] = self.alike(tilt)
        if all(t in self.known for t in self.beside(tilt)):
            slope = self.slope(found.x, found.sharpness)
            told |= {"slope_per_degree": slope.value, "ASE_slope_per_degree": slope.ase}
        return told

    def alike(self, tilt: float) -> list[float]:
        """Other tilts [deg] that hold the limit and whose intervals overlap with this one's."""
        own = self.known[tilt].aim
        return sorted(
            other
            for other, (E, aim) in self.known.items()
            if other != tilt and aim.low <= own.high and own.low <= aim.high
            and self.measure.hard(E)[1] <= self.goal.ase_limit + 1e-9
        )  # fmt: skip

    def _simulated(self, case: Case, progress: Progress) -> Simulated:
        """Coefficients, illuminances and intervals of a case.

        The twins of the shade close a little in every hour with direct sun, so the shaded state is
        simulated for all of these, not for those only in which the shade may close.
        """
        light, sky, latitude = self.light, self.light.sky, self.light.sky.attrs["latitude"]
        last = 1.0 if case.shading is None else 0.6
        told = part(progress, 0, last)
        found = {"open": simulation.transport(case, "open", light.suns, latitude, progress=told)}
        sunny = self._has_sun(case, found["open"])
        if case.shading is not None:
            suns, told = light.suns.only(sources(sky.isel(time=sunny))), part(progress, last, 1)
            found["shaded"] = simulation.transport(case, "shaded", suns, latitude, progress=told)
        joined = simulation.states(found, case)
        joined.attrs |= {name: sky.attrs[name] for name in illuminance.SUN_OF}
        judged = evaluate_metrics(case, light, joined)
        year = judged.illuminance.map(luminance)
        is_open, direct = year["total_open"].values, year["direct_sun"].values
        shaded = is_open.copy()
        if case.shading is not None and sunny.any():
            behind = joined.sel(state="shaded"), sky.isel(time=sunny)
            parts = illuminance.by_channel(accumulate.by_source, *behind).map(luminance)
            shaded[sunny] = parts["total"].values
        E = Illuminances(*map(_tensor, (is_open, shaded, direct)))
        return Simulated(E, self._interval(judged.metrics))

    def _has_sun(self, case: Case, is_open: xr.Dataset) -> np.ndarray:
        """Time stamps with direct sun somewhere, or in which the shade may close anyway."""
        direct = illuminance.by_channel(accumulate.direct_sun, is_open, self.light.sky)
        lit = (direct.map(luminance)["direct_sun"].values > 0).any(axis=1)
        return lit | (may_close(case, self.light, is_open) if case.shading else False)

    def _interval(self, metrics: dict[str, Any]) -> Interval:
        """95 % interval of what is to be large; of the worst month, that of the month's own."""
        if self.goal.aim == "sDA":
            return Interval(**metrics["sDA"])
        months = [month for month in metrics["msDA"] if month is not None]
        return Interval(**min(months, key=lambda month: month["value"]))


def _tilted(case: Case, name: str, tilt: float) -> Case:
    """Case with another tilt [deg] of a component."""
    component = case.components[name].model_copy(update={"tilt": tilt})
    return case.with_components({**case.components, name: component})


def _tensor(values: np.ndarray) -> mi.TensorXf:
    return mi.TensorXf(np.ascontiguousarray(values, np.float32))
