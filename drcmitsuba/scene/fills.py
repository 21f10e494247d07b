"""Openings of a case and what may stand in them: groups of panes with further fills.

An *opening* holds panes that change together: a group of the case, or all panes of one material
that face one direction and belong to no group. A *fill* is what may stand in an opening: a state
of its group, a material of the case, a hole, or wall.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, OTHERS, RESERVED, GroupStates
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    SurfaceMaterial,
)
from drcmitsuba.model.windows import materials_around
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.like_panes import assigned_to, like_panes
from drcmitsuba.scene.materials import is_mirroring_glass, shade_covers
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.prepared_case import prepared

HOLE, WALL = "hole", "wall"
"""Fills that are no material: nothing, and the wall around the opening."""
Fills = Mapping[str, Sequence[str]] | Sequence[str]
"""Names of further fills, of all openings or by opening."""


def openings_of(case: Case, fills: Fills = ()) -> PaneGroups:
    """Openings of a case: its groups of panes, then the panes of none, with all of their fills.

    The first fill of an opening, "open", are its panes as drawn; the states of the case and the
    further `fills` follow.

    Raises
    ------
    InputError
        There is no such opening, no such material, no one wall around it, or a group whose states
        the model gives is to have further ones; and errors of `PaneGroups.of`.
    """
    own = _apart(case, prepared(case).groups)
    if not any(own.facings):
        remedy = "give a façade strips, or the model panes"
        raise InputError(case.source, "facade", "no pane to the outside", remedy)
    names = own.states.names
    if not isinstance(fills, Mapping):
        with_panes = [n for n, facings in zip(names, own.facings, strict=True) if facings]
        fills = dict.fromkeys(with_panes, fills)
    for opening, of_opening in fills.items():
        if opening not in names:
            got = f"no opening {shortened(opening)}"
            raise InputError(case.source, "fills", got, choose(opening, names))
        listed = isinstance(of_opening, Sequence) and not isinstance(of_opening, str)
        if not listed or not all(isinstance(fill, str) for fill in of_opening):
            raise InputError(case.source, "fills", shortened(of_opening), 'give a list: ["hole"]')
    states, materials = [], []
    every = zip(names, own.states.states, own.materials, drawn_in(case, own), strict=True)
    for g, (name, known, kinds, drawn) in enumerate(every):
        further = [f for f in dict.fromkeys(fills.get(name, ())) if f not in (*known, drawn)]
        if further and len(known) > 1 and not kinds:
            got = f"further fills of {shortened(name)}, whose states the model gives"
            raise InputError(case.source, "fills", got, "name the group's panes and its states")
        states.append((*known, *further))
        walls = {WALL: _wall(case, own, g)} if WALL in further else {}
        of_fills = (walls[fill] if fill in walls else _fill(case, fill) for fill in further)
        materials.append((*kinds, *of_fills))
    return replace(own, states=GroupStates(names, tuple(states)), materials=tuple(materials))


def _apart(case: Case, own: PaneGroups) -> PaneGroups:
    """Groups of a case, with the panes of none in openings of their own."""
    # The one shade of a case without clear panes covers nothing.
    names_of = enumerate(zip(own.states.names, own.facings, strict=True))
    named = [g for g, (n, facings) in names_of if n in case.groups or (facings and n != OTHERS)]
    every, place = [], {old: new for new, old in enumerate(named)}
    rest = []
    for panes in like_panes(case):
        group = own.of_panes(panes)
        if group not in place:
            rest.append(panes)
        every.append((panes, place.get(group, len(named) + len(rest) - 1)))
    names = [*(own.states.names[g] for g in named), *map(str, rest)]
    if named and own.states == GroupStates.of_shade() and len(own.facings[0]) == 1:
        names[0] = own.facings[0][0]
    states = [own.states.states[g] for g in named]
    if case.shading is not None and not case.groups:
        states = [(OPEN, case.shading.material)] * len(named)
    return PaneGroups(
        GroupStates(tuple(names), (*states, *((OPEN,),) * len(rest))),
        *assigned_to(case, every),
        (*(own.facings[g] for g in named), *((panes.facing,) for panes in rest)),
        (*(own.materials[g] for g in named), *((),) * len(rest)),
        spaces=(
            *(own.spaces[g] if own.spaces else () for g in named),
            *(panes.spaces for panes in rest),
        ),
    )


def clear_panes(case: Case, openings: PaneGroups) -> list[bool]:
    """Whether a shade may cover what the case draws in every opening."""
    if openings.drawn:
        return [*map(shade_covers, openings.drawn)]
    clear = [False] * len(openings)
    for panes in like_panes(case):
        clear[openings.of_panes(panes)] |= panes.clear
    return clear


def drawn_in(case: Case, openings: PaneGroups) -> list[str]:
    """Name of what the case draws in every opening: a material, or "open" where these differ."""
    materials: list[set[str]] = [set() for _ in range(len(openings))]
    for panes in like_panes(case):
        materials[openings.of_panes(panes)].add(panes.name)
    alone = (next(iter(names)) if len(names) == 1 else OPEN for names in materials)
    known = zip(alone, openings.states.states, strict=True)
    return [OPEN if name in states else name for name, states in known]


def names_of(case: Case, openings: PaneGroups) -> dict[str, tuple[str, ...]]:
    """Names of the fills by opening; the first one is what the case draws there."""
    known = openings.states
    every = zip(known.names, drawn_in(case, openings), known.states, strict=True)
    return {opening: (first, *further) for opening, first, (_, *further) in every}


def effects_of(openings: PaneGroups, scope: EnabledEffects, case: Case) -> EnabledEffects:
    """Effects of a case, with those that the fills of its openings call for.

    Parameters
    ----------
    openings : PaneGroups
    scope : EnabledEffects
        Effects that the case as drawn calls for.
    case : Case
        Its choice of an effect, "off", holds for fills, too.
    """
    chosen = case.effects
    fills = [material for of_group in openings.materials for material in of_group]

    def calls(name: str, kind: Callable[[SurfaceMaterial | None], bool]) -> bool:
        return getattr(scope, name) or (getattr(chosen, name) != "off" and any(map(kind, fills)))

    sides = {side for facings in openings.facings for side in facings}
    has_across = len(sides) + bool(case.standing) > 1 and not isinstance(case.sun, Adaptive)
    depth = scope.depth if chosen.interreflection == "off" or not fills else None
    return replace(
        scope,
        clear_panes=calls("clear_panes", lambda m: m is None or isinstance(m, GlazingMaterial)),
        scattering_panes=calls("scattering_panes", lambda m: isinstance(m, DiffuserMaterial)),
        films=calls("films", lambda m: isinstance(m, BsdfMaterial)),
        pane_to_pane=calls("pane_to_pane", lambda m: has_across and is_mirroring_glass(m)),
        depth=depth,
    )


def _wall(case: Case, openings: PaneGroups, group: int) -> Lambertian:
    """Material of the wall around an opening, its front towards the room."""
    if case.room is not None:
        return Lambertian(case.room.walls)
    panes, around = panes_of_model(case.building), dict[Lambertian, str]()
    for layer, polygon in zip(panes.layer.tolist(), panes.polygon.tolist(), strict=True):
        mine = case.building.layers[layer].polygon == polygon
        if (openings.of_quads[layer][mine] == group).all():
            around |= materials_around(case.building, panes.quads[layer][mine])
    if len(around) != 1:
        named = ", ".join(map(shortened, around.values())) or "no wall"
        got = f"around {shortened(openings.states.names[group])} there are {named}"
        remedy = "ask for the wall of openings that lie in walls of one material"
        raise InputError(case.source, "fills", got, remedy)
    return next(iter(around))


def _fill(case: Case, name: str) -> SurfaceMaterial | None:
    """Material of a fill; None is a hole."""
    if name == HOLE:
        return None
    if name not in case.panes or name in RESERVED or "/" in name:
        known = [HOLE, WALL, *case.panes]
        got = f"no fill {shortened(name)}"
        raise InputError(case.source, "fills", got, choose(name, known))
    return case.materials[name]
