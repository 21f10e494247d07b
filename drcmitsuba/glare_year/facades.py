"""Façades whose glare is asked for: shares of openings and fills at every time stamp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drcmitsuba.annual.applied_states import applied_states
from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.choice import Choice, ChosenFills
from drcmitsuba.annual.chosen_facade import ChosenFacade, light_of_channels
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import APPLIED, State
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.scene.fills import names_of
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements import LightByElement

Facades = Mapping[State, np.ndarray]
"""Shares (time, element) of façades by their names."""


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

    def of(self, choice: Choice) -> Facades:
        """Façades with a choice of fills: see `glare_by_element.GlareElements.evaluate`."""
        time = self.light.sky["time"]
        marked = attributes(self.case, self.light, self.run.enabled_effects)
        chosen = ChosenFills.of(self.fills, choice, time.values)
        facade = ChosenFacade.of(self.case, self.panes, (), marked, time, chosen, {})
        moving, out = facade.moving.states, dict[State, np.ndarray]()
        stamps = len(time)
        if not chosen.hourly:
            for row in moving.in_step:
                out.setdefault(moving.label(row), facade.shares(np.tile(row, (stamps, 1))))
        if facade.moving.groups:
            indices = self._indices(facade) if choice else self._as_case(facade)
            out[APPLIED] = facade.shares(indices)
        return out

    def _as_case(self, facade: ChosenFacade) -> np.ndarray:
        """State of every moving group without a choice, as an evaluation has it, (time, group)."""
        names = prepared(self.case).groups.states.names
        taken = applied_states(self.case, self.light, self.run)
        assert taken is not None
        return taken.of_group[:, [names.index(group.name) for group in facade.moving.groups]]

    def _indices(self, facade: ChosenFacade) -> np.ndarray:
        """State of every moving group at every time stamp, int, (time, group)."""
        if all(group.by_hour is not None for group in facade.moving.groups):
            return facade.moving.schedule.indices(self.light.sky["time"])
        facade = replace(facade, channels=self._sun)
        bins = np.arange(self._sun[0].sky_bins, len(self._sun[0].labels))
        marked = facade.attributes
        direct = illuminance.direct_sun(
            Coefficients(facade.straight(bins).assign_attrs(marked)), self.light.sky
        )
        return FacadeStates.of(marked, direct).of_group

    @cached_property
    def _sun(self) -> tuple[LightByElement, ...]:
        """Sun on the sensors by element, in which nothing else is simulated."""
        effects = self.run.enabled_effects.only_sun
        accuracy = self.run.accuracy(self.case, len(prepared(self.case).receivers))
        kept = next(n for n in range(2, accuracy.replicates + 1) if accuracy.replicates % n == 0)
        with self.run.timed("sun on the sensors") as done:
            return light_of_channels(
                self.case, self.panes, self.light.suns, accuracy, effects, done, kept
            )
