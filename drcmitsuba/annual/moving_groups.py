"""Groups of a façade that change their state in a year, as shares of fills in their openings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba.annual.choice import ChosenFills, Mixtures
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, OTHERS, SHADED, GroupStates
from drcmitsuba.case.schedule import HOURS, Schedule, hour_of_year, schedule_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene.fills import clear_panes, drawn_in
from drcmitsuba.scene.materials import shade_covers
from drcmitsuba.scene.pane_groups import Member, PaneGroups, facade_name
from drcmitsuba.scene.prepared_case import prepared


@dataclass(frozen=True, eq=False)
class MovingGroup:
    """Openings that change their fill together: by the case, or by a choice for every hour."""

    name: str
    states: tuple[str, ...]
    parts: tuple[tuple[int, np.ndarray], ...]
    """Openings, each with the shares of its fills in every state, (state, fill)."""
    by_hour: np.ndarray | None = None
    """State in the hours of a year, int, (8760,); None where the rule of the shade tells it."""
    is_chosen: bool = False
    """Whether a choice names its fills, which then stand for what is drawn there."""
    bare: tuple[str, ...] = ()
    """Further states in which no shade of the case stands."""


@dataclass(frozen=True, eq=False)
class MovingGroups:
    """All groups that move, and the others, which have one state."""

    groups: tuple[MovingGroup, ...]
    panes: PaneGroups
    """Openings of the case and their fills."""

    @property
    def states(self) -> GroupStates:
        """Groups and their states as the attributes of C hold them."""
        every = self.groups
        bare = tuple((g.name, state) for g in every for state in g.bare)
        states = GroupStates(tuple(g.name for g in every), tuple(g.states for g in every), bare)
        moved = {opening for group in every for opening, _ in group.parts}
        others = any(faces for g, faces in enumerate(self.panes.facings) if g not in moved)
        if not others or states == GroupStates.of_shade():
            return states
        return GroupStates((*states.names, OTHERS), (*states.states, (OPEN,)), bare)

    @property
    def schedule(self) -> Schedule:
        """States of the groups that have one for every hour."""
        by_hour = {k: g.by_hour for k, g in enumerate(self.groups) if g.by_hour is not None}
        return Schedule(by_hour, len(self.states) if self.groups else 0)

    def drawn_at(self, time: xr.DataArray) -> np.ndarray:
        """State of every group while all shades are open, int, (time, group): that of a choice."""
        by_hour = self.schedule.of_group
        chosen = {k: states for k, states in by_hour.items() if self.groups[k].is_chosen}
        return Schedule(chosen, len(self.states)).indices(time)

    def number_of(self, opening: int) -> int:
        """Group of an opening."""
        for k, group in enumerate(self.groups):
            if any(opening == own for own, _ in group.parts):
                return k
        return len(self.groups)

    def shares(self, still: np.ndarray, indices: np.ndarray) -> np.ndarray:
        """Shares of all elements (…, element).

        Parameters
        ----------
        still : np.ndarray, shape (element,)
            Shares of all elements where no group moves.
        indices : np.ndarray of int, shape (…, group)
            State of every group.
        """
        out = np.broadcast_to(still, (*indices.shape[:-1], len(still))).copy()
        for k, group in enumerate(self.groups):
            for opening, table in group.parts:
                first = self.panes.states.starts[opening]
                out[..., first : first + table.shape[1]] = table[indices[..., k]]
        return out


def moving_groups(
    case: Case, panes: PaneGroups, chosen: ChosenFills, drawn: Mapping[int, np.ndarray],
    time: xr.DataArray, members: Mapping[int, Member] | None = None,
) -> MovingGroups:  # fmt: skip
    """Groups of a case, and openings whose fill is chosen by the hour.

    Parameters
    ----------
    panes : PaneGroups
        Openings of the case.
    chosen : ChosenFills
        Fills of the openings that do not follow the case.
    drawn : mapping
        Shares (fill,) of what stands in openings while they are open, by their index, in place of
        what the case draws.
    time : xr.DataArray
        Time stamps of the choice.
    members : mapping, optional
        Groups of `[groups]` that openings belong to, by their index; by default the groups of the
        case are its first openings, in their order.

    Raises
    ------
    InputError
        The shade is no fill of an opening that it covers, or fills change within an hour.
    """
    names = panes.states
    members = prepared(case).groups.members if members is None else members
    first = {g: drawn.get(g, np.eye(1, len(s), dtype=np.float32)[0])
             for g, s in enumerate(names.states)}  # fmt: skip
    rows = {g: row for g, row in first.items() if g not in chosen.named}
    if case.groups:
        moving = _of_table(case, rows, members)
    else:
        at_most = {g: mixtures.shares.max(axis=0) for g, mixtures in chosen.hourly.items()}
        moving = _of_shade(case, panes, rows, {**chosen.constant, **at_most})
    for g, mixtures in chosen.hourly.items():
        is_shade = np.zeros(mixtures.shares.shape[1], bool)
        if case.groups:
            is_shade[[*(members[g].fills if g in members else ())]] = True
        elif case.shading is not None:
            is_shade[1:] = [fill == case.shading.material for fill in names.states[g][1:]]
        shaded = mixtures.shares @ is_shade > 0.5
        bare = tuple(name for name, of in zip(mixtures.names, shaded, strict=True) if not of)
        by_hour = _hours(names.names[g], mixtures, time)
        name, taken = names.names[g], {group.name for group in moving}
        name = f"{name} (by the hour)" if name in taken else name  # of the shade of a façade
        parts = ((g, mixtures.shares),)
        moving.append(MovingGroup(name, mixtures.names, parts, by_hour, True, bare[1:]))
    return MovingGroups(tuple(moving), panes)


def _of_table(
    case: Case, first: Mapping[int, np.ndarray], members: Mapping[int, Member]
) -> list[MovingGroup]:
    """Groups of `[groups]`, whose open state has the shares `first`."""
    own = prepared(case).groups.states
    schedule, moving = schedule_of(case.groups, own), []
    for g, (name, states) in enumerate(zip(own.names, own.states, strict=True)):
        parts = tuple(
            (opening, _table(first[opening], member.fills))
            for opening, member in members.items()
            if member.group == g and opening in first
        )
        if len(states) > 1 and parts:
            moving.append(MovingGroup(name, states, parts, schedule.of_group.get(g)))
    return moving


def _table(first: np.ndarray, fills: tuple[int, ...]) -> np.ndarray:
    """Shares (state, fill): the first ones, then one fill each."""
    return np.stack([first, *np.eye(len(first), dtype=np.float32)[[*fills]]])


def _of_shade(
    case: Case, panes: PaneGroups, first: Mapping[int, np.ndarray], bare: Mapping[int, np.ndarray]
) -> list[MovingGroup]:
    """Openings whose clear parts the shade covers, façade by façade.

    `bare` are the shares of openings that no shade covers: the sun that comes in by another façade
    closes none.
    """
    if case.shading is None:
        return []
    by_facade: dict[str, list[tuple[int, np.ndarray]]] = {}
    facades, clear_as_drawn = set[str](), clear_panes(case, panes)
    by_space = case.shading.by_space and panes.spaces
    for g, row in {**first, **bare}.items():
        if not panes.facings[g]:  # surfaces that a group brings
            continue
        clear = np.array([clear_as_drawn[g], *map(shade_covers, panes.materials[g])])
        if not row[clear].any():
            continue
        space = next(iter(panes.spaces[g]), "") if by_space else ""
        names = [facade_name(space, facing) for facing in panes.facings[g][:1]]
        facades |= {*names}
        if g in bare:
            continue
        closed = np.where(clear, 0, row)
        closed[_fill_of_shade(case, panes, g)] += row[clear].sum()
        for name in names:
            by_facade.setdefault(name, []).append((g, np.stack([row, closed])))
    if case.shading.groups == "together" or (len(facades) < 2 and not any(panes.spaces)):
        parts = tuple(part for of_facade in by_facade.values() for part in of_facade)
        shade_of_all = GroupStates.of_shade()
        return [MovingGroup(shade_of_all.names[0], shade_of_all.states[0], parts)] if parts else []
    return [MovingGroup(name, (OPEN, SHADED), tuple(p)) for name, p in by_facade.items()]


def _fill_of_shade(case: Case, panes: PaneGroups, opening: int) -> int:
    """Index of the fill that is the shade, which the case may have drawn there itself."""
    assert case.shading is not None
    fills, shade = panes.states.states[opening], case.shading.material
    if shade in fills[1:]:
        return fills.index(shade, 1)
    kinds = case.materials
    drawn = panes.drawn[opening] if panes.drawn else kinds.get(drawn_in(case, panes)[opening])
    if drawn != kinds[shade]:
        got = f"the shade {shortened(shade)} covers {shortened(panes.states.names[opening])}"
        raise InputError("drawn", panes.states.names[opening], got, "name it among its fills")
    return 0


def _hours(opening: str, mixtures: Mixtures, time: xr.DataArray) -> np.ndarray:
    """Mixture in the hours of a year, int, (8760,)."""
    hour, by_hour = hour_of_year(time), np.zeros(HOURS, int)
    by_hour[hour] = mixtures.index
    if (by_hour[hour] != mixtures.index).any():
        got = "different fills within an hour"
        raise InputError("choice", opening, got, "keep one for the whole hour")
    return by_hour
