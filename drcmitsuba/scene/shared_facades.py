"""Façades of several variants of a case as openings that all of them share.

A room of boxes is cut into tiles along the edges of all variants. Panes of a model stay where they
are: those of one material that face one direction are an opening, and variants differ in what
stands in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, GroupStates
from drcmitsuba.model.materials import Reflectance, SurfaceMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side, shortened
from drcmitsuba.scene.like_panes import NO_GROUP, LikePanes, assigned_to, like_panes
from drcmitsuba.scene.materials import shade_covers
from drcmitsuba.scene.pane_groups import Member, PaneGroups
from drcmitsuba.scene.panes_in_state import groups_with_surfaces
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.tiled_facades import TiledFacades, refuse_structures_in_strips

_MAY_DIFFER = {"name", "facade", "materials", "groups", "design", "views"}
"""Tables of which the year of a variant takes nothing, or its own."""


@dataclass(frozen=True, eq=False)
class SharedFacades:
    """Openings of several variants, and what each variant puts there."""

    case: Case
    """The case without its façades, groups and shade."""
    panes: PaneGroups
    """Openings with every fill of any variant, and every state of a group or the shade."""
    drawn: tuple[Mapping[int, np.ndarray], ...]
    """Shares (fill,) of the openings in each variant, the shade open."""
    members: tuple[Mapping[int, Member], ...]
    """Groups of `[groups]` that openings belong to in each variant."""

    @classmethod
    def of(cls, cases: Sequence[Case]) -> SharedFacades:
        """Find the openings of variants.

        Raises
        ------
        InputError
            The variants differ in more than their façades, have no window, or a component stands
            in a strip.
        """
        refuse_unlike(cases)
        if cases[0].model is not None:
            return _of_models(cases)
        tiled = TiledFacades.of_variants(cases)
        return cls(tiled.case, tiled.panes, tiled.drawn, tiled.members)


def refuse_unlike(cases: Sequence[Case]) -> None:
    """Refuse variants that differ in more than their façades, or that tiles cannot hold."""
    first = cases[0]
    materials = dict(first.materials)
    replaced = {layer.name for layer in first.building.layers if layer.role == "pane"}
    frames: dict[Side, Reflectance] = {}
    for case in cases:
        for field in type(first).model_fields:
            if field not in _MAY_DIFFER and getattr(case, field) != getattr(first, field):
                remedy = f"variants share all but their façades: take [{field}] of {first.source}"
                raise InputError(case.source, field, "differs from the first case's", remedy)
        for name, material in case.materials.items():
            if name not in replaced and materials.setdefault(name, material) != material:
                got = "another variant has another material of this name"
                raise InputError(case.source, f"materials.{name}", got, "give it another name")
        refuse_structures_in_strips(case, "evaluate each case")
        for side, facade in case.facade.items():
            if frames.setdefault(side, facade.frame_reflectance) != facade.frame_reflectance:
                field = f"facade.{side}.frame_reflectance"
                got = "differs from that of another variant"
                raise InputError(case.source, field, got, "make them agree")


def _of_models(cases: Sequence[Case]) -> SharedFacades:
    """Openings of variants of a model: its panes by material and direction."""
    first = cases[0]
    every = [*like_panes(first)]
    if not every:
        raise InputError(first.source, "model.files", "no pane to the outside", "give them panes")
    for case in cases:
        _refuse_other_panes(case, first, every)
    kinds = [_kinds(cases, panes) for panes in every]
    fills = [(OPEN, *names) for names in (tuple(of)[1:] for of in kinds)]
    states = GroupStates(tuple(map(str, every)), tuple(fills))
    assigned = assigned_to(first, [(panes, g) for g, panes in enumerate(every)])
    panes = PaneGroups(
        states, *assigned, tuple((panes.facing,) for panes in every),
        tuple(tuple(of.values())[1:] for of in kinds),
        spaces=tuple((panes.space,) if panes.space else () for panes in every),
    )  # fmt: skip
    known = [[*of.values()] for of in kinds]
    drawn, members = [], []
    for case in cases:
        rows, of_case = {}, {}
        for g, (own, materials) in enumerate(zip(every, known, strict=True)):
            fill = materials.index(_drawn(case, own))
            rows[g] = np.eye(len(materials), dtype=np.float32)[fill]
            group, further = _states(case, own)
            if further:
                of_case[g] = Member(group, tuple(map(materials.index, further)))
        drawn.append(rows)
        members.append(of_case)
    bare = first.with_tables(shading=None, groups={})
    return SharedFacades(bare, panes, tuple(drawn), tuple(members))


def _refuse_other_panes(case: Case, first: Case, every: Sequence[LikePanes]) -> None:
    """Refuse a variant of a model whose surfaces differ, or panes that no opening holds."""
    for group in groups_with_surfaces(case)[:1]:
        got = "its states have surfaces of their own"
        raise InputError(case.source, f"groups.{group}", got, "evaluate each case")
    known = {(panes.layer, panes.facing, panes.space) for panes in every}
    outside = {
        layer: sum(len(p.quads) for p in every if p.layer == layer and p.quads is not None)
        for layer, *_ in known
    }
    if {(panes.layer, panes.facing, panes.space) for panes in like_panes(case)} != known:
        got, remedy = "other panes than the first case's", "take its [model] and kinds of materials"
        raise InputError(case.source, "materials", got, remedy)
    both = zip(case.building.layers, first.building.layers, strict=True)
    for i, (own, other) in enumerate(both):
        if own.material != other.material and outside.get(i, 0) < len(own.quads):
            got = f"{shortened(own.name)} differs from the first case's, and stands within rooms"
            raise InputError(case.source, f"materials.{own.name}", got, "evaluate each case")


def _kinds(cases: Sequence[Case], panes: LikePanes) -> dict[str, SurfaceMaterial | None]:
    """Fills of an opening by name: the first case's, those of the others, states, the shade."""
    kinds: dict[str, SurfaceMaterial | None] = {panes.name: _drawn(cases[0], panes)}

    def add(name: str, material: SurfaceMaterial | None) -> None:
        if material in kinds.values():
            return
        number, clean = 1, name.replace("/", "-")
        while (each := clean if number == 1 else f"{clean} {number}") in (OPEN, *kinds):
            number += 1
        kinds[each] = material

    for case in cases:
        add(panes.name, _drawn(case, panes))
        for material in _states(case, panes)[1]:
            add(f"{panes.name} closed", material)
    shading = cases[0].shading
    if shading is not None and any(map(shade_covers, kinds.values())):
        shade = cases[0].materials[shading.material]
        kinds = {k: m for k, m in kinds.items() if k == panes.name or m != shade}
        kinds[shading.material] = shade
    return kinds


def _drawn(case: Case, panes: LikePanes) -> SurfaceMaterial:
    layer = case.building.layers[panes.layer]
    return case.materials.get(layer.name, layer.material)


def _states(case: Case, panes: LikePanes) -> tuple[int, tuple[SurfaceMaterial | None, ...]]:
    """Group of `[groups]` that panes belong to, and their materials in its further states."""
    groups = prepared(case).groups
    assert panes.quads is not None
    group = int(groups.of_quads[panes.layer][panes.quads[0]])
    if group == NO_GROUP or not case.groups or len(groups.states.states[group]) == 1:
        return NO_GROUP, ()
    layer, count = case.building.layers[panes.layer], len(groups.states.states[group])
    further = (groups.material(None, group, k, layer) for k in range(1, count))
    return group, tuple(further)
