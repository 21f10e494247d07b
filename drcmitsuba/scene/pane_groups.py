"""Groups of panes of a case: which panes change their state together, and what they become.

Panes belong to the groups of `[groups]`. Without any, the clear panes that a shade may cover form
groups by the direction that they face, as LM-83 closes the shades of each façade on its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, HIDDEN, OPEN, OTHERS, RESERVED, SHADED, GroupStates
from drcmitsuba.model.materials import Lambertian, SurfaceMaterial
from drcmitsuba.model.model import Layer
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene.geometry import rotation
from drcmitsuba.scene.panes_of_model import panes_of_model, side_name

NO_GROUP = -1


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
            return cls(GroupStates((), ()), {}, _of_no_group(case), (), ())
        return _by_facing(case)

    def __len__(self) -> int:
        """Count the groups."""
        return len(self.states)

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
            return own
        if index == HIDDEN:
            return None
        if index == BLOCKED:
            return Lambertian(0.0)
        if self.materials[group]:
            return self.materials[group][index - 1]
        assert layer is not None
        return layer.states[min(index, len(layer.states) - 1)].material


@dataclass(frozen=True)
class _Pane:
    """A pane, or all alike: name of its material, direction, and where to write its group."""

    name: str
    facing: str
    clear: bool
    strip: tuple[str, str] | None = None
    layer: int = -1
    polygon: int = -1


def _panes(case: Case) -> Iterator[_Pane]:
    """Yield the panes of a case that stand between a room and the outside."""
    for side, facade in case.facade.items():
        for name in dict.fromkeys(s.material for s in facade.strips):
            if name != "wall" and name not in case.components:
                yield _Pane(name, side, case.is_clear(name), strip=(name, side))
    panes, turn = panes_of_model(case.building), rotation(case).T
    for i in np.flatnonzero(panes.outside):
        layer = case.building.layers[panes.layer[i]]
        facing = side_name(panes.front[i] @ turn, is_outside=True)
        clear, polygon = case.is_clear(layer.name), int(panes.polygon[i])
        yield _Pane(layer.name, facing, clear, layer=int(panes.layer[i]), polygon=polygon)


def _of_no_group(case: Case) -> tuple[np.ndarray, ...]:
    return tuple(np.full(len(layer.quads), NO_GROUP) for layer in case.building.layers)


def _assigned(
    case: Case, panes: list[tuple[_Pane, int]]
) -> tuple[dict[tuple[str, str], int], tuple[np.ndarray, ...]]:
    """Groups by strip, and by quad of every layer."""
    of_strip = {pane.strip: group for pane, group in panes if pane.strip is not None}
    of_quads = _of_no_group(case)
    tables: dict[int, dict[int, int]] = {}
    for pane, group in panes:
        if pane.strip is None:
            tables.setdefault(pane.layer, {})[pane.polygon] = group
    for i, table in tables.items():
        layer = case.building.layers[i]
        lookup = np.full(int(layer.polygon.max()) + 1, NO_GROUP)
        lookup[list(table)] = list(table.values())
        of_quads[i][:] = lookup[layer.polygon]
    return of_strip, of_quads


def _by_facing(case: Case) -> PaneGroups:
    """Groups of the clear panes by direction; one group of all where they close together."""
    assert case.shading is not None
    every = list(_panes(case))
    clear = [pane for pane in every if pane.clear]
    facings = list(dict.fromkeys(pane.facing for pane in clear))
    shade = (case.materials[case.shading.material],)
    if len(facings) < 2 or case.shading.groups == "together":
        states, numbers = GroupStates.of_shade(), [0] * len(clear)
    else:
        states = GroupStates(tuple(facings), ((OPEN, SHADED),) * len(facings))
        numbers = [facings.index(pane.facing) for pane in clear]
    assigned = list(zip(clear, numbers, strict=True))
    if len(states) == 1:
        return PaneGroups(states, *_assigned(case, assigned), (tuple(facings),), (shade,))
    each = tuple((facing,) for facing in facings)
    return _with_others(case, every, assigned, states, each, (shade,) * len(states))


def _by_table(case: Case) -> PaneGroups:
    """Groups of `[groups]`."""
    every, taken = list(_panes(case)), dict[_Pane, str]()
    layers, assigned, states, materials = case.building.layers, [], [], []
    facings = []
    for number, (name, group) in enumerate(case.groups.items()):
        own = not group.panes
        mine = [
            pane
            for pane in every
            if group.facing in (None, pane.facing)
            and (
                (pane.layer >= 0 and layers[pane.layer].group == name)
                if own
                else any(fnmatchcase(pane.name, pattern) for pattern in group.panes)
            )
        ]
        if not mine:
            known = dict.fromkeys(f"{p.name} ({p.facing})" for p in every)
            got = "no pane is meant"
            if own:
                got = f"no group {shortened(name)} of panes to the outside in the model"
            remedy = f"name some of the panes: {', '.join(list(known)[:8]) or 'there are none'}"
            raise InputError(case.source, f"groups.{name}.panes", got, remedy)
        for pane in mine:
            if pane in taken:
                got = f"{pane.name} ({pane.facing}) belongs to {taken[pane]}, too"
                raise InputError(case.source, f"groups.{name}.panes", got, "name it once")
            taken[pane] = name
            assigned.append((pane, number))
        of_model = own and not group.states
        taking = [layers[p.layer].states for p in mine] if of_model else []
        named = max(([s.name for s in each] for each in taking), key=len, default=[])
        usual = () if case.shading is None else (case.shading.material,)
        used = group.states or usual
        following = tuple(named[1:]) if of_model else used
        if not following:
            got = "no other state than open"
            remedy = "name materials in its states, or a material in [shading]"
            raise InputError(case.source, f"groups.{name}.states", got, remedy)
        facings.append(tuple(dict.fromkeys(pane.facing for pane in mine)))
        states.append((OPEN, *_told_apart(following)))
        materials.append(() if of_model else tuple(case.materials[m] for m in used))
    names = GroupStates(tuple(case.groups), tuple(states))
    return _with_others(case, every, assigned, names, tuple(facings), tuple(materials))


def _with_others(
    case: Case, every: list[_Pane], assigned: list[tuple[_Pane, int]], states: GroupStates,
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
    return PaneGroups(states, *_assigned(case, assigned), facings, materials)


def _told_apart(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of states without slashes, each once."""
    clean = [name.replace("/", "-") for name in names]
    return tuple(
        name if clean.count(name) == 1 and name not in RESERVED else f"{name} {i}"
        for i, name in enumerate(clean, 1)
    )
