"""Irradiance of receivers by way of one tile of a façade at a time, filled with one material.

Light that comes in has crossed exactly one tile, so D is a sum over tiles. The façade is filled
with one material throughout, and D is given by tile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.runtime.random_streams import Draw, Key, Stream
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import Scene, ScenePart
from drcmitsuba.scene.surfaces import Enclosure
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.facade_basis.facade import Palette, Tiles
from drcmitsuba.transport.films.films import Films
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.panes.patches import PanePatches


class _AllWithin(Enclosure):
    """Enclosure whose receivers are known to lie in the room."""

    def contains(self, points: mi.Float) -> bool:
        """Skip the test of every point, which takes longer than the rays of one tile."""
        return True


@dataclass(frozen=True)
class TiledRoom:
    """A room whose façade is filled with tiles."""

    shapes: tuple[mi.Shape, ...]
    """Surfaces of the room without the tiles."""
    corners: np.ndarray
    """Corners of the room and the tiles [m], shape (corner, 3)."""
    enclosure: Enclosure
    """Enclosure without openings."""
    tiles: Tiles
    palette: Palette

    def scene(self, *more: mi.Shape) -> mi.Scene:
        """Make a scene of the room and other shapes."""
        shapes = {f"shape{i}": s for i, s in enumerate((*self.shapes, *more))}
        return mitsuba_scene(shapes)

    def with_openings(self, tiles: np.ndarray, clear: mi.Scene | None = None) -> Scene:
        """Room whose openings are the `tiles`, a mask (tile,), which clear panes may cover."""
        is_open = tiles[self.tiles.tile]
        closed = self.tiles.quads[~is_open]
        opaque = self.scene(*([quad_mesh("closed", closed)] if len(closed) else []))
        quads = self.tiles.quads[is_open]
        enclosure = _AllWithin(self.enclosure.size, self.enclosure.turn, quads)
        return Scene(opaque, opaque, clear, self.corners, enclosure)

    def through(self, material: int) -> dict[int, Scene]:
        """Room with each tile that a clear material may fill as its only opening, by tile."""
        kind = self.palette.kinds[material]
        pane = None if kind is None else mi.load_dict(bsdf(kind))
        scenes = {}
        for tile in map(int, np.flatnonzero(self.palette.allowed[:, material])):
            clear = None
            if pane is not None:
                mesh = quad_mesh("pane", self.tiles.of(tile), pane)
                clear = mitsuba_scene({"pane": mesh})
            scenes[tile] = self.with_openings(np.arange(len(self.tiles)) == tile, clear)
        return scenes

    def with_panes(self, material: int, base: Deposit) -> Deposit:
        """Deposit in the room with a scattering material in all tiles that it may fill.

        Openings stand in place of the panes, which thus hide nothing.
        """
        kind, size = self.palette.kinds[material], 2 * base.accuracy.cell_size
        assert isinstance(kind, BsdfMaterial | DiffuserMaterial)
        quads = self.tiles.quads[self.palette.allowed[self.tiles.tile, material]]
        panes = ScenePart("panes", kind, quads, bsdf=mi.load_dict(bsdf(kind)))
        scene = self.with_openings(self.palette.allowed[:, material])
        scene = replace(scene, enclosure=self.enclosure, parts=(panes,))
        films = Films.of(scene, size, base.suns, base.diameter)
        patches = PanePatches.of([quads], size) if films is None else None
        return replace(base, scene=scene, films=films, patches=patches)

    def tile_of(self, patches: PanePatches) -> np.ndarray:
        """Tile that each patch of a pane lies in, shape (patch,)."""
        centre = patches.corner + (patches.u + patches.v) / 2
        corner, u, _, v = np.moveaxis(self.tiles.quads, 1, 0)
        inside = np.ones((len(centre), len(corner)), bool)
        for edge in (u - corner, v - corner):
            along = ((centre[:, None] - corner) * edge).sum(-1) / (edge * edge).sum(-1)
            inside &= (along > 0) & (along < 1)
        return self.tiles.tile[inside.argmax(axis=1)]


class Receivers(NamedTuple):
    """Sensors (number 1) or cells (0): points and normals in each draw, three numbers each."""

    number: int
    at: list[tuple[mi.Float, mi.Float]]
    sky_rays: int
    samples: int


ByTile = Callable[[int], list[Irradiance]]
"""Function that gives D [sr] by way of a tile, on each kind of receivers."""


def straight(
    room: TiledRoom, material: int, base: Deposit, draws: range, kinds: Sequence[Receivers]
) -> ByTile:
    """Mean D over the draws by straight light through a tile of a clear material."""
    scenes = room.through(material)

    def part(deposit: Deposit, tile: int, on: Receivers) -> Irradiance:
        keys = [(Stream.BASIS_STRAIGHT, d, material, on.number, tile) for d in draws]
        each = zip(on.at, keys, strict=True)
        return _mean([deposit.straight(*at, key, on.sky_rays, on.samples) for at, key in each])

    return lambda tile: [part(replace(base, scene=scenes[tile]), tile, on) for on in kinds]


def scattered(
    room: TiledRoom, material: int, base: Deposit, draws: range, kinds: Sequence[Receivers]
) -> ByTile:
    """Mean D over the draws by light that a tile of a material scatters."""
    panes = room.with_panes(material, base)
    view = _spread if panes.films is None else _glow
    lit = [panes.lit(d, material) for d in draws]
    parts = [
        [
            view(room, deposit, *at, (Stream.BASIS_SCATTERED, d, material, on.number))
            for d, deposit, at in zip(draws, lit, on.at, strict=True)
        ]
        for on in kinds
    ]
    return lambda tile: [_mean([part(tile) for part in each]) for each in parts]


def _glow(
    room: TiledRoom, lit: Deposit, p: mi.Float, n: mi.Float, key: Key
) -> Callable[[int], Irradiance]:
    """D of receivers by way of a tile, by the films that `lit` holds with the light on them."""
    films, on_films = lit.films, lit.on_films
    assert films is not None
    assert on_films is not None
    tile_of = room.tile_of(films.patches)
    looked = films.looked(p, n, rays=lit.accuracy.pane_points, seed=lit.seed(key, Draw.FILMS))
    return lambda tile: Irradiance(*films.sent(looked.of(tile_of == tile), on_films))


def _spread(
    room: TiledRoom, lit: Deposit, p: mi.Float, n: mi.Float, key: Key
) -> Callable[[int], Irradiance]:
    """D of receivers by way of a tile, by the diffusing panes that `lit` holds."""
    faces, patches = lit.faces, lit.patches
    assert faces is not None
    assert patches is not None
    tile_of, transfer = room.tile_of(patches), lit.transfer(p, n, key)

    def part(tile: int) -> Irradiance:
        rows = flat_indices(np.flatnonzero(np.repeat(tile_of == tile, 2)))
        return Irradiance(*(transfer[:, rows] @ on_faces[rows, :] for on_faces in faces))

    return part


def _mean(parts: Sequence[Irradiance]) -> Irradiance:
    """Mean over replicates."""
    total = parts[0]
    for part in parts[1:]:
        total = total.plus(part)
    scaled = Irradiance(*(part / len(parts) if 0 not in part.shape else part for part in total))
    dr.eval(scaled.sky, scaled.sun)
    return scaled
