"""Irradiance of receivers by way of one tile of a façade at a time, filled with one material.

Light that comes in has crossed exactly one tile, so D is a sum over tiles. Each class fills the
façade with one material throughout, in one replicate, and gives the part of D of each tile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.materials import BsdfMaterial, DiffuserMaterial
from drcmitsuba.runtime.random_streams import Draw, Key
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.scene import FilmPanes, ScatteringPanes, Scene, quad_mesh
from drcmitsuba.scene.surfaces import Enclosure
from drcmitsuba.transport.deposit import Deposit, Irradiance
from drcmitsuba.transport.diffusing_panes import PanePatches
from drcmitsuba.transport.facade_basis.facade import Palette, Tiles
from drcmitsuba.transport.films import Films, Looked


class _AllWithin(Enclosure):
    """Enclosure whose receivers are known to lie in the room."""

    def contains(self, points: mi.Float) -> bool:
        """Skip the test of every point, which takes longer than the rays of one tile."""
        return True


@dataclass(frozen=True)
class TiledRoom:
    """A room whose façade is filled with tiles.

    Parameters
    ----------
    shapes : tuple of mi.Shape
        Surfaces of the room without the tiles.
    corners : np.ndarray, shape (corner, 3)
        Corners of the room and the tiles [m].
    enclosure : Enclosure
        Enclosure without openings.
    tiles : Tiles
    palette : Palette
    channel : int
        Colour channel.
    """

    shapes: tuple[mi.Shape, ...]
    corners: np.ndarray
    enclosure: Enclosure
    tiles: Tiles
    palette: Palette
    channel: int = 0

    def scene(self, *more: mi.Shape) -> mi.Scene:
        """Make a scene of the room and other shapes."""
        shapes = {f"shape{i}": s for i, s in enumerate((*self.shapes, *more))}
        return mi.load_dict({"type": "scene", **shapes}, optimize=False)

    def with_openings(self, tiles: np.ndarray, clear: mi.Scene | None = None) -> Scene:
        """Room whose openings are the `tiles`, a mask (tile,), which clear panes may cover."""
        is_open = tiles[self.tiles.tile]
        closed = self.tiles.quads[~is_open]
        opaque = self.scene(*([quad_mesh("closed", closed)] if len(closed) else []))
        quads = self.tiles.quads[is_open]
        enclosure = _AllWithin(self.enclosure.size, self.enclosure.turn, quads)
        return Scene(opaque, opaque, clear, (), (), self.corners, enclosure)

    def with_panes(self, material: int) -> Scene:
        """Room with openings in place of the panes of a material, so that they hide nothing."""
        scene = self.with_openings(self.palette.allowed[:, material])
        return replace(scene, enclosure=self.enclosure)

    def quads(self, material: int) -> np.ndarray:
        """Rectangles that a material may fill, shape (rectangle, 4, 3) [m]."""
        return self.tiles.quads[self.palette.allowed[self.tiles.tile, material]]

    def tile_of(self, patches: PanePatches) -> np.ndarray:
        """Tile that each patch of a pane lies in, shape (patch,)."""
        centre = patches.corner + (patches.u + patches.v) / 2
        corner, u, _, v = np.moveaxis(self.tiles.quads, 1, 0)
        inside = np.ones((len(centre), len(corner)), bool)
        for edge in (u - corner, v - corner):
            along = ((centre[:, None] - corner) * edge).sum(-1) / (edge * edge).sum(-1)
            inside &= (along > 0) & (along < 1)
        return self.tiles.tile[inside.argmax(axis=1)]


def _subset(part: mi.TensorXf, columns: mi.UInt32) -> mi.TensorXf:
    """Some columns of a matrix."""
    rows, n = part.shape[0], dr.width(columns)
    at = dr.arange(mi.UInt32, rows * n)
    column = dr.gather(mi.UInt32, columns, at % n)
    index = at // n * dr.opaque(mi.UInt32, part.shape[1]) + column
    return mi.TensorXf(dr.gather(mi.Float, part.array, index), (rows, n))


@dataclass(frozen=True)
class Straight:
    """Straight light through tiles of one clear material."""

    base: Deposit
    scenes: dict[int, Scene]

    @classmethod
    def of(cls, room: TiledRoom, material: int, base: Deposit) -> Straight:
        """Make the scene of each tile that the material may fill."""
        kind = tuple(room.palette.materials.values())[material]
        pane = None if kind is None else mi.load_dict(bsdf(kind, room.channel))
        scenes = {}
        for tile in map(int, np.flatnonzero(room.palette.allowed[:, material])):
            quads = room.tiles.of(tile)
            clear = None
            if pane is not None:
                mesh = quad_mesh("pane", quads, pane)
                clear = mi.load_dict({"type": "scene", "pane": mesh}, optimize=False)
            scenes[int(tile)] = room.with_openings(np.arange(len(room.tiles)) == tile, clear)
        return cls(base, scenes)

    def part(
        self, tile: int, p: mi.Float, n: mi.Float, key: Key, sky_rays: int, samples: int
    ) -> Irradiance:
        """D of receivers by way of one tile [sr]."""
        deposit = replace(self.base, scene=self.scenes[tile])
        return deposit.straight(p, n, key, sky_rays, samples)


@dataclass(frozen=True)
class Glow:
    """Light that films send to receivers, in one replicate."""

    films: Films
    deposit: Deposit
    looked: Looked
    tile_of: np.ndarray

    @classmethod
    def scene(cls, room: TiledRoom, material: int) -> Scene:
        """Room with a film in all tiles that it may fill."""
        kind = tuple(room.palette.materials.values())[material]
        assert isinstance(kind, BsdfMaterial)
        quads = room.quads(material)
        panes = FilmPanes(quads, mi.load_dict(bsdf(kind, room.channel)))
        return replace(room.with_panes(material), films=(panes,))

    @classmethod
    def lit(cls, scene: Scene, base: Deposit, replicate: int, material: int) -> Deposit:
        """Compute D on the film."""
        size = 2 * base.accuracy.cell_size
        films = Films.of(scene, size, base.suns, base.diameter)
        return replace(base, scene=scene, films=films).lit(replicate, material)

    @classmethod
    def seen(cls, room: TiledRoom, lit: Deposit, p: mi.Float, n: mi.Float, key: Key) -> Glow:
        """Draw directions from receivers to the film."""
        assert lit.films is not None
        rays = lit.accuracy.pane_points
        looked = lit.films.looked(p, n, rays=rays, seed=lit.seed(key, Draw.FILMS))
        return cls(lit.films, lit, looked, room.tile_of(lit.films.patches))

    def part(self, tile: int) -> Irradiance:
        """D of the receivers by way of one tile [sr]."""
        assert self.deposit.on_films is not None
        directions = self.looked.of(self.tile_of == tile)
        return Irradiance(*self.films.sent(directions, self.deposit.on_films))


@dataclass(frozen=True)
class Spread:
    """Light that diffusing panes send to receivers, in one replicate."""

    deposit: Deposit
    transfer: mi.TensorXf
    tile_of: np.ndarray

    @classmethod
    def scene(cls, room: TiledRoom, material: int) -> Scene:
        """Room with a diffusing material in all tiles that it may fill."""
        kind = tuple(room.palette.materials.values())[material]
        assert isinstance(kind, DiffuserMaterial)
        quads = room.quads(material)
        panes = ScatteringPanes(quads, kind.transmittance, kind.reflectance)
        return replace(room.with_panes(material), scattering=(panes,))

    @classmethod
    def lit(cls, scene: Scene, base: Deposit, replicate: int, material: int) -> Deposit:
        """Compute D on the panes."""
        quads = [panes.quads for panes in scene.scattering]
        patches = PanePatches.of(quads, 2 * base.accuracy.cell_size)
        return replace(base, scene=scene, patches=patches).lit(replicate, material)

    @classmethod
    def seen(cls, room: TiledRoom, lit: Deposit, p: mi.Float, n: mi.Float, key: Key) -> Spread:
        """Compute the transfer K from the panes to receivers."""
        assert lit.patches is not None
        return cls(lit, lit.transfer(p, n, key), room.tile_of(lit.patches))

    def part(self, tile: int) -> Irradiance:
        """D of the receivers by way of one tile [sr]."""
        assert self.deposit.faces is not None
        patches = np.flatnonzero(self.tile_of == tile)
        columns = mi.UInt32(np.stack([2 * patches, 2 * patches + 1], axis=1).ravel())
        transfer = _subset(self.transfer, columns)
        rows = (_rows(part, columns) for part in self.deposit.faces)
        return Irradiance(*(transfer @ part for part in rows))


def _rows(part: mi.TensorXf, rows: mi.UInt32) -> mi.TensorXf:
    """Some rows of a matrix."""
    n = part.shape[1]
    if n == 0:
        return dr.zeros(mi.TensorXf, (dr.width(rows), 0))
    at = dr.arange(mi.UInt32, dr.width(rows) * n)
    stride = dr.opaque(mi.UInt32, n)
    index = dr.gather(mi.UInt32, rows, at // stride) * stride + at % stride
    return mi.TensorXf(dr.gather(mi.Float, part.array, index), (dr.width(rows), n))


def mean(parts: Sequence[Irradiance]) -> Irradiance:
    """Mean over replicates."""
    total = parts[0]
    for part in parts[1:]:
        total = total.plus(part)
    scaled = Irradiance(*(part / len(parts) if 0 not in part.shape else part for part in total))
    dr.eval(scaled.sky, scaled.sun)
    return scaled
