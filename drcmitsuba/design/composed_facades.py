"""Façades of one case from one simulation: any composition with all its evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.chosen_facade import group_of_sun
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulated_year import SimulatedYear, simulated_year
from drcmitsuba.annual.summed_year import luminances_of, replicates_of
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.design.any_layout import AnyLayout, layout_of
from drcmitsuba.design.facade_tiles import FacadeParts, TiledLight
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.free_transmittances import GLAZING
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.metrics.evaluate_metrics import drawing
from drcmitsuba.metrics.illuminance import illuminance
from drcmitsuba.plan import Plan, plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, silent
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.standards import Evidence


@dataclass(frozen=True, eq=False)
class Facades:
    """Façades of one case.

    Parameters
    ----------
    layout : AnyLayout
        Contents of `[design]`.
    tiled : TiledLight
        Light by tile with all replicates.
    light : Daylight
        Daylight of the case's period.
    """

    layout: AnyLayout
    tiled: TiledLight
    light: Daylight

    @classmethod
    def of(cls, case: Case, stage: Stage = silent) -> Facades:
        """Simulate the light by tile of a case with `[design]`.

        Raises
        ------
        InputError
            The search for a façade cannot hold the case: it has no `[design]`, tilts lamellae, has
            components in its strips or other materials, groups that take too many states, or takes
            more memory than there is.
        """
        if case.design is not None and case.design.component is not None:
            got = "the tilt of lamellae is searched, not a façade"
            raise InputError(case.source, "design.component", got, "name a film in its place")
        backend.select()
        layout = layout_of(_without_goal(case.with_true_suns()))
        return cls(layout, *layout.light_as_drawn(stage))

    @cached_property
    def present(self) -> np.ndarray:
        """Composition as the façade is, shape (tile, material)."""
        return self.layout.as_drawn(self.tiled)

    @cached_property
    def parts(self) -> FacadeParts:
        """Tiles in words and areas."""
        return self.layout.parts(self.tiled)

    @cached_property
    def problem(self) -> FacadeProblem:
        """Parameters of the façade; the shade keeps its transmittance."""
        problem = self.layout.problem(FacadeYear.of(self.tiled, self.light))
        of_glass = tuple(f for f in problem.factors if f.parameter.key == GLAZING)
        return replace(problem, factors=of_glass)

    def evidence(self, share: np.ndarray, scale: Mapping[str, float] | None = None) -> Evidence:
        """Evidence of a composition (tile, material): E with its C and L.

        `scale` are factors of the transmittance of materials by name, by default 1.
        """
        layout, light, tiled = self.layout, self.light, self.tiled.scaled(scale or {})
        built = layout.composed(tiled, share)
        facade = ComposedFacade(built, tiled, share)
        coefficients, direct, *_ = facade.simulated(plan(built, light))
        E = illuminance(coefficients, light.sky, direct)
        E.attrs["step_hours"] = light.step_hours
        return Evidence(E, coefficients, light.sky, drawing(built), layout.case.source)


def _without_goal(case: Case) -> Case:
    """Case without the goal of `optimise` in `[design]`: its standard may ask for other hours."""
    if case.design is None:
        return case
    goal = {"objective": "sDA", "sda_least": None, "standard": None, "level": None}
    goal |= {"glare_limit": None}
    return case.with_tables(design=case.design.model_copy(update=goal))


@dataclass(frozen=True, eq=False)
class ComposedFacade:
    """A façade of tiles in one composition: a `StateSource` of the states that its groups take."""

    case: Case
    """Case of this façade."""
    tiled: TiledLight
    share: np.ndarray
    """Composition, shape (tile, material)."""

    def state(self, state: State, labels: np.ndarray | None, progress: Progress) -> xr.Dataset:
        """C [sr] of a state for all suns; see `StateSource`."""
        tiled, groups = self.tiled, self.tiled.groups
        index = int(state != OPEN)
        if groups is not None:
            index = int(groups.places(np.array(groups.rule.groups.indices(state))))
        C = tiled.coefficients(self.share, index)
        C = C.assign_coords(prepared(self.case).receivers.coordinates.coords)
        if groups is not None and tiled.group is not None and state == OPEN:
            shares = tiled.shares(self.share)
            by = group_of_sun(tiled.standing(0), shares, tiled.group, len(groups.rule.groups))
            C = C.assign(pane_group=(("sensor", "bin"), by))
        progress(1)
        return C

    def year(self, daylight: Daylight, indices: np.ndarray, progress: Progress) -> xr.Dataset:
        """`illuminance` [lx] of a year; see `StateSource`."""
        tiled, groups = self.tiled, self.tiled.groups
        assert groups is not None
        states = np.stack([tiled.shares(self.share, i) for i in range(len(groups.indices))])
        shares, channels = states[groups.places(indices)], tiled.channels
        L = luminances_of(daylight, channels[0].labels)
        years = [light.illuminance(L, shares) for light in channels]
        E = replicates_of(daylight, years, channels[0].replicates)
        return xr.Dataset({"illuminance": E})

    def simulated(self, planned: Plan) -> SimulatedYear:
        """C of the states that this façade takes, and its direct sun."""
        case, light, groups = planned.simulated, planned.facts.light, self.tiled.groups
        marked = attributes(planned.facts.case, light, planned.scope)
        if groups is not None and marked["has_shade"]:  # as named for all compositions
            marked.pop("groups", None)
            marked.pop("schedule", None)
            marked |= groups.rule.groups.attributes() | groups.rule.schedule.attributes()
        return simulated_year(self, case, light, Run.of(case, planned.scope), marked)
