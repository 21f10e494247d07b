"""How façades are cut into tiles: along the edges of several variants of a case, or by a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side
from drcmitsuba.scene import scene
from drcmitsuba.scene.fills import HOLE
from drcmitsuba.scene.geometry import facade_quads
from drcmitsuba.scene.tiled_facades import between, cut, fill_at, rectangles_of, refuse_unlike
from drcmitsuba.transport.facade_basis.facade import Palette, Tiles


@dataclass(frozen=True)
class Wall:
    """The side ("south", "east", "north" or "west") of a case's room that a basis opens."""

    case: Case
    side: Side

    @property
    def size(self) -> tuple[float, float]:
        """Length and height [m]."""
        assert self.case.room is not None
        return self.case.room.wall(self.side)


def side_of(cases: Sequence[Case]) -> Side:
    """Name of the one side with windows; refuse none or several, and cases without a room."""
    first = cases[0]
    sides = {side for case in cases for side in case.glazed}
    if first.room is None or not sides:
        raise InputError(first.source, "facade", "no window", "give one side of a [room] strips")
    if len(sides) > 1:
        got = f"windows in {', '.join(sorted(sides))}"
        raise InputError(first.source, "facade", got, "keep to one side, or evaluate each case")
    return sides.pop()


def material_at(facade: Facade, length: float, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Name the material of a façade at points: as `fill_at`, with "open" for a hole."""
    names = fill_at(facade, length, x, z)
    names[names == HOLE] = "open"
    return names


def of_variants(cases: Sequence[Case]) -> tuple[Wall, Tiles, Palette, list[np.ndarray]]:
    """Cut a façade into tiles that have one material in each of several variants.

    Parameters
    ----------
    cases : sequence of Case
        Variants that differ only in their façades.

    Returns
    -------
    wall : Wall
    tiles : Tiles
    palette : Palette
        Every tile may be filled with the materials that it has in the variants.
    shares : list of np.ndarray, shape (tile, material)
        Compositions of the variants with the shade open.

    Raises
    ------
    InputError
        The variants differ in something else, or cannot share a basis.
    """
    for case in cases:
        if scene.is_coloured(case):
            got = "a reflectance differs between channels"
            raise InputError(case.source, "room", got, "make it grey, or evaluate each case")
    refuse_unlike(cases)
    wall = Wall(cases[0], side_of(cases))
    facades = [case.facade.get(wall.side, Facade()) for case in cases]
    rectangles, names = rectangles_of(facades, *wall.size)
    names[names == HOLE] = "open"
    varies = (names != "wall").any(axis=1)
    rectangles, names = rectangles[varies], names[varies]
    kinds, tile = np.unique(names, axis=0, return_inverse=True)
    known = tuple(dict.fromkeys(map(str, kinds.ravel())))
    shares = [(kinds[:, i, None] == np.array(known)) for i in range(len(cases))]
    materials = {name: m for case in cases for name, m in case.materials.items()}
    whole = cases[0].model_copy(update={"materials": materials})
    frame = next(c.facade[wall.side] for c in cases if wall.side in c.facade).frame_reflectance
    palette = Palette.of(whole, known, np.any(shares, axis=0), frame)
    extra = len(palette.names) - len(known)
    padded = [np.pad(s.astype(np.float32), ((0, 0), (0, extra))) for s in shares]
    tiles = Tiles(rectangles, np.ravel(tile), facade_quads(cases[0], wall.side, rectangles))
    return wall, tiles, palette, padded


def of_grid(
    wall: Wall, heights: np.ndarray, segments: int, materials: tuple[str, ...]
) -> tuple[Tiles, Palette]:
    """Tiles of a regular grid, each of which may be filled with any material.

    Parameters
    ----------
    wall : Wall
    heights : np.ndarray
        Edges of the strips, from the lowest to the highest [m].
    segments : int
        Number of equal parts that strips are cut into along the wall.
    materials : tuple of str
        Names of the materials.

    Returns
    -------
    tiles : Tiles
        Tiles strip by strip from below, segments from the foot of the wall.
    palette : Palette
        All materials for every tile.
    """
    length, _ = wall.size
    rectangles = between(np.linspace(0, length, segments + 1), np.asarray(heights, float))
    count, quads = len(rectangles), facade_quads(wall.case, wall.side, rectangles)
    allowed = np.ones((count, len(materials)), bool)
    palette = Palette.of(wall.case, materials, allowed)
    return Tiles(rectangles, np.arange(count), quads), palette


def wall_around(wall: Wall, tiles: Tiles) -> np.ndarray:
    """Rest of a wall beside the tiles, shape (quad, 4, 3), fronts into the room [m]."""
    length, height = wall.size
    left, right, bottom, top = tiles.rectangles.T
    x = cut({*map(float, left), *map(float, right)}, length)
    z = cut({*map(float, bottom), *map(float, top)}, height)
    pieces = between(x, z)
    cx, cz = pieces[:, :2].mean(axis=1)[:, None], pieces[:, 2:].mean(axis=1)[:, None]
    taken = ((cx > left) & (cx < right) & (cz > bottom) & (cz < top)).any(axis=1)
    return facade_quads(wall.case, wall.side, pieces[~taken])
