"""Panes of a case by material and direction: the least that a group of panes may hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.scene.panes_of_model import panes_of_model

NO_GROUP = -1


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

    def __str__(self) -> str:
        return f"{self.name} ({self.facing})"


def like_panes(case: Case) -> Iterator[LikePanes]:
    """Yield the panes of a case that stand between a room and the outside."""
    for side, facade in case.facade.items():
        for name in dict.fromkeys(s.material for s in facade.strips):
            if name != "wall" and name not in case.components:
                yield LikePanes(name, side, case.is_clear(name), strip=(name, side))
    panes = panes_of_model(case.building)
    facings = np.array(panes.facing, object)
    for i in np.unique(panes.layer[panes.outside]).tolist():
        layer = case.building.layers[i]
        mine = panes.outside & (panes.layer == i)
        for facing in dict.fromkeys(facings[mine]):
            polygons = panes.polygon[mine & (facings == facing)]
            quads = np.flatnonzero(np.isin(layer.polygon, polygons))
            clear = case.is_clear(layer.name)
            yield LikePanes(layer.name, facing, clear, layer=i, quads=quads)


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
