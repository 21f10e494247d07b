"""The façade of a view: its openings, and the fills that they have in a state or by a choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from drcmitsuba.annual.choice import Choice, ChosenFills
from drcmitsuba.annual.moving_groups import moving_groups
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.rendering.facade_scenes import FacadeScenes, Indices
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.fills import Fills, names_of, openings_of
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import groups_with_surfaces, refuse_surfaces
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import Tint, untinted
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.marks import MOST_ELEMENTS


@dataclass(frozen=True, eq=False)
class ViewFacade:
    """Façade of a case, of which pictures are made."""

    case: Case
    state: State
    """State that pictures show unless they are asked for another one."""
    panes: PaneGroups | None
    """Openings and their fills, where light paths are traced by element; None where the façade has
    the one `state`."""

    @classmethod
    def of(cls, case: Case, state: State, fills: Fills = ()) -> ViewFacade:
        """Open the façade of a case.

        It has the one state where nothing changes, where states change more than panes, such as a
        shelf, and where there are more fills than paths can be marked with.

        Raises
        ------
        InputError
            There is no such state, opening or fill, or fills are given to what has the one state.
        """
        groups = prepared(case).groups
        groups.states.indices(state)  # refuses others
        both = zip(groups.states.states, groups.facings, strict=True)
        changes = any(len(states) > 1 and facings for states, facings in both)
        if fills:
            refuse_surfaces(case)
        if groups_with_surfaces(case) or not (changes or fills):
            return cls(case, state, None)
        panes = openings_of(case, fills)
        fit = any(panes.states.closable) and panes.states.starts[-1] <= MOST_ELEMENTS
        return cls(case, state, panes if fit else None)

    def alone(self) -> ViewFacade:
        """Façade in the one state."""
        return replace(self, panes=None)

    @property
    def states(self) -> list[State]:
        """States of the case that light paths are traced for, every material among them."""
        if self.panes is None:
            return [self.state]
        own = prepared(self.case).groups.states
        return [own.label(indices) for indices in own.in_step]

    @property
    def stated(self) -> State | dict[str, list[str]]:
        """Façade as an input of light paths: the fills by opening, or the one state."""
        return {name: [*fills] for name, fills in self.fills.items()} or self.state

    @cached_property
    def fills(self) -> dict[str, tuple[str, ...]]:
        """Names of the fills by opening; the first one is what the case draws there."""
        return {} if self.panes is None else names_of(self.case, self.panes)

    def scenes(self, channel: int, effects: EnabledEffects, tint: Tint = untinted) -> FacadeScenes:
        """Scenes of the façade in a colour channel or a band."""
        if self.panes is None:
            return FacadeScenes.alone(
                scene.load(self.case, self.state, channel, effects, tint=tint)
            )
        return FacadeScenes.of(self.case, self.panes, channel, effects, tint)

    def indices(self, state: State, choice: Choice, light: Daylight) -> Indices:
        """Fill of every opening in a state of the case's groups, and by a choice beside it.

        Raises
        ------
        InputError
            There is no such state, opening or fill, the façade has another state alone, or a choice
            holds shares.
        """
        groups, time = prepared(self.case).groups.states, light.sky["time"]
        of_groups = groups.indices(state)
        if self.panes is None:
            if of_groups != groups.indices(self.state):
                got = f"{state}, of a view that was prepared as {self.state}"
                raise InputError(self.case.source, "state", got, "prepare the view in this state")
            if choice:
                ChosenFills.of(self.fills, choice, time.values)
            return ()
        *first, count = self.panes.states.starts
        chosen = ChosenFills.of(self.fills, choice, time.values)
        moving = moving_groups(self.case, self.panes, ChosenFills({}, {}), {}, time)
        shares = np.zeros(count, np.float32)
        shares[first] = 1
        numbers = [of_groups[groups.names.index(group.name)] for group in moving.groups]
        shares = moving.shares(shares, np.array(numbers, int))
        for opening, mixtures in chosen.hourly.items():
            shares[self._of(opening)] = mixtures.shares[mixtures.index[0]]
        for opening, row in chosen.constant.items():
            shares[self._of(opening)] = row
        if not np.isin(shares, (0, 1)).all():
            got = "shares of fills, which a picture cannot show"
            raise InputError("choice", "fills", got, "name one fill of each opening")
        rows: Sequence[np.ndarray] = [shares[self._of(o)] for o in range(len(first))]
        return tuple(int(row.argmax()) for row in rows)

    def told(self, state: State, choice: Choice, indices: Indices) -> str:
        """Name of a state with what is chosen beside it, whose fills are the `indices`."""
        of_openings = zip(self.fills.items(), indices, strict=True)
        chosen = [f"{name} {fills[k]}" for (name, fills), k in of_openings if name in choice]
        return ", ".join([state, *chosen])

    def _of(self, opening: int) -> slice:
        """Elements of an opening."""
        assert self.panes is not None
        return slice(*self.panes.states.starts[opening : opening + 2])
