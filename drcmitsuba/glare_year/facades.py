"""Façades whose glare is asked for: shares of openings and fills at every time stamp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drcmitsuba.annual.applied_states import AppliedStates, applied_states, states_by
from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.choice import Choice, ChosenFills
from drcmitsuba.annual.chosen_facade import ChosenFacade, light_of_channels, suns_of
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import APPLIED, State
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals.facade_draws import DrawnStates
from drcmitsuba.scene.fills import names_of
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements import LightByElement


@dataclass(frozen=True, eq=False)
class FacadeShares:
    """Shares of openings and fills in some façades."""

    shares: Mapping[State, np.ndarray]
    """Shares (time, element) by the name of each façade, `applied` last."""
    others: tuple[np.ndarray, ...] = ()
    """Shares (time, element) in other states, which `applied` takes in draws."""
    drawn: DrawnStates | None = None
    """Hours and draws of these; None where no rule closes anything."""

    @property
    def every(self) -> list[np.ndarray]:
        """Shares of all façades, those of other states last."""
        return [*self.shares.values(), *self.others]


@dataclass(frozen=True, eq=False)
class FacadesOfCase:
    """Façades of a case and of choices, which the direct sun on the sensors closes."""

    case: Case
    panes: PaneGroups
    """Openings and their fills."""
    light: Daylight
    run: Run

    @cached_property
    def fills(self) -> dict[str, tuple[str, ...]]:
        """Names of the fills by opening; the first one is what the case draws there."""
        return names_of(self.case, self.panes)

    def of(self, choice: Choice) -> FacadeShares:
        """Façades with a choice of fills: see `glare_by_element.GlareElements.evaluate`."""
        time = self.light.sky["time"]
        marked = attributes(self.case, self.light, self.run.enabled_effects)
        chosen = ChosenFills.of(self.fills, choice, time.values)
        facade = ChosenFacade.of(
            self.case, self.panes, (), marked, time, chosen, {}, sky=self.light.sky
        )
        moving, out = facade.moving.states, dict[State, np.ndarray]()
        stamps = len(time)
        if not chosen.hourly:
            for row in moving.in_step:
                out.setdefault(moving.label(row), facade.shares(np.tile(row, (stamps, 1))))
        if not facade.moving.groups:
            return FacadeShares(out)
        if choice and all(group.by_hour is not None for group in facade.moving.groups):
            out[APPLIED] = facade.shares(facade.moving.schedule.indices(time))
            return FacadeShares(out)
        groups = moving if choice else prepared(self.case).groups.states
        applied = self._applied(facade) if choice else self._as_case()
        own = [groups.names.index(group.name) for group in facade.moving.groups]
        out[APPLIED] = facade.shares(applied.taken.of_group[:, own])
        drawn, states = applied.closures.in_draws(), applied.closures.states
        others = [
            facade.shares(np.array([groups.indices(states[k]) for k in index])[:, own])
            for index in drawn.others
        ]
        return FacadeShares(out, tuple(others), drawn)

    def _as_case(self) -> AppliedStates:
        """State of every group without a choice, as an evaluation has it."""
        applied = applied_states(self.case, self.light, self.run)
        assert applied is not None
        return applied

    def _applied(self, facade: ChosenFacade) -> AppliedStates:
        """State of every moving group."""
        facade = replace(facade, channels=self._sun)
        bins = suns_of(self.light, self._sun[0])
        marked = facade.attributes
        direct = illuminance.direct_sun(
            Coefficients(facade.straight(bins).assign_attrs(marked)), self.light.sky
        )
        return states_by(direct, self.case, self.light, marked)

    @cached_property
    def _sun(self) -> tuple[LightByElement, ...]:
        """Sun on the sensors by element, in which nothing else is simulated."""
        effects = self.run.enabled_effects.only_sun(self.case.sun)
        accuracy = self.run.accuracy(self.case)
        kept = next(n for n in range(2, accuracy.replicates + 1) if accuracy.replicates % n == 0)
        with self.run.timed("sun on the sensors") as done:
            return light_of_channels(
                self.case, self.panes, self.light.suns, accuracy, effects, done, kept
            )
