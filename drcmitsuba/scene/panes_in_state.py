"""Panes of a case in one state of its façade, and the panes of every group in all states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.groups import HIDDEN, OPEN, State
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    SurfaceMaterial,
)
from drcmitsuba.model.model import Layer
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.geometry import SIDES, origin, recentred, rotation, wall
from drcmitsuba.scene.like_panes import NO_GROUP
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_of_model import by_side, panes_of_model
from drcmitsuba.scene.prepared_case import prepared

Quads = list[np.ndarray]
"""Rectangles, shape (4, 3) each, fronts inward [m]."""


@dataclass(frozen=True)
class PanesInState:
    """Panes of a case in one state of its façade."""

    case: Case
    effects: EnabledEffects
    groups: PaneGroups
    indices: tuple[int, ...]
    """Index of the state of every group."""

    @classmethod
    def of(
        cls, case: Case, state: State, effects: EnabledEffects, groups: PaneGroups | None = None
    ) -> PanesInState:
        """Panes of a case in a state, see `case.groups`, by default of its own groups."""
        groups = prepared(case).groups if groups is None else groups
        return cls(case, effects, groups, groups.states.indices(state))

    def index_of(self, name: str) -> int:
        """Index of the state of a group whose surfaces stand; 0 for what is no group.

        Panes that are blocked or hidden leave the surfaces of the first state.
        """
        names, indices = self.groups.states.names, self.groups.standing or self.indices
        return max(0, indices[names.index(name)]) if name in names else 0

    def follows_model(self, name: str) -> bool:
        """Whether the model gives the states of a group of the case."""
        names = self.groups.states.names
        return name in names and not self.groups.materials[names.index(name)]

    def wall(self, side: Side) -> tuple[Quads, Quads, dict[str, Quads]]:
        """Rectangles of wall, frame and panes of a side, as `geometry.wall` cuts it."""
        assert self.case.room is not None
        if (tiled := self.groups.sides.get(side)) is not None:
            return [*tiled.wall], [], {name: [*quads] for name, quads in tiled.tiles.items()}
        return wall(self.case.room, side, self.case.facade.get(side, Facade()))

    @property
    def glazed(self) -> list[Side]:
        """Sides that may have panes."""
        return [side for side in SIDES if side in self.case.facade or side in self.groups.sides]

    def strip(self, name: str, side: str, index: int | None = None) -> SurfaceMaterial | None:
        """Material of a façade strip; None where it is open or holds a component.

        `index` stands for another state than that of the façade.
        """
        group = self.groups.strip(name, side)
        own, index = self.case.materials.get(name), self._of(group, index)
        material = self.groups.material(own, group, index)
        return self._enabled(material, material is None and name == OPEN and index != HIDDEN)

    def layer(self, layer: Layer, group: int, index: int | None = None) -> SurfaceMaterial | None:
        """Material of panes of a model's layer; `index` as for `strip`."""
        own, index = self.case.materials.get(layer.name, layer.material), self._of(group, index)
        material = self.groups.material(own, group, index, layer)
        return self._enabled(material, material is None and index != HIDDEN)

    def rest(self, layer: Layer) -> SurfaceMaterial | None:
        """Material of what is no pane to the outside in a layer of a model; None leaves it out.

        It follows the model's states of its group, where the case takes these.
        """
        index, is_pane = self.index_of(layer.group), layer.role == "pane"
        material: SurfaceMaterial | None
        if index > 0 and self.follows_model(layer.group):
            material = layer.states[min(index, len(layer.states) - 1)].material
        else:
            material = self.case.materials.get(layer.name) if is_pane else None
            material = material or layer.material
        return self._enabled(material, material is None) if is_pane else material

    def _of(self, group: int, index: int | None) -> int:
        """Index of a state, by default that of the façade."""
        if index is not None or group == NO_GROUP:
            return index or 0
        return self.indices[group]

    def _enabled(self, material: SurfaceMaterial | None, hole: bool) -> SurfaceMaterial | None:
        """Material of a pane; black where light by way of its kind is left out."""
        effects = self.effects
        if isinstance(material, BsdfMaterial) and effects.straight_through is not None:
            mode = "on" if effects.straight_through else "off"
            material = material.model_copy(update={"straight_through": mode})
        out = (
            ((hole or isinstance(material, GlazingMaterial)) and not effects.clear_panes)
            or (isinstance(material, DiffuserMaterial) and not effects.scattering_panes)
            or (isinstance(material, BsdfMaterial) and not effects.films)
        )
        return Lambertian(0.0) if out else material


def groups_with_surfaces(case: Case) -> list[str]:
    """Groups of a case whose states change more than panes to the outside, each once."""
    groups = prepared(case).groups
    every = [
        layer.group
        for layer, of_quads in zip(case.building.layers, groups.of_quads, strict=True)
        if layer.group in case.groups
        and not groups.materials[groups.states.names.index(layer.group)]
        and ((of_quads == NO_GROUP).any() or any(state.shades for state in layer.states))
    ]
    every += [layer.stands_in for layer in case.building.layers if layer.stands_in in case.groups]
    return [*dict.fromkeys(every)]


def refuse_surfaces(case: Case) -> None:
    """Raise InputError where states of a group have surfaces of their own."""
    for group in groups_with_surfaces(case)[:1]:
        got = "its states have surfaces of their own"
        remedy = (
            "leave out its [groups.NAME], and name the state in which it stays: states in [model]"
        )
        raise InputError(case.source, f"groups.{group}", got, remedy)


def by_surfaces(
    case: Case, openings: PaneGroups, indices: np.ndarray
) -> list[tuple[PaneGroups, np.ndarray]]:
    """Openings with each set of surfaces that stands by states, and the rows that have it.

    A sum over openings knows light by pane, and no surfaces that come and go with the states of a
    group: a shelf that turns, snow, leaves.

    Parameters
    ----------
    case : Case
    openings : PaneGroups
        Its groups, or its openings.
    indices : np.ndarray of int, shape (row, opening)
        Index of the state of each.
    """
    names = groups_with_surfaces(case)
    if not names:
        return [(openings, np.arange(len(indices)))]
    bringing = [openings.states.names.index(name) for name in names]
    sets, of_row = np.unique(indices[:, bringing], axis=0, return_inverse=True)
    return [
        (openings.with_surfaces(bringing, states), np.flatnonzero(of_row.reshape(-1) == k))
        for k, states in enumerate(sets.tolist())
    ]


@dataclass(frozen=True, eq=False)
class GroupedPanes:
    """Panes of one material that belong to a group."""

    group: int
    """Index of the group."""
    quads: np.ndarray
    """Corners, fronts into the room, as in `surfaces_of` [m], shape (quad, 4, 3)."""
    materials: tuple[SurfaceMaterial | None, ...]
    """Material in each state of the group; None is a hole."""
    name: str = ""
    """Name of their surface."""


def grouped_panes(
    case: Case, effects: EnabledEffects = ALL_EFFECTS, groups: PaneGroups | None = None
) -> list[GroupedPanes]:
    """List the panes of a case by group and material, by default in the groups of the case."""
    groups = prepared(case).groups if groups is None else groups
    case = recentred(case)
    front = PanesInState(case, effects, groups, (0,) * len(groups))
    turn, states, found = rotation(case), front.groups.states.states, []
    for side in front.glazed:
        for name, quads in front.wall(side)[2].items():
            group = front.groups.strip(name, side)
            if group != NO_GROUP and quads:
                materials = [front.strip(name, side, i) for i in range(len(states[group]))]
                found.append((group, np.array(quads), materials, f"{name} {side}"))
    panes = panes_of_model(case.building)
    for i, of_layer in enumerate(panes.quads):
        layer, of_quads = case.building.layers[i], front.groups.of_quads[i]
        for group in np.unique(of_quads[of_quads != NO_GROUP]).tolist():
            own = tuple(front.layer(layer, group, k) for k in range(len(states[group])))
            for some, fills in by_side(own, panes.turned[i]):
                quads = of_layer[(of_quads == group) & some] - origin(case)
                if len(quads):
                    found.append((group, quads, list(fills), layer.name))
    return [GroupedPanes(group, quads @ turn.T, tuple(m), name) for group, quads, m, name in found]
