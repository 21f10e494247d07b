"""Façades of several variants of a case as openings that all of them share.

A room of boxes is cut into tiles along the edges of all variants. Panes of a model stay where they
are: those of one material that face one direction are an opening, and variants differ in what
stands in them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, GroupStates
from drcmitsuba.model.materials import GlazingMaterial, Reflectance, SurfaceMaterial
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
    kinds: tuple[tuple[SurfaceMaterial | None, ...], ...]
    """Material of every fill, by opening; None of a hole. None for those that bring surfaces."""
    bringing: tuple[int, ...] = ()
    """Openings of a model's groups whose states bring surfaces, none of which is a pane."""
    factors: tuple[np.ndarray, ...] = ()
    """Factors of the light by every element in each variant, (element,); without any, 1."""

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
        first = zip(tiled.panes.drawn, tiled.panes.materials, strict=True)
        kinds = tuple((one, *others) for one, others in first)
        return cls(tiled.case, tiled.panes, tiled.drawn, tiled.members, kinds)

    def with_multiples(self, shade: str | None) -> SharedFacades:
        """Take panes that are multiples of another fill of their opening as that fill.

        Fills that a group or the `shade`, a material's name, puts there stay as they are, and so
        does the last of an opening that had a single one: its share would always be 1.
        """
        states, places, factors = [], [], []
        for g, fills in enumerate(self.panes.states.states):
            put = {f for of in self.members if g in of for f in of[g].fills}
            free = [f not in put and name != shade for f, name in enumerate(fills)]
            every = [*range(len(fills))]
            kept, place, factor = every, every, [1.0] * len(fills)
            if g not in self.bringing:
                kept, place, factor = _multiples(self.kinds[g], free)
            states.append(kept)
            places.append(place)
            factors.append(factor)
        return self._of_kept(states, places, factors)

    def _of_kept(
        self, kept: list[list[int]], places: list[list[int]], factors: list[list[float]]
    ) -> SharedFacades:
        """Take some fills of every opening: places among them, and factors, of all fills."""
        names = self.panes.states.names, self.panes.states.states
        states = tuple(tuple(of[f] for f in some) for of, some in zip(names[1], kept, strict=True))
        kinds = tuple(
            tuple(material for f, material in enumerate(of) if f in some)
            for of, some in zip(self.kinds, kept, strict=True)
        )
        known = GroupStates(names[0], states)
        materials = tuple(of[1:] for of in kinds)
        panes = replace(self.panes, states=known, materials=materials)
        drawn, members, weights = [], [], []
        for rows, of_groups in zip(self.drawn, self.members, strict=True):
            fills = {g: int(row.argmax()) for g, row in rows.items()}
            weight = np.ones(known.starts[-1], np.float32)
            for g, f in fills.items():
                weight[known.starts[g] + places[g][f]] = factors[g][f]
            weights.append(weight)
            drawn.append(
                {g: np.eye(len(kept[g]), dtype=np.float32)[places[g][f]] for g, f in fills.items()}
            )
            members.append(
                {
                    g: Member(member.group, tuple(places[g][f] for f in member.fills))
                    for g, member in of_groups.items()
                }
            )
        return replace(
            self, panes=panes, drawn=tuple(drawn), members=tuple(members), kinds=kinds,
            factors=tuple(weights),
        )  # fmt: skip


def _multiples(
    materials: Sequence[SurfaceMaterial | None], free: Sequence[bool]
) -> tuple[list[int], list[int], list[float]]:
    """Fills that stay, the place of every fill among them, and its factor."""
    kept, place, factor = list[int](), list[int](), list[float]()
    last = len(materials) - 1
    for f, material in enumerate(materials):
        found = None
        if free[f] and isinstance(material, GlazingMaterial) and not (f == last and kept == [0]):
            of_kept = (
                (i, material.multiple_of(materials[k])) for i, k in enumerate(kept) if free[k]
            )
            found = next(((i, times) for i, times in of_kept if times is not None), None)
        place.append(len(kept) if found is None else found[0])
        factor.append(1.0 if found is None else found[1])
        if found is None:
            kept.append(f)
    return kept, place, factor


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
    placed = [_placed(case, first, every) for case in cases]
    kinds = [_kinds(cases, panes, states) for panes, *states in zip(every, *placed, strict=True)]
    fills = [(OPEN, *names) for names in (tuple(of)[1:] for of in kinds)]
    names, brought = tuple(map(str, every)), _brought(cases)
    none = ((),) * len(brought)
    states = GroupStates((*names, *brought), (*fills, *brought.values()))
    assigned = assigned_to(first, [(panes, g) for g, panes in enumerate(every)])
    panes = PaneGroups(
        states, *assigned, (*((panes.facing,) for panes in every), *none),
        (*(tuple(of.values())[1:] for of in kinds), *none),
        spaces=(*(panes.spaces for panes in every), *none),
    )  # fmt: skip
    known = [[*of.values()] for of in kinds]
    drawn, members = [], []
    for case, of_groups in zip(cases, placed, strict=True):
        rows, of_case = {}, _bringing(case, brought, len(every))
        for g, (own, materials) in enumerate(zip(every, known, strict=True)):
            fill = materials.index(_drawn(case, own))
            rows[g] = np.eye(len(materials), dtype=np.float32)[fill]
            group, further = of_groups[g]
            if further:
                of_case[g] = Member(group, tuple(map(materials.index, further)))
        drawn.append(rows)
        members.append(of_case)
    return SharedFacades(
        first.with_tables(shading=None, groups={}), panes, tuple(drawn), tuple(members),
        (*(tuple(of.values()) for of in kinds), *none), (*range(len(every), len(states)),),
    )  # fmt: skip


def _brought(cases: Sequence[Case]) -> dict[str, tuple[str, ...]]:
    """States of the groups that bring surfaces in any case, by name."""
    return {name: states for case in cases for _, name, states in _groups_bringing(case)}


def _bringing(case: Case, brought: Mapping[str, object], first: int) -> dict[int, Member]:
    """Groups of a case that bring surfaces, by opening; these begin with the `first` one."""
    opening = {name: g for g, name in enumerate(brought, first)}
    return {
        opening[name]: Member(group, (*range(1, len(states)),))
        for group, name, states in _groups_bringing(case)
    }


def _groups_bringing(case: Case) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """Yield number, name and states of each group that brings surfaces."""
    groups, bringing = prepared(case).groups, groups_with_surfaces(case)
    every = zip(groups.states.names, groups.states.states, groups.materials, strict=True)
    for group, (name, states, materials) in enumerate(every):
        if name not in bringing:
            continue
        if materials:
            got = "states of its own, and surfaces of the model's first one"
            remedy = "take the states of the model, or evaluate the case by itself"
            raise InputError(case.source, f"groups.{name}.states", got, remedy)
        yield group, name, states


_States = tuple[int, tuple[SurfaceMaterial | None, ...]]
"""Number of a group, and the materials of its further states."""


def _placed(case: Case, first: Case, every: Sequence[LikePanes]) -> list[_States]:
    """Group of `[groups]` and its states by opening, of a case with the panes of the first one."""
    _refuse_other_panes(case, first, every)
    return [_states(case, panes) for panes in every]


def _refuse_other_panes(case: Case, first: Case, every: Sequence[LikePanes]) -> None:
    """Refuse a variant of a model whose surfaces differ, or panes that no opening holds."""
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


def _kinds(
    cases: Sequence[Case], panes: LikePanes, states: Sequence[_States]
) -> dict[str, SurfaceMaterial | None]:
    """Fills of an opening by name: the first case's, those of the others, states, the shade."""
    kinds: dict[str, SurfaceMaterial | None] = {panes.name: _drawn(cases[0], panes)}

    def add(name: str, material: SurfaceMaterial | None) -> None:
        if material in kinds.values():
            return
        number, clean = 1, name.replace("/", "-")
        while (each := clean if number == 1 else f"{clean} {number}") in (OPEN, *kinds):
            number += 1
        kinds[each] = material

    for case, (_, further) in zip(cases, states, strict=True):
        add(panes.name, _drawn(case, panes))
        for material in further:
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


def _states(case: Case, panes: LikePanes) -> _States:
    """Group of `[groups]` that panes belong to, and their materials in its further states."""
    groups = prepared(case).groups
    group = groups.of_panes(panes)
    if group == NO_GROUP or not case.groups or len(groups.states.states[group]) == 1:
        return NO_GROUP, ()
    layer, count = case.building.layers[panes.layer], len(groups.states.states[group])
    further = (groups.material(None, group, k, layer) for k in range(1, count))
    return group, tuple(further)
