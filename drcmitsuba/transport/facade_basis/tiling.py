"""How façades are cut into tiles: along the edges of several variants of a case, or by a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.model.materials import Reflectance
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import facade_quads
from drcmitsuba.transport.facade_basis.facade import FRAME, Palette, Tiles


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
    """Name the material of a façade at points.

    Parameters
    ----------
    length : float
        Length of the wall [m].
    x, z : np.ndarray, shape (point,)
        Position along the wall from its foot, and height [m].

    Returns
    -------
    np.ndarray of str, shape (point,)
        `FRAME` on frames.
    """
    names = np.full(len(x), "wall", dtype=object)
    width, half = length / facade.segments, facade.frame / 2
    segment = np.clip((x / width).astype(int), 0, facade.segments - 1)
    across = x - segment * width
    for strip in facade.strips:
        inside = (z > strip.bottom) & (z < strip.top)
        if strip.segments is not None:
            inside &= np.isin(segment, strip.segments)
        names[inside] = strip.material
        if half > 0 and strip.material != "wall":
            pane = (z > strip.bottom + half) & (z < strip.top - half)
            pane &= (across > half) & (across < width - half)
            names[inside & ~pane] = FRAME
    return names


def _cut(edges: set[float], low: float, high: float) -> np.ndarray:
    """Sorted edges within bounds; edges closer than 10 µm are merged."""
    all_edges = np.array(sorted({low, high, *(e for e in edges if low < e < high)}))
    return all_edges[np.r_[True, np.diff(all_edges) > 1e-5]]


def _rectangles(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Rectangles between the edges x and z, shape (rectangle, 4), row by row from below."""
    left, bottom = (a.ravel() for a in np.meshgrid(x[:-1], z[:-1]))
    right, top = (a.ravel() for a in np.meshgrid(x[1:], z[1:]))
    return np.stack([left, right, bottom, top], axis=1)


def _edges(facade: Facade, length: float) -> tuple[set[float], set[float]]:
    """Edges along and up a façade where its material may change [m]."""
    half = facade.frame / 2
    borders = np.arange(facade.segments + 1) * length / facade.segments
    ends = [end for strip in facade.strips for end in (strip.bottom, strip.top)]
    x, z = ({float(e + s) for e in at for s in (-half, 0, half)} for at in (borders, ends))
    return x, z


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
    _check_alike(cases)
    wall = Wall(cases[0], side_of(cases))
    length, height = wall.size
    facades = [case.facade.get(wall.side, Facade()) for case in cases]
    edges = [_edges(facade, length) for facade in facades]
    x = _cut(set().union(*(e[0] for e in edges)), 0.0, length)
    z = _cut(set().union(*(e[1] for e in edges)), 0.0, height)
    rectangles = _rectangles(x, z)
    centre = rectangles[:, :2].mean(axis=1), rectangles[:, 2:].mean(axis=1)
    names = np.stack([material_at(f, length, *centre) for f in facades], axis=1)
    varies = (names != "wall").any(axis=1)
    rectangles, names = rectangles[varies], names[varies]
    kinds, tile = np.unique(names.astype(str), axis=0, return_inverse=True)
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


_MAY_DIFFER = {"name", "facade", "materials", "design", "views"}
"""Tables of which the year of a variant takes nothing, or its own."""


def _check_alike(cases: Sequence[Case]) -> None:
    """Refuse variants that differ in more than their façades, or that a basis cannot hold."""
    first = cases[0]
    materials = dict(first.materials)
    frames: dict[Side, Reflectance] = {}
    for case in cases:
        if scene.is_coloured(case):
            got = "a reflectance differs between channels"
            raise InputError(case.source, "room", got, "make it grey, or evaluate each case")
        for field in type(first).model_fields:
            if field not in _MAY_DIFFER and getattr(case, field) != getattr(first, field):
                remedy = f"variants share all but their façades: take [{field}] of {first.source}"
                raise InputError(case.source, field, "differs from the first case's", remedy)
        for name, material in case.materials.items():
            if materials.setdefault(name, material) != material:
                got = "another variant has another material of this name"
                raise InputError(case.source, f"materials.{name}", got, "give it another name")
        for side, facade in case.facade.items():
            if frames.setdefault(side, facade.frame_reflectance) != facade.frame_reflectance:
                field = f"facade.{side}.frame_reflectance"
                got = "differs from that of another variant"
                raise InputError(case.source, field, got, "make them agree")


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
    rectangles = _rectangles(np.linspace(0, length, segments + 1), np.asarray(heights, float))
    count, quads = len(rectangles), facade_quads(wall.case, wall.side, rectangles)
    allowed = np.ones((count, len(materials)), bool)
    palette = Palette.of(wall.case, materials, allowed)
    return Tiles(rectangles, np.arange(count), quads), palette


def wall_around(wall: Wall, tiles: Tiles) -> np.ndarray:
    """Rest of a wall beside the tiles, shape (quad, 4, 3), fronts into the room [m]."""
    length, height = wall.size
    left, right, bottom, top = tiles.rectangles.T
    x = _cut({*map(float, left), *map(float, right)}, 0.0, length)
    z = _cut({*map(float, bottom), *map(float, top)}, 0.0, height)
    pieces = _rectangles(x, z)
    cx, cz = pieces[:, :2].mean(axis=1)[:, None], pieces[:, 2:].mean(axis=1)[:, None]
    taken = ((cx > left) & (cx < right) & (cz > bottom) & (cz < top)).any(axis=1)
    return facade_quads(wall.case, wall.side, pieces[~taken])
