"""Façades cut into tiles: those of several variants of a room, or a grid that a search fills."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.model.materials import Lambertian, SurfaceMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side, shortened
from drcmitsuba.scene.facade_rectangles import FRAME, between, rectangles_of
from drcmitsuba.scene.fills import HOLE, WALL
from drcmitsuba.scene.geometry import SIDES, rectangles_on
from drcmitsuba.scene.materials import shade_covers
from drcmitsuba.scene.pane_groups import Member, PaneGroups, TiledSide, group_of


class _Tile(NamedTuple):
    name: str
    side: Side
    rectangles: np.ndarray
    """Left, right, bottom and top from the foot of the wall [m], shape (rectangle, 4)."""
    fills: tuple[str, ...]
    """Fill in every variant, or every fill that may stand in the tile."""


@dataclass(frozen=True, eq=False)
class TiledFacades:
    """Glazed sides of a room of boxes, cut into tiles."""

    case: Case
    """The case without its façades, groups and shade, with the materials of all variants."""
    panes: PaneGroups
    """Tiles as openings, with every fill that may stand in them, and the shade."""
    rectangles: tuple[np.ndarray, ...]
    """Left, right, bottom and top of the rectangles of every tile, from the foot of its wall [m],
    shape (rectangle, 4)."""
    fills: tuple[tuple[str, ...], ...]
    """Names of the fills by tile: materials, `HOLE`, `WALL` or `FRAME`."""
    is_open: np.ndarray
    """Whether a fill may stand in its tile while the shade is open, tile by tile, bool, (fill,)."""
    shade: str | None
    """Material of the shade."""
    drawn: tuple[dict[int, np.ndarray], ...]
    """Shares (fill,) of every tile in each variant, the shade open."""
    members: tuple[dict[int, Member], ...]
    """Groups of `[groups]` that tiles belong to as drawn in each variant, by tile."""
    grouped: tuple[tuple[Member | None, ...], ...] | None
    """Group that each tile belongs to with each of its fills, by the first case; None where it has
    no `[groups]`."""

    @classmethod
    def of_variants(cls, cases: Sequence[Case]) -> TiledFacades:
        """Cut the façades of variants, which differ in nothing else, along the edges of all.

        Raises
        ------
        InputError
            The case has no room, or no variant has a window.
        """
        tiles: list[_Tile] = []
        rest: dict[Side, np.ndarray] = {}
        for side in SIDES:
            if any(side in case.glazed for case in cases):
                of_side, rest[side] = _tiles(cases, side)
                tiles += of_side
        rows = [tuple(tile.fills[i] for tile in tiles) for i in range(len(cases))]
        return cls._of(cases, tiles, rest, rows)

    @classmethod
    def of_grid(
        cls, case: Case, side: Side, heights: np.ndarray, segments: int, fills: tuple[str, ...]
    ) -> TiledFacades:
        """Cut a side by a grid, every tile of which may have any fill, and the others as drawn.

        Parameters
        ----------
        heights : np.ndarray
            Edges of the rows, from the lowest to the highest [m].
        segments : int
            Number of equal parts that rows are cut into along the wall.
        fills : tuple of str
            Names of materials, `HOLE` or `WALL`; the first one stands in the tiles as drawn.

        Returns
        -------
        TiledFacades
            Tiles of the grid first, row by row from below, segments from the foot of the wall.

        Raises
        ------
        InputError
            The case has no room.
        """
        if case.room is None:
            raise InputError(case.source, "room", "there is none", "give sides of a [room] strips")
        length, height = case.room.wall(side)
        x, z = np.linspace(0, length, segments + 1), np.asarray(heights, float)
        grid = between(x, z)
        tiles = [_Tile(f"{side} {k}", side, r[None], fills) for k, r in enumerate(grid)]
        # A row of wall below the grid, and one above it.
        edges = np.array([0.0, z[0], z[-1], height])
        around = between(np.array([0.0, length]), edges)[[0, 2]]
        rest = {side: around[around[:, 3] - around[:, 2] > 1e-5]}
        drawn = [fills[0]] * len(tiles)
        for other in SIDES:
            if other != side and other in case.glazed:
                of_side, rest[other] = _tiles([case], other)
                tiles += of_side
                drawn += [tile.fills[0] for tile in of_side]
        return cls._of([case], tiles, rest, [tuple(drawn)])

    @classmethod
    def _of(
        cls, cases: Sequence[Case], tiles: Sequence[_Tile], rest: Mapping[Side, np.ndarray],
        rows: Sequence[tuple[str, ...]],
    ) -> TiledFacades:  # fmt: skip
        """Put tiles into a case; `rest` is the wall around them, `rows` the fill of every tile in
        each variant.
        """
        first = cases[0]
        if first.room is None or not tiles:
            remedy = "give sides of a [room] strips"
            raise InputError(first.source, "facade", "no window", remedy)
        materials = {name: m for case in cases for name, m in case.materials.items()}
        shade = None if first.shading is None else first.shading.material

        def material(name: str, side: Side) -> SurfaceMaterial | None:
            facades = (case.facade[side] for case in cases if side in case.facade)
            assert first.room is not None
            if name == FRAME:
                return Lambertian(next(facades).frame_reflectance)
            if name == WALL:
                return Lambertian(first.room.walls)
            return None if name == HOLE else materials[name]

        fills, kinds = [], []
        for tile in tiles:
            names = [*dict.fromkeys((*tile.fills, *_of_groups(cases, tile)))]
            is_clear = any(shade_covers(material(name, tile.side)) for name in names)
            by_shade = any(not case.groups for case in cases)
            if shade is not None and is_clear and shade not in names[1:] and by_shade:
                names.append(shade)
            fills.append(tuple(names))
            kinds.append([material(name, tile.side) for name in names])
        states = tuple(tuple(name.replace("/", "-") for name in names) for names in fills)
        cut = {
            side: TiledSide(
                rectangles_on(first.room, side, around),
                {t.name: rectangles_on(first.room, side, t.rectangles)
                 for t in tiles if t.side == side},
            )
            for side, around in rest.items()
        }  # fmt: skip
        panes = PaneGroups(
            GroupStates(tuple(tile.name for tile in tiles), states),
            {(tile.name, tile.side): g for g, tile in enumerate(tiles)},
            (),
            tuple((tile.side,) for tile in tiles),
            tuple(tuple(of_tile[1:]) for of_tile in kinds),
            tuple(of_tile[0] for of_tile in kinds),
            cut,
        )
        drawn = tuple(
            {
                g: np.eye(len(names), dtype=np.float32)[names.index(fill)]
                for g, (names, fill) in enumerate(zip(fills, row, strict=True))
            }
            for row in rows
        )
        bare = {side: Facade() for side in first.facade if side not in rest}
        tables = {"materials": materials, "facade": bare, "shading": None, "groups": {}}
        each = zip(tiles, fills, strict=True)
        return cls(
            case=first.with_tables(**tables),
            panes=panes,
            rectangles=tuple(tile.rectangles for tile in tiles),
            fills=tuple(fills),
            is_open=np.array([name in tile.fills for tile, names in each for name in names]),
            shade=shade,
            drawn=drawn,
            grouped=_grouped(first, tiles, fills) if first.groups else None,
            members=tuple(
                _members(case, tiles, fills, row) for case, row in zip(cases, rows, strict=True)
            ),
        )


def _of_groups(cases: Sequence[Case], tile: _Tile) -> list[str]:
    """Materials that a tile takes by the groups of its fills in any case."""
    found = (group_of(case, name, tile.side) for case in cases for name in tile.fills)
    return [material for group in found if group is not None for material in group[1]]


def _members(
    case: Case, tiles: Sequence[_Tile], fills: Sequence[tuple[str, ...]], drawn: Sequence[str]
) -> dict[int, Member]:
    """Groups of a case's tiles with the fills that stand in them as drawn."""
    each = enumerate(zip(tiles, fills, drawn, strict=True))
    found = {g: _member(case, tile, names, fill) for g, (tile, names, fill) in each}
    return {g: member for g, member in found.items() if member is not None}


def _grouped(
    case: Case, tiles: Sequence[_Tile], fills: Sequence[tuple[str, ...]]
) -> tuple[tuple[Member | None, ...], ...]:
    """Groups of tiles with each of the fills that may stand in them while everything is open."""
    return tuple(
        tuple(_member(case, tile, names, fill) if fill in tile.fills else None for fill in names)
        for tile, names in zip(tiles, fills, strict=True)
    )


def _member(case: Case, tile: _Tile, names: tuple[str, ...], fill: str) -> Member | None:
    """Group of a tile with a fill, one of its `names`."""
    if (group := group_of(case, fill, tile.side)) is None:
        return None
    number, materials = group
    return Member(number, tuple(map(names.index, materials)))


def _tiles(cases: Sequence[Case], side: Side) -> tuple[list[_Tile], np.ndarray]:
    """Tiles of a side, and the rectangles of wall around them [m]."""
    room = cases[0].room
    if room is None:
        return [], np.zeros((0, 4))
    facades = [case.facade.get(side, Facade()) for case in cases]
    rectangles, names = rectangles_of(facades, *room.wall(side))
    varies = (names != WALL).any(axis=1)
    kinds, tile = np.unique(names[varies], axis=0, return_inverse=True)
    tile = np.ravel(tile)
    made = [
        _Tile(f"{side} {k}", side, rectangles[varies][tile == k], tuple(map(str, kind)))
        for k, kind in enumerate(kinds)
    ]
    return made, rectangles[~varies]


def refuse_structures_in_strips(case: Case, remedy: str) -> None:
    """Refuse a component that stands in a strip, which tiles would cut."""
    for side, facade in case.facade.items():
        held = [strip.material for strip in facade.strips if strip.material in case.components]
        if held:
            got = f"{shortened(held[0])} stands in a strip that tiles would cut"
            raise InputError(case.source, f"facade.{side}", got, remedy)
