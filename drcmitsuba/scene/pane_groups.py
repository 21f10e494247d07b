"""Groups of panes of a case: which panes change their state together, and what they become.

Panes belong to the groups of `[groups]`. Without any, the clear panes that a shade may cover form
groups by the direction that they face, as LM-83 closes the shades of each façade on its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import (
    BLOCKED,
    HIDDEN,
    OPEN,
    OTHERS,
    SHADED,
    Group,
    GroupStates,
    told_apart,
)
from drcmitsuba.model.materials import (
    DielectricMaterial,
    Lambertian,
    MirrorMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.model import Layer
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side, fits, shortened
from drcmitsuba.scene.like_panes import (
    NO_GROUP,
    LikePanes,
    assigned_to,
    like_panes,
    of_no_group,
)


@dataclass(frozen=True)
class Member:
    """Place of an opening among the groups of a case."""

    group: int
    """Number of the group."""
    fills: tuple[int, ...]
    """Fill of the opening in each state of the group after the first."""


@dataclass(frozen=True, eq=False)
class TiledSide:
    """Side of a room of boxes that is cut into tiles, in the room's own frame."""

    wall: np.ndarray
    """Rectangles around the tiles, fronts inward [m], shape (rectangle, 4, 3)."""
    tiles: Mapping[str, np.ndarray]
    """Rectangles of every tile, likewise."""


NO_SURFACES = -1
"""In place of a state in which surfaces stand: none come and go with the group."""


@dataclass(frozen=True, eq=False)
class PaneGroups:
    """Groups of the panes of a case."""

    states: GroupStates
    """Names of the groups and of their states."""
    of_strip: Mapping[tuple[str, str], int]
    """Group of the panes of a room of boxes, by material and side."""
    of_quads: tuple[np.ndarray, ...]
    """Group of every quad of each layer of a model, `NO_GROUP` for none, int, shape (quad,)."""
    facings: tuple[tuple[str, ...], ...]
    """Directions that the panes of every group face, such as "south"."""
    materials: tuple[tuple[SurfaceMaterial | None, ...], ...]
    """Materials of the states of every group, one fewer than states: in the first state panes have
    their own. Empty for groups whose states the model gives."""
    drawn: tuple[SurfaceMaterial | None, ...] = ()
    """Materials of tiles in their first state; empty for panes, which have their own."""
    sides: Mapping[Side, TiledSide] = field(default_factory=dict)
    """Sides that are cut into tiles, in place of the strips of the case."""
    spaces: tuple[tuple[str, ...], ...] = ()
    """Spaces by whose sensors alone the rule of the shade closes each group, () for any; empty
    where none is asked for."""
    standing: tuple[int, ...] = ()
    """State of each group in which its surfaces stand, whatever state its panes take, or
    `NO_SURFACES`; empty: that of the panes."""

    @classmethod
    def of(cls, case: Case) -> PaneGroups:
        """Find the groups of a case.

        Raises
        ------
        InputError
            A group has no pane, no other state than `open`, or a pane of another group.
        """
        if case.groups:
            return _by_table(case)
        if case.shading is None:
            return cls(GroupStates((), ()), {}, of_no_group(case), (), ())
        return _by_facing(case)

    @classmethod
    def of_windows(cls, case: Case) -> PaneGroups:
        """Groups of `[groups]`; without any, the panes of each material and direction.

        The latter have one state.

        Raises
        ------
        InputError
            As for `of`.
        """
        if case.groups:
            return _by_table(case)
        every = list(like_panes(case))
        states = GroupStates(tuple(map(str, every)), ((OPEN,),) * len(every))
        assigned = assigned_to(case, list(zip(every, range(len(every)), strict=True)))
        return cls(states, *assigned, tuple((pane.facing,) for pane in every), ((),) * len(every))

    def __len__(self) -> int:
        """Count the groups."""
        return len(self.states)

    @property
    def members(self) -> dict[int, Member]:
        """Groups of openings that have these groups first, in their order, see `scene.fills`."""
        named = enumerate(zip(self.states.names, self.states.states, strict=True))
        own = [(g, states) for g, (name, states) in named if name != OTHERS]
        return {o: Member(g, (*range(1, len(s)),)) for o, (g, s) in enumerate(own)}

    def with_surfaces(self, groups: Sequence[int], states: Sequence[int]) -> PaneGroups:
        """The same panes beside the surfaces that some groups have in their states."""
        standing = [NO_SURFACES] * len(self)
        for group, state in zip(groups, states, strict=True):
            standing[group] = state
        return replace(self, standing=tuple(standing))

    def stands(self, group: int, state: int) -> bool:
        """Whether the surfaces of a group are those of a state, or it has none."""
        return not self.standing or self.standing[group] in (NO_SURFACES, state)

    def of_panes(self, panes: LikePanes) -> int:
        """Group of panes, `NO_GROUP` for none."""
        if panes.quads is not None:
            return int(self.of_quads[panes.layer][panes.quads[0]])
        assert panes.strip is not None
        return self.strip(*panes.strip)

    def strip(self, name: str, side: str) -> int:
        """Group of a strip's panes."""
        return self.of_strip.get((name, side), NO_GROUP)

    def material(
        self, own: SurfaceMaterial | None, group: int, index: int, layer: Layer | None = None
    ) -> SurfaceMaterial | None:
        """Material of panes in a state of their group; None leaves an opening.

        `own` is the material as drawn, None for a hole; a `layer` of a model may have states of its
        own.
        """
        if group == NO_GROUP or index == 0:
            return self.drawn[group] if self.drawn and group != NO_GROUP else own
        if index == HIDDEN:
            return None
        if index == BLOCKED:
            return Lambertian(0.0)
        if self.materials[group]:
            return self.materials[group][index - 1]
        assert layer is not None
        return layer.states[min(index, len(layer.states) - 1)].material


def group_of(
    case: Case, material: str, facing: str, space: str = ""
) -> tuple[int, tuple[str, ...]] | None:
    """Group of `[groups]` that panes of a material would belong to, and its further materials.

    Panes of no group give None.
    """
    for number, group in enumerate(case.groups.values()):
        named = fits(material, group.panes)
        if named and group.facing in (None, facing) and _in_spaces(group, space):
            return number, further_materials(case, group)
    return None


def _in_spaces(group: Group, space: str) -> bool:
    """Whether a group means panes of a space."""
    return not group.spaces or fits(space, group.spaces)


def facade_name(space: str, facing: str) -> str:
    """Name of the group of panes of a space that face a direction."""
    return f"{space} {facing}".strip()


def further_materials(case: Case, group: Group) -> tuple[str, ...]:
    """Names of the materials of a group's states after the first; those of a model have none."""
    return group.states or (() if case.shading is None else (case.shading.material,))


def _by_facing(case: Case) -> PaneGroups:
    """Groups of the clear panes by direction; one group of all where they close together."""
    assert case.shading is not None
    every = list(like_panes(case))
    clear = [pane for pane in every if pane.clear]
    facades = list(dict.fromkeys((pane.space, pane.facing) for pane in clear))
    shade = (case.materials[case.shading.material],)
    if case.shading.groups == "together" or (len(facades) < 2 and not any(s for s, _ in facades)):
        facings = tuple(dict.fromkeys(facing for _, facing in facades))
        assigned = [(pane, 0) for pane in clear]
        return PaneGroups(
            GroupStates.of_shade(), *assigned_to(case, assigned), (facings,), (shade,)
        )
    count, names = len(facades), tuple(facade_name(*each) for each in facades)
    states = GroupStates(names, ((OPEN, SHADED),) * count)
    assigned = [(pane, facades.index((pane.space, pane.facing))) for pane in clear]
    each = tuple((facing,) for _, facing in facades)
    groups = _with_others(case, every, assigned, states, each, (shade,) * count)
    return replace(groups, spaces=tuple((space,) if space else () for space, _ in facades))


def _by_table(case: Case) -> PaneGroups:
    """Groups of `[groups]`."""
    every, taken = list(like_panes(case)), dict[LikePanes, str]()
    assigned, facings, spaces, states, materials = [], [], [], [], []
    for number, name in enumerate(case.groups):
        mine = _meant(case, name, every)
        for some in mine:
            if some in taken:
                got = f"{some} belongs to {taken[some]}, too"
                raise InputError(case.source, f"groups.{name}.panes", got, "name it once")
            taken[some] = name
            assigned.append((some, number))
        names, of_states = _further_states(case, name, mine)
        facings.append(tuple(dict.fromkeys(some.facing for some in mine)))
        own = dict.fromkeys(some.space for some in mine if some.space)
        spaces.append(tuple(own) if case.groups[name].spaces else ())
        states.append((OPEN, *told_apart(names)))
        materials.append(of_states)
    groups = GroupStates(tuple(case.groups), tuple(states))
    of_all = _with_others(case, every, assigned, groups, tuple(facings), tuple(materials))
    return replace(of_all, spaces=tuple(spaces))


def _meant(case: Case, name: str, every: list[LikePanes]) -> list[LikePanes]:
    """Panes of a group: those whose material and direction it names, or those of the model's."""
    group, layers = case.groups[name], case.building.layers
    if group.panes:
        mine = [p for p in every if fits(p.name, group.panes)]
        got = "no pane is meant"
    else:
        mine = [p for p in every if p.layer >= 0 and layers[p.layer].group == name]
        got = f"no group {shortened(name)} of panes to the outside in the model"
    mine = [p for p in mine if group.facing in (None, p.facing) and _in_spaces(group, p.space)]
    if not mine and not group.panes and any(layer.group == name for layer in layers):
        if group.schedule is None or group.states:  # a shelf, the ground, or a tree
            got = "no pane to the outside, by which the sun could close it"
            remedy = "give it a schedule of the model's states, and no others"
            raise InputError(case.source, f"groups.{name}", got, remedy)
        return mine
    if not mine:
        known = list(dict.fromkeys(map(str, every)))[:8]
        remedy = f"name some of the panes: {', '.join(known) or 'there are none'}"
        if of_model := [g for g in dict.fromkeys(layer.group for layer in layers) if g]:
            remedy = f"{remedy}; groups of the model: {', '.join(map(shortened, of_model[:8]))}"
        raise InputError(case.source, f"groups.{name}.panes", got, remedy)
    return mine


def _further_states(
    case: Case, name: str, mine: list[LikePanes]
) -> tuple[tuple[str, ...], tuple[SurfaceMaterial | None, ...]]:
    """Names of a group's states after the first, and their materials; none for the model's own."""
    group = case.groups[name]
    if not group.panes and not group.states:
        layers = [layer for layer in case.building.layers if layer.group == name]
        _refuse_mirrors(case, name, layers)
        of_panes = [case.building.layers[panes.layer].states for panes in mine]
        of_layers = of_panes or [layer.states for layer in layers]
        names = tuple(state.name for state in max(of_layers, key=len)[1:])
        materials: tuple[SurfaceMaterial | None, ...] = ()
    else:
        names = further_materials(case, group)
        materials = tuple(case.materials[m] for m in names)
    if not names:
        got = "no other state than open"
        remedy = "name materials in its states, or a material in [shading]"
        raise InputError(case.source, f"groups.{name}.states", got, remedy)
    return names, materials


def _refuse_mirrors(case: Case, group: str, layers: list[Layer]) -> None:
    """Refuse mirrors and clear solids in the states of layers: photons start at fixed places."""
    for part in (part for layer in layers for part in (layer, *layer.added)):
        if any(isinstance(m, MirrorMaterial | DielectricMaterial) for m in part.materials):
            got = f"{shortened(part.name)} is a mirror or a clear solid in some state"
            remedy = "give it a diffuse reflectance in model.reflectances"
            raise InputError(case.source, f"groups.{group}.states", got, remedy)


def _with_others(
    case: Case, every: list[LikePanes], assigned: list[tuple[LikePanes, int]], states: GroupStates,
    facings: tuple[tuple[str, ...], ...], materials: tuple[tuple[SurfaceMaterial | None, ...], ...],
) -> PaneGroups:  # fmt: skip
    """Groups with those panes in a group of their own that belong to none."""
    taken = {pane for pane, _ in assigned}
    rest = [pane for pane in every if pane not in taken]
    if rest:
        assigned = [*assigned, *((pane, len(states)) for pane in rest)]
        states = GroupStates((*states.names, OTHERS), (*states.states, (OPEN,)))
        facings = (*facings, tuple(dict.fromkeys(pane.facing for pane in rest)))
        materials = (*materials, ())
    return PaneGroups(states, *assigned_to(case, assigned), facings, materials)
