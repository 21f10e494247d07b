"""A year in parts, in each of which the groups whose states have surfaces of their own stay still.

A sum over openings knows light by pane, and no surfaces that come and go: a shelf that turns, snow,
leaves. Such groups take few combinations of states in a year.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.group_states import in_states
from drcmitsuba.scene.geometry import origin, rotation
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import groups_with_surfaces
from drcmitsuba.scene.prepared_case import prepared


@dataclass(frozen=True, eq=False)
class PartOfYear:
    """Time stamps at which no surface of a case changes."""

    case: Case
    """Case whose model has these surfaces for good."""
    openings: PaneGroups
    """Groups that may change; where there are none, panes by material and direction."""
    hours: np.ndarray
    """Time stamps, int, shape (hour,)."""
    indices: np.ndarray
    """State of every opening at these time stamps, int, shape (hour, opening)."""
    moved: np.ndarray
    """Vector that takes positions from the traced frame of the case to that of this one [m]."""


def parts_of_year(case: Case, indices: np.ndarray) -> list[PartOfYear]:
    """Cut a year into parts, one for each combination of states of the groups with surfaces.

    Parameters
    ----------
    case : Case
    indices : np.ndarray of int, shape (time, group)
        State of every group of the case at every time stamp, an index.
    """
    groups, every = prepared(case).groups, np.arange(len(indices))
    still = [*dict.fromkeys(groups_with_surfaces(case))]
    if not still:
        return [PartOfYear(case, groups, every, indices, np.zeros(3))]
    column = {name: k for k, name in enumerate(groups.states.names)}
    taken = indices[:, [column[name] for name in still]]
    combinations, of_hour = np.unique(taken, axis=0, return_inverse=True)
    parts = []
    for k, states in enumerate(combinations.tolist()):
        hours = np.flatnonzero(of_hour.reshape(-1) == k)
        model = in_states(case.building, dict(zip(still, states, strict=True)))
        free = {name: group for name, group in case.groups.items() if name not in still}
        own = case.with_tables(groups=free).with_building(model)
        openings = PaneGroups.of_windows(own)
        of_part = np.zeros((len(hours), len(openings)), int)
        for i, name in enumerate(openings.states.names):
            if name in free:
                of_part[:, i] = indices[hours, column[name]]
        moved = (origin(case) - origin(own)) @ rotation(case).T
        parts.append(PartOfYear(own, openings, hours, of_part, moved))
    return parts
