"""Panes of a case by material and direction: the least that a group of panes may hold.

Where groups close space by space, panes of a model are told apart by their spaces, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.space import space_at
from drcmitsuba.scene.panes_of_model import ModelPanes, panes_of_model
from drcmitsuba.scene.spaces import spaces_of

NO_GROUP = -1
INSIDE = (0.1, 0.3, 0.6, 1.0)
"""Distances from a pane at which its space is looked for: it may lie in a deep wall [m]."""


@dataclass(frozen=True, eq=False)
class LikePanes:
    """Panes of one material that face one direction, and where to write their group."""

    name: str
    facing: str
    clear: bool
    strip: tuple[str, str] | None = None
    """Material and side of a room of boxes."""
    layer: int = -1
    """Index of a model's layer."""
    quads: np.ndarray | None = None
    """Indices of their quads in the layer, int, shape (quad,)."""
    space: str = ""
    """Name of the space in which they stand, where that is asked for; "" for none."""

    @property
    def spaces(self) -> tuple[str, ...]:
        """Space by whose sensors alone a shade closes them, none where that is not asked for."""
        return (self.space,) if self.space else ()

    def __str__(self) -> str:
        return f"{self.name} ({self.facing}{', ' * bool(self.space)}{self.space})"


def like_panes(case: Case) -> Iterator[LikePanes]:
    """Yield the panes of a case that stand between a room and the outside."""
    for side, facade in case.facade.items():
        for name in dict.fromkeys(s.material for s in facade.strips):
            if name != "wall" and name not in case.components:
                yield LikePanes(name, side, case.is_clear(name), strip=(name, side))
    panes = panes_of_model(case.building)
    facings, spaces = np.array(panes.facing, object), _spaces(case, panes)
    for i in np.unique(panes.layer[panes.outside]).tolist():
        layer = case.building.layers[i]
        mine = panes.outside & (panes.layer == i)
        for facing, space in dict.fromkeys(zip(facings[mine], spaces[mine], strict=True)):
            polygons = panes.polygon[mine & (facings == facing) & (spaces == space)]
            quads = np.flatnonzero(np.isin(layer.polygon, polygons))
            clear = case.is_clear(layer.name)
            yield LikePanes(layer.name, facing, clear, layer=i, quads=quads, space=space)


def tells_spaces(case: Case) -> bool:
    """Whether groups of panes close space by space."""
    by_shade = case.shading is not None and case.shading.by_space and not case.groups
    return by_shade or any(group.spaces for group in case.groups.values())


def _spaces(case: Case, panes: ModelPanes) -> np.ndarray:
    """Name of the space that each polygon of panes stands in, "" for none, shape (polygon,)."""
    names = np.full(len(panes.layer), "", object)
    if not tells_spaces(case):
        return names
    spaces = spaces_of(case)
    for depth in INSIDE:
        nameless = np.flatnonzero(names == "")
        points = panes.frame[nameless].mean(axis=1) + depth * panes.front[nameless]
        at = space_at(spaces, points)
        names[nameless[at >= 0]] = [spaces[k].name for k in at[at >= 0]]
    return names


def of_no_group(case: Case) -> tuple[np.ndarray, ...]:
    """`NO_GROUP` for every quad of each layer of a model."""
    return tuple(np.full(len(layer.quads), NO_GROUP) for layer in case.building.layers)


def assigned_to(
    case: Case, panes: list[tuple[LikePanes, int]]
) -> tuple[dict[tuple[str, str], int], tuple[np.ndarray, ...]]:
    """Groups by strip, and by quad of every layer, from panes with the number of their group."""
    of_strip = {some.strip: group for some, group in panes if some.strip is not None}
    of_quads = of_no_group(case)
    for some, group in panes:
        if some.quads is not None:
            of_quads[some.layer][some.quads] = group
    return of_strip, of_quads
