"""Façades of several variants of a room, cut into tiles that have one fill in each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.model.materials import Lambertian, Reflectance, SurfaceMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side, shortened
from drcmitsuba.scene.fills import HOLE, WALL
from drcmitsuba.scene.geometry import SIDES, rectangles_on
from drcmitsuba.scene.materials import shade_covers
from drcmitsuba.scene.pane_groups import PaneGroups, TiledSide

FRAME = "(frame)"
"""Fill of a tile: the opaque frame around panes."""


@dataclass(frozen=True, eq=False)
class TiledVariants:
    """Variants of a case by tiles."""

    case: Case
    """The first variant without its façades, groups and shade, with the materials of all."""
    panes: PaneGroups
    """Tiles as openings, with the fills that they have in any variant, and the shade."""
    drawn: tuple[dict[int, np.ndarray], ...]
    """Shares (fill,) of every tile in each variant, the shade open."""

    @classmethod
    def of(cls, cases: Sequence[Case]) -> TiledVariants:
        """Cut the façades of variants, which differ in nothing else.

        Raises
        ------
        InputError
            The case has no room, or no variant has a window.
        """
        first, tiles = cases[0], []
        sides = [side for side in SIDES if any(side in case.glazed for case in cases)]
        if first.room is None or not sides:
            remedy = "give sides of a [room] strips"
            raise InputError(first.source, "facade", "no window", remedy)
        materials = {name: m for case in cases for name, m in case.materials.items()}
        around: dict[Side, TiledSide] = {}
        for side in sides:
            of_side, rest = _tiles(cases, side)
            quads = {name: rectangles_on(first.room, side, r) for name, r, _ in of_side}
            around[side] = TiledSide(rectangles_on(first.room, side, rest), quads)
            tiles += [(name, side, fills) for name, _, fills in of_side]
        shade = None if first.shading is None else first.shading.material

        def material(name: str, side: Side) -> SurfaceMaterial | None:
            facades = (case.facade[side] for case in cases if side in case.facade)
            assert first.room is not None
            opaque = {WALL: first.room.walls, FRAME: next(facades).frame_reflectance}
            if name in opaque:
                return Lambertian(opaque[name])
            return None if name == HOLE else materials[name]

        states, kinds, rows = [], [], tuple(dict[int, np.ndarray]() for _ in cases)
        for g, (_, side, fills) in enumerate(tiles):
            names = list(dict.fromkeys(fills))
            is_clear = any(shade_covers(material(name, side)) for name in names)
            if shade is not None and is_clear and shade not in names[1:]:
                names.append(shade)
            states.append(tuple(name.replace("/", "-") for name in names))
            kinds.append([material(name, side) for name in names])
            for row, fill in zip(rows, fills, strict=True):
                row[g] = np.eye(len(names), dtype=np.float32)[names.index(fill)]
        panes = PaneGroups(
            GroupStates(tuple(name for name, *_ in tiles), tuple(states)),
            {(name, side): g for g, (name, side, _) in enumerate(tiles)},
            (),
            tuple((side,) for _, side, _ in tiles),
            tuple(tuple(of_tile[1:]) for of_tile in kinds),
            tuple(of_tile[0] for of_tile in kinds),
            around,
        )
        bare = {side: Facade() for side in first.facade if side not in sides}
        tables = {"materials": materials, "facade": bare, "shading": None, "groups": {}}
        return cls(first.with_tables(**tables), panes, rows)


def _tiles(
    cases: Sequence[Case], side: Side
) -> tuple[list[tuple[str, np.ndarray, tuple[str, ...]]], np.ndarray]:
    """Tiles of a side, each with its name, its rectangles (rectangle, 4), and its fill in every
    variant; and the rectangles of wall around them [m].
    """
    room = cases[0].room
    assert room is not None
    facades = [case.facade.get(side, Facade()) for case in cases]
    rectangles, names = rectangles_of(facades, *room.wall(side))
    varies = (names != WALL).any(axis=1)
    kinds, tile = np.unique(names[varies], axis=0, return_inverse=True)
    tile = np.ravel(tile)
    made = [
        (f"{side} {k}", rectangles[varies][tile == k], tuple(map(str, kind)))
        for k, kind in enumerate(kinds)
    ]
    return made, rectangles[~varies]


def rectangles_of(
    facades: Sequence[Facade], length: float, height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rectangles of a wall, along the edges of all of several façades, and their fills.

    Returns
    -------
    rectangles : np.ndarray, shape (rectangle, 4)
        Left, right, bottom and top from the foot of the wall [m].
    names : np.ndarray of str, shape (rectangle, façade)
        As from `fill_at`.
    """
    edges = [edges_of(facade, length) for facade in facades]
    x = cut(set().union(*(e[0] for e in edges)), length)
    z = cut(set().union(*(e[1] for e in edges)), height)
    rectangles = between(x, z)
    centre = rectangles[:, :2].mean(axis=1), rectangles[:, 2:].mean(axis=1)
    names = np.stack([fill_at(f, length, *centre) for f in facades], axis=1).astype(str)
    return rectangles, names


def between(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Rectangles between the edges x and z, shape (rectangle, 4), row by row from below."""
    left, bottom = (a.ravel() for a in np.meshgrid(x[:-1], z[:-1]))
    right, top = (a.ravel() for a in np.meshgrid(x[1:], z[1:]))
    return np.stack([left, right, bottom, top], axis=1)


def fill_at(facade: Facade, length: float, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Name the fill of a façade at points.

    Parameters
    ----------
    length : float
        Length of the wall [m].
    x, z : np.ndarray, shape (point,)
        Position along the wall from its foot, and height [m].

    Returns
    -------
    np.ndarray of str, shape (point,)
        Names of materials, `HOLE`, `WALL` or `FRAME`.
    """
    names = np.full(len(x), WALL, dtype=object)
    width, half = length / facade.segments, facade.frame / 2
    segment = np.clip((x / width).astype(int), 0, facade.segments - 1)
    across = x - segment * width
    for strip in facade.strips:
        inside = (z > strip.bottom) & (z < strip.top)
        if strip.segments is not None:
            inside &= np.isin(segment, strip.segments)
        names[inside] = HOLE if strip.material == "open" else strip.material
        if half > 0 and strip.material != WALL:
            pane = (z > strip.bottom + half) & (z < strip.top - half)
            pane &= (across > half) & (across < width - half)
            names[inside & ~pane] = FRAME
    return names


def cut(edges: set[float], most: float) -> np.ndarray:
    """Sorted edges from 0 to `most`; edges closer than 10 µm are merged."""
    every = np.array(sorted({0.0, most, *(e for e in edges if 0 < e < most)}))
    return every[np.r_[True, np.diff(every) > 1e-5]]


def edges_of(facade: Facade, length: float) -> tuple[set[float], set[float]]:
    """Edges along and up a façade where its fill may change [m]."""
    half = facade.frame / 2
    borders = np.arange(facade.segments + 1) * length / facade.segments
    ends = [end for strip in facade.strips for end in (strip.bottom, strip.top)]
    x, z = ({float(e + s) for e in at for s in (-half, 0, half)} for at in (borders, ends))
    return x, z


_MAY_DIFFER = {"name", "facade", "materials", "design", "views"}
"""Tables of which the year of a variant takes nothing, or its own."""


def refuse_unlike(cases: Sequence[Case]) -> None:
    """Refuse variants that differ in more than their façades, or that tiles cannot hold."""
    first = cases[0]
    materials = dict(first.materials)
    frames: dict[Side, Reflectance] = {}
    for case in cases:
        if case.groups:
            remedy = "leave them out, or evaluate each case"
            raise InputError(case.source, "groups", "groups of panes in variants", remedy)
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
            held = [s.material for s in facade.strips if s.material in case.components]
            if held:
                got = f"{shortened(held[0])} stands in a strip that variants would cut"
                raise InputError(case.source, f"facade.{side}", got, "evaluate each case")
