"""New windows in the walls of a model: what may stand in its tiles, and what they become."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.case.facade import THINNEST
from drcmitsuba.design.facade_tiles import Tiles
from drcmitsuba.design.layout import ROWS
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.realise import pieces_of
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, named_of_kind, shortened
from drcmitsuba.scene.like_panes import LikePanes
from drcmitsuba.scene.pane_groups import group_of
from drcmitsuba.scene.tiled_walls import TiledWalls, WallPane

CLEAR = "as drawn"
"""Name of what the model draws in its panes."""
LEVELS = 65
"""Number of heights at which areas are known that no upright edges bound."""


def clear_of(case: Case, design: Design) -> str:
    """Clear material of new windows, by default the first one of the case.

    Raises
    ------
    InputError
        There is no such glazing, or `[design]` asks for what walls of a model have not.
    """
    if design.wwr == "fixed":
        got, remedy = "fixed: the walls would get no window", "give wwr = [low, high]"
        raise InputError(case.source, "design.wwr", got, remedy)
    known = named_of_kind(case.materials, (GlazingMaterial,))
    if design.clear is None and not known:
        got = "no glazing in [materials]"
        raise InputError(case.source, "design.clear", got, "add one and name it")
    name = design.clear or known[0]
    if name not in known:
        got = f"{shortened(name)} is no such material in [materials]"
        raise InputError(case.source, "design.clear", got, choose(name, known))
    return name


def tiled_walls(case: Case, design: Design) -> TiledWalls:
    """Walls that `[design]` means, cut into its rows and segments; errors of `TiledWalls.of`."""
    return TiledWalls.of(case, design, design.rows or ROWS, design.segments or 1)


def with_fill(
    case: Case, material: str, panes: Iterable[str], tiles: Mapping[str, LikePanes] | None = None
) -> Case:
    """Case with a material in the panes of some names.

    `tiles` of those names join the group of `[groups]` that names the material; other panes stay in
    their own.
    """
    materials = {**case.materials, **dict.fromkeys(panes, case.materials[material])}
    groups, names = dict(case.groups), list(case.groups)
    for pane, tile in ({} if tiles is None else tiles).items():
        if (member := group_of(case, material, tile.facing, tile.space)) is not None:
            name = names[member[0]]
            group = groups[name]
            groups[name] = group.model_copy(update={"panes": (*group.panes, pane)})
    return case.with_tables(materials=materials, groups=groups)


def tiles_of(walls: TiledWalls | None, areas: np.ndarray, names: tuple[str, ...]) -> Tiles:
    """Tiles of all walls side by side, then panes of `areas` (pane,) [m²], each of 1 m height."""
    right = np.cumsum(areas)
    zero = np.zeros(len(areas))
    bounds = np.stack([right - areas, right, zero, zero + 1], axis=1)
    if walls is None:
        return Tiles(bounds, names)
    of_walls = np.array([tile.bounds for tile in walls.tiles])
    of_walls[:, :2] += walls.places[[tile.wall for tile in walls.tiles]][:, None]
    bounds[:, :2] += of_walls[:, 1].max()
    size = (of_walls[:, 1] - of_walls[:, 0]) * (of_walls[:, 3] - of_walls[:, 2])
    filled = np.array([tile.shape.area for tile in walls.tiles]) / size
    return Tiles(np.concatenate([of_walls, bounds]), names, np.append(filled, zero + 1))


@dataclass(frozen=True)
class WindowArea:
    """Area of new windows that `[design]` allows."""

    least: float
    """[m²]."""
    most: float
    """[m²]."""
    tiles: float
    """Area of all tiles [m²]."""

    @classmethod
    def of(cls, source: str, design: Design, walls: TiledWalls) -> WindowArea:
        """Subtract the panes that were drawn from the area of windows that `[design]` allows.

        Raises
        ------
        InputError
            The tiles cannot hold the least area, or the panes as drawn have the largest.
        """
        assert design.wwr != "fixed"
        low, high = (share * walls.area - walls.openings for share in design.wwr)
        room = float(sum(tile.shape.area for tile in walls.tiles))
        if low > room * (1 + 1e-6):
            most = (room + walls.openings) / walls.area
            got = f"a window-to-wall ratio of {design.wwr[0]:.3g}, the tiles have {most:.3g}"
            raise InputError(source, "design.wwr", got, "lower it, or give a wider band")
        if high <= 0:
            now = walls.openings / walls.area
            got = f"at most {design.wwr[1]:.3g}, the panes as drawn take {now:.3g} of the walls"
            raise InputError(source, "design.wwr", got, "give a larger share, or other walls")
        return cls(max(low, 0.0), min(high, room), room)

    @property
    def _fills(self) -> bool:
        """Whether all tiles are windows."""
        return self.least >= self.tiles * (1 - 1e-6)

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and largest area [m²]; None where all tiles are windows."""
        return None if self._fills else (self.least, self.most)

    def parameter(self, count: int) -> Parameter:
        """Share of window of `count` tiles; the first one has the least area, or half the most."""
        if self._fills:
            return Parameter.fixed("window", 1.0)
        start = (self.least or self.most / 2) / self.tiles
        return Parameter("window", 0.0, 1.0, min(start, 1.0), count)


def panes_of(
    walls: TiledWalls, share: np.ndarray, materials: Sequence[str], film: str
) -> list[WallPane]:
    """Panes of a composition (tile, material) in their walls.

    Materials share the area of a tile, one above the other in the order of `realise`. In a wall
    with an outer face, no pane spans two tiles.
    """
    stacks = defaultdict(list)
    for k, tile in enumerate(walls.tiles):
        stacks[tile.wall, tile.layer, tile.column].append(k)
    panes = []
    for stack in stacks.values():
        shapes = [walls.tiles[k].shape for k in stack]
        whole = shapely.union_all(shapes)
        z, below = _areas_below(whole)
        left, _, right, _ = whole.bounds
        ends = np.array([np.interp([s.bounds[1], s.bounds[3]], z, below) for s in shapes])
        column = Tiles(np.column_stack([np.zeros_like(ends), ends]))
        parts = np.asarray(share)[stack]
        least = 2 * THINNEST * (right - left)
        order = np.arange(len(stack))
        for *area, name in pieces_of(column, parts, order, list(materials), film, least):
            low, high = np.interp(area, below, z)
            box, wall = shapely.box(left, low, right, high), walls.tiles[stack[0]].wall
            if not any(walls.tiles[k].depth for k in stack):
                panes.append(WallPane(name, wall, shapely.intersection(box, whole)))
                continue
            for k in stack:  # each is a hole of its own
                shape = shapely.intersection(box, walls.tiles[k].shape)
                if not shapely.buffer(shape, -THINNEST / 2).is_empty:
                    panes.append(WallPane(name, wall, shape, walls.tiles[k].depth))
    return panes


def _areas_below(shape: Any) -> tuple[np.ndarray, np.ndarray]:
    """Heights [m], and the area of a shape below each of them [m²]."""
    left, low, right, high = shape.bounds
    corners = shapely.get_coordinates(shape)[:, 1]
    z = np.unique(np.append(corners, np.linspace(low, high, LEVELS)))
    boxes = shapely.box(left, low, right, z[1:])
    return z, np.append(0.0, shapely.area(shapely.intersection(boxes, shape)))
