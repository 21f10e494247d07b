"""Tilt of lamellae as a design variable, by simulations that share their random numbers.

Light of lamellae is no sum over tilts: turned mirrors send light elsewhere, so every tilt is a
simulation of its own. Differences take the place of gradients,

    dE/dθ = [E(θ + h) − E(θ − h)] / 2h,

one-sided at the bounds. The derivative of the estimate along a light path misses the boundary term
of the edges of mirrors, of their shadows and of the sun's disk, since a path either meets the
mirror or passes it; a difference includes that term. Simulations of all tilts share one seed [1]_:
photons start at the same points of ports, sun and sky, and noise cancels in the difference where
photons of the same start end in the same cells and squares. Most noise cancels over a tenth of a
degree, little over two degrees, since a mirror turns light by twice its own turn. Wider steps still
have less noise, because the noise is divided by the step.

References
----------
.. [1] P. Glasserman, D. Yao, "Some guidelines and guarantees for common random numbers",
   Management Science 38, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import StructureComponent
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.design.measure import (
    ASE_TOLERANCE,
    Aim,
    Measure,
    RatedCandidate,
    RatedProblem,
    Score,
)
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.simulated_tilt import SimulatedTilt, simulated_tilt
from drcmitsuba.metrics.evaluate_metrics import rules
from drcmitsuba.metrics.facade_states import most_states
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, silent
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.toml import named_of_kind, shortened
from drcmitsuba.scene import components
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.structures.recipe import Lamellae, load_recipe
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.daylight import daylight as daylight_of


class TiltGoal(NamedTuple):
    """Metric that is maximised, and largest ASE [%]."""

    aim: Aim
    ase_limit: float


class Slope(NamedTuple):
    """Derivatives of the smooth objective and of the smooth ASE by the tilt [% per deg]."""

    value: float
    ase: float


@dataclass(frozen=True)
class TiltProblem(RatedProblem):
    """Lamellae, a `component`, whose `tilt` [deg] is free, their year, and the goal.

    Differences are taken over `step` [deg]. Years are kept by tilt [deg] in `simulated`, so that no
    tilt is simulated twice; a year of 2610 hours and 576 sensors takes 18 MB. If lamellae are wider
    than their period, fewer of them fit at a steep tilt: there the objective has a step.
    """

    case: Case
    component: str
    daylight: Daylight
    goal: TiltGoal
    tilt: Parameter
    step: float
    simulated: dict[float, SimulatedTilt] = field(default_factory=dict, compare=False)

    @classmethod
    def of(cls, case: Case, stage: Stage = silent) -> TiltProblem:
        """Read the problem from a case.

        Raises
        ------
        InputError
            The component has no lamellae, they do not fit into their panes at all tilts, groups of
            panes take too many states, or the weather is unfit.
        """
        design = case.design
        if design is None or design.component is None:
            got, remedy = "no component is named", 'add component = "…", lamellae of [components]'
            raise InputError(case.source, "design", got, remedy)
        case.refuse_overruled("the search for a tilt")
        structures = named_of_kind(case.components, (StructureComponent,))
        design.check_tilt(structures, case.standing)
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
        goal = TiltGoal(design.aim, design.ase_limit)
        with stage("sky"):
            daylight = daylight_of(case)
        problem = cls(case, design.component, daylight, goal, tilt, design.tilt_step)
        _ = problem.groups  # refused where they take too many states
        return problem

    @cached_property
    def groups(self) -> FacadeGroups | None:
        """Groups of panes, or the one shade; None where nothing closes."""
        groups = prepared(self.case).groups.states
        if not len(groups):
            return None
        time = self.daylight.sky["time"]
        return FacadeGroups.of_case(self.case, groups, time, most_states(groups))

    @property
    def measure(self) -> Measure:
        """Rules that rate a year."""
        of_case, months = rules(self.case, self.daylight.step_hours), self.daylight.sky["clock"].dt
        return Measure(of_case, self.goal.aim, months.month.values, self.groups)

    def built(self, tilt: float) -> Case:
        """Case with its lamellae at a tilt [deg]."""
        return _tilted(self.case, self.component, tilt)

    def afresh(self, tilt: float) -> Case:
        """Case at a tilt [deg] with another seed: its noise did not take part in the search."""
        seed = case_seed(self.case.accuracy.seed, Stream.FRESH_SEED)
        accuracy = self.case.accuracy.model_copy(update={"seed": seed})
        return self.built(tilt).with_tables(accuracy=accuracy)

    def at(self, x: np.ndarray) -> float:
        """Tilt [deg] of a free value; rounded, so that no tilt is simulated twice."""
        return round(self.tilt.low + float(np.ravel(x)[0]) * (self.tilt.high - self.tilt.low), 4)

    def free(self, tilt: float) -> np.ndarray:
        """Free value of a tilt [deg], shape (1,), 0 to 1 between the bounds."""
        return np.array([(tilt - self.tilt.low) / (self.tilt.high - self.tilt.low)])

    def simulate(self, tilt: float, progress: Progress = lambda share: None) -> SimulatedTilt:
        """Year of a tilt [deg], simulated with the case's seed at the first call."""
        if tilt not in self.simulated:
            self.simulated[tilt] = simulated_tilt(
                self.built(tilt), self.daylight, self.groups, self.goal.aim, progress
            )
        return self.simulated[tilt]

    def evaluate(self, x: np.ndarray, sharpness: float) -> RatedCandidate:
        """Evaluate a tilt, x (1,) 0 to 1 between the bounds, by smooth twins of a sharpness."""
        E = self.simulate(self.at(x)).E
        aim, ase = (float(v[0]) for v in self.measure.smooth(E, sharpness))
        hard = self.measure.hard(E)
        return RatedCandidate(
            np.array(x, float), sharpness, Score(aim, aim, ase), Score(hard[0], *hard)
        )

    def beside(self, tilt: float) -> tuple[float, float]:
        """Tilts [deg] below and above a tilt, between which its difference is taken."""
        low, high = max(tilt - self.step, self.tilt.low), min(tilt + self.step, self.tilt.high)
        return round(low, 4), round(high, 4)

    def slope(self, x: np.ndarray, sharpness: float) -> Slope:
        """Difference quotients of the smooth scores at a tilt, over `step` to both sides.

        One-sided if a bound is nearer. Limits: the slope contains the noise of the difference
        between two tilts, which is not estimated, and the curvature within the step.
        """
        low, high = self.beside(self.at(x))
        at_low, at_high = (self.evaluate(self.free(t), sharpness).smooth for t in (low, high))
        width = high - low
        return Slope((at_high.value - at_low.value) / width, (at_high.ase - at_low.ase) / width)

    def named(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters [deg]."""
        return {self.tilt.key: np.array([self.at(x)])}

    def details(self, candidate: RatedCandidate) -> dict[str, Any]:
        """Further entries of `optimum.json`; the slope only if both its tilts are simulated."""
        tilt = self.at(candidate.x)
        aim = self.simulated[tilt].aim
        entries: dict[str, Any] = {
            "simulations": len(self.simulated),
            "low": aim.low,
            "high": aim.high,
            "intervals_overlap": self.indistinct(tilt),
        }
        if all(t in self.simulated for t in self.beside(tilt)):
            slope = self.slope(candidate.x, candidate.sharpness)
            entries |= {"slope_per_degree": slope.value, "ASE_slope_per_degree": slope.ase}
        return entries

    def indistinct(self, tilt: float) -> list[float]:
        """Other tilts [deg] that hold the limit and whose intervals overlap with this tilt's."""
        here = self.simulated[tilt].aim
        return sorted(
            other
            for other, (E, aim) in self.simulated.items()
            if other != tilt and aim.low <= here.high and here.low <= aim.high
            and self.measure.hard(E)[1] <= self.goal.ase_limit + ASE_TOLERANCE
        )  # fmt: skip


def _tilted(case: Case, name: str, tilt: float) -> Case:
    """Case with another tilt [deg] of a component."""
    component = case.components[name].model_copy(update={"tilt": tilt})
    return case.with_tables(components={**case.components, name: component})
