"""Outer walls of a model cut into tiles, which may become windows.

A wall of a space (`space_walls`) is cut by a grid of rows and segments of its own. Tiles are panes
of the wall's own material: openings with fills, as panes that were drawn. Only those stay that look
at the sky or the ground; the others are wall again. Panes that were drawn stay what they are.

Where a wall has an outer face of its own (`outer_faces`), a tile lies in the inner one, and its
hole goes on through the outer one: inside, a tile that stays wall is the wall that it was.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.windows import DEEPEST, GRID, NewWindow, material_in, quads_in, with_windows
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene.facade_rectangles import between
from drcmitsuba.scene.geometry import reversed_quads
from drcmitsuba.scene.outer_faces import OuterFaces
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.space_walls import SpaceWall, meant_walls

BETWEEN = 0.5
"""Gap between walls side by side in a picture [m]."""
MOST_TILES = 500
"""Largest number of tiles, each of which is simulated with every fill."""
NARROW = 0.04
"""Width below which a part of a tile stays wall [m]."""
CURVED = 3
"""Number of directions by which a wall of a space that faces one side counts as curved."""
SAME_DIRECTION = 0.5
"""Angle within which planes have one direction [deg]."""


@dataclass(frozen=True, eq=False)
class WallTile:
    """Piece of a wall that may become a window."""

    name: str
    wall: int
    """Index of its wall."""
    column: int
    """Number of its segment, from the left as seen from outside."""
    bounds: tuple[float, float, float, float]
    """Left and right from the wall's left end, bottom and top above the space's floor [m]."""
    layer: int
    """Index of the layer that it is cut out of."""
    shape: Any
    """Piece in the wall's plane, as shapely's geometry [m]."""
    depth: float = 0.0
    """Distance of the wall's outer face [m]; 0 where the wall has one face."""


class WallPane(NamedTuple):
    """Pane that stands in a wall."""

    name: str
    """Name of its material."""
    wall: int
    """Index of the wall."""
    shape: Any
    """In the wall's plane, as shapely's geometry [m]."""
    depth: float = 0.0
    """Distance of the wall's outer face [m]; 0 where the wall has one face."""


@dataclass(frozen=True, eq=False)
class TiledWalls:
    """Outer walls of a model, and the tiles that they are cut into."""

    drawn: Case
    """The case as it was."""
    case: Case
    """The case with its tiles, each a layer of panes of the wall's material."""
    walls: tuple[SpaceWall, ...]
    tiles: tuple[WallTile, ...]

    @classmethod
    def of(cls, case: Case, design: Design, rows: int, segments: int) -> TiledWalls:
        """Cut the outer walls that `[design]` means into `rows` and `segments` each.

        Raises
        ------
        InputError
            No outer wall is meant, a wall is curved, several faces or none parallel to it stand
            before the outdoors, the band misses all walls, or there are more than `MOST_TILES`
            tiles.
        """
        walls = meant_walls(case, design)
        _refuse_curved(case, walls)
        tiles = _tiles(case, walls, design, rows, segments)
        if not tiles:
            low, high = design.band or (0, 0)
            got, remedy = f"no wall from {low:g} to {high:g} m", "give heights above the floor [m]"
            raise InputError(case.source, "design.band", got, remedy)
        if len(tiles) > MOST_TILES:
            got, remedy = f"{len(tiles)} tiles", f"at most {MOST_TILES}: name fewer walls, or rows"
            raise InputError(case.source, "design.rows", got, remedy)
        kept = _with_outer_faces(case, walls, tiles)
        if not kept:
            got = f"no outdoors behind {_named(case, walls)}"
            remedy = "name outer walls in side, spaces or walls"
            raise InputError(case.source, "design.walls", got, remedy)
        used = sorted({tile.wall for tile in kept})
        numbers = {wall: place for place, wall in enumerate(used)}
        tiles = [replace(tile, wall=numbers[tile.wall]) for tile in kept]
        walls = [walls[i] for i in used]
        return cls(case, _cut(case, walls, tiles), tuple(walls), tuple(tiles))

    @property
    def area(self) -> float:
        """Area of the walls' inner faces, their panes included [m²]."""
        return float(sum(wall.outline.area for wall in self.walls))

    @property
    def openings(self) -> float:
        """Area of panes and holes that were drawn in the walls [m²]."""
        return float(sum(wall.openings.area for wall in self.walls))

    @property
    def places(self) -> np.ndarray:
        """Left end of every wall where they stand side by side, shape (wall,) [m]."""
        bounds = np.array([wall.outline.bounds for wall in self.walls])
        return np.append(0.0, np.cumsum(bounds[:-1, 2] - bounds[:-1, 0] + BETWEEN))

    @property
    def layers(self) -> tuple[int, ...]:
        """Index of the layer of every tile in the case with its tiles."""
        count = len(self.case.building.layers)
        return tuple(range(count - len(self.tiles), count))

    def windows(self, panes: Sequence[WallPane]) -> list[NewWindow]:
        """Panes in the coordinates of the model."""
        return [_window(p.name, self.walls[p.wall], p.shape, p.depth) for p in panes]

    def with_windows(self, windows: Sequence[NewWindow]) -> Case:
        """Case as it was with windows of its materials."""
        model = with_windows(self.drawn.building, windows, self.drawn.materials)
        return self.drawn.with_building(model)


def _window(name: str, wall: SpaceWall, shape: Any, depth: float) -> NewWindow:
    """Window whose front faces the space of its wall."""
    quads = reversed_quads(quads_in(wall.plane, shape))
    return NewWindow(name, quads, f"window of {wall.space} ({wall.facing})", depth)


def _tiles(
    case: Case, walls: Sequence[SpaceWall], design: Design, rows: int, segments: int
) -> list[WallTile]:
    """Tiles of walls, row by row from below."""
    tiles: list[WallTile] = []
    numbers: dict[str, int] = defaultdict(int)
    taken = {layer.name for layer in case.building.layers} | {*case.materials}
    for w, wall in enumerate(walls):
        left, bottom, right, top = shapely.union_all([*wall.shapes.values(), wall.outline]).bounds
        foot = wall.floor - wall.plane.corner[2]
        low, high = design.band or (bottom - foot, top - foot)
        if design.row_height is not None:
            rows = min(100, max(1, round((high - low) / design.row_height)))
        x, z = np.linspace(left, right, segments + 1), np.linspace(low, high, rows + 1) + foot
        for k, cell in enumerate(between(x, z)):
            box = shapely.box(cell[0], cell[2], cell[1], cell[3])
            for layer, own in wall.shapes.items():
                shape = _wide(shapely.intersection(box, own, grid_size=GRID))
                if shape.is_empty:
                    continue
                numbers[wall.space] += 1
                name = f"{wall.space.replace('/', '-')} window {numbers[wall.space]}"
                while name in taken:
                    name += "'"
                taken.add(name)
                bounds = np.array(shape.bounds)[[0, 2, 1, 3]] - [left, left, foot, foot]
                column = k % segments
                tiles.append(WallTile(name, w, column, tuple(bounds.tolist()), layer, shape))
    return tiles


def _wide(shape: Any) -> Any:
    """Parts of a shape that are wider than `NARROW`."""
    parts = shapely.get_parts(shape)
    wide = ~shapely.is_empty(shapely.buffer(parts, -NARROW / 2)) if len(parts) else []
    return shapely.MultiPolygon([p for p, w in zip(parts, wide, strict=True) if w])


def _cut(case: Case, walls: Sequence[SpaceWall], tiles: Sequence[WallTile]) -> Case:
    """Case whose walls are cut into tiles of their own material, fronts towards the spaces."""
    layers, of_walls = case.building.layers, dict[tuple[int, int], Lambertian]()
    windows, materials = [], {}
    for tile in tiles:
        window = _window(tile.name, walls[tile.wall], tile.shape, tile.depth)
        key = tile.wall, tile.layer
        if key not in of_walls:
            of_walls[key] = material_in(layers[tile.layer], window.plane)
        materials[tile.name] = of_walls[key]
        windows.append(window)
    return case.with_building(with_windows(case.building, windows, materials))


def _outdoors(cut: Case, walls: Sequence[SpaceWall], tiles: Sequence[WallTile]) -> list[WallTile]:
    """Tiles with the outdoors on their outer side alone, from the case with all of them."""
    panes, first = panes_of_model(cut.building), len(cut.building.layers) - len(tiles)
    kept = []
    for k, tile in enumerate(tiles):
        (mine,) = np.flatnonzero(panes.layer == first + k)
        if panes.outside[mine] and panes.front[mine] @ walls[tile.wall].plane.normal < 0:
            kept.append(tile)
    return kept


def _refuse_curved(case: Case, walls: Sequence[SpaceWall]) -> None:
    """Refuse walls of a space that bend within one direction."""
    by_side: Mapping[tuple[str, str], list[SpaceWall]] = defaultdict(list)
    for wall in walls:
        by_side[wall.space, wall.facing].append(wall)
    for (space, facing), mine in by_side.items():
        azimuths = np.sort([wall.azimuth for wall in mine])
        directions = np.count_nonzero(np.diff(azimuths, append=azimuths[0] + 360) > SAME_DIRECTION)
        if directions >= CURVED:
            got = f"{_named(case, mine)} of {shortened(space)} bends to {facing} in "
            got += f"{directions} directions"
            remedy = "name plane walls in side, spaces or walls"
            raise InputError(case.source, "design.walls", got, remedy)


def _with_outer_faces(
    case: Case, walls: Sequence[SpaceWall], tiles: Sequence[WallTile]
) -> list[WallTile]:
    """Tiles with the outdoors behind them, or behind the one outer face of their wall."""
    at_once = {tile.name for tile in _outdoors(_cut(case, walls, tiles), walls, tiles)}
    if len(at_once) == len(tiles):
        return [*tiles]
    faces = OuterFaces(case)
    behind = {w: faces.behind(walls[w]) for w in {t.wall for t in tiles if t.name not in at_once}}
    deep = []
    for tile in tiles:
        if tile.name in at_once:
            deep.append(tile)
        elif face := faces.only_one(walls[tile.wall], behind[tile.wall], tile.shape):
            shape = _wide(face.shape)
            if not shape.is_empty:
                moved = (np.array(shape.bounds) - tile.shape.bounds)[[0, 2, 1, 3]]
                bounds = tuple((np.array(tile.bounds) + moved).tolist())
                deep.append(replace(tile, shape=shape, bounds=bounds, depth=face.depth))
    kept = _outdoors(_cut(case, walls, deep), walls, deep) if deep else []
    names = {tile.name for tile in deep}
    closed = [tile for tile in tiles if tile.name not in names]
    if not closed:
        return kept
    unclear = faces.unclear([walls[t.wall] for t in closed], [t.shape for t in closed])
    if unclear is not None:
        tile, count = closed[unclear[0]], unclear[1]
        layer = shortened(case.building.layers[tile.layer].name)
        got = f"{layer} of {shortened(walls[tile.wall].space)} has "
        got += (
            f"{count} further faces" if count > 1 else "no outer face in one plane parallel to it"
        )
        got += f" within {DEEPEST:g} m"
        remedy = "draw a wall with one face, or two parallel ones, or name other walls"
        raise InputError(case.source, "design.walls", got, remedy)
    return kept


def _named(case: Case, walls: Sequence[SpaceWall]) -> str:
    """Materials of walls, in words."""
    names = dict.fromkeys(case.building.layers[i].name for wall in walls for i in wall.shapes)
    return ", ".join(map(shortened, [*names][:4]))
