"""Exits of each room of a building: the panes and holes from which light reaches its surfaces.

Rays from both sides of every pane and hole tell the cells that they meet first; the points that
stand for a cell know their room, and sensors know the surfaces around them. So a room of any shape
has the exits on its own side alone, those to neighbouring rooms among them, and does not ask for
the windows of others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, row_and_column
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.exits import exits_on_sides
from drcmitsuba.scene.geometry import is_triangle, normals, reversed_quads
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.rays.openings import has_shapeless_rooms

RAYS, FEWEST, TOGETHER = 256, 32, 1 << 22
"""Number of rays from each side of a pane or hole: fewer where all sides would have more together,
as those of glass that is a mesh of many triangles."""
AWAY = 1e-3
"""Distance of the rays' origins from it [m]."""


@dataclass(frozen=True)
class Passages:
    """Both sides of all panes and holes that straight light passes."""

    sides: np.ndarray
    """Quads [m], fronts towards the side, shape (side, 4, 3)."""
    keys: mi.UInt32
    """Key of the cell that each ray from a side meets first, flat (side, ray)."""
    met: mi.Bool
    """Whether the ray meets any."""
    rays: int
    """Number of rays from a side."""

    @classmethod
    def of(cls, scene: Scene, cell_size: float) -> Passages | None:
        """Passages of a scene with cells of a size [m]; None where no model has closed rooms, and
        where no light enters them: all rooms then have the exits of the scene, which are none.
        """
        if not has_shapeless_rooms(scene):
            return None
        assert scene.enclosure is not None
        assert scene.enclosure.passages is not None
        quads, grid = scene.enclosure.passages, CellGrid.of(scene, cell_size)
        if not len(quads):
            return None
        sides = np.concatenate([quads, reversed_quads(quads)])
        rays = int(np.clip(TOGETHER // len(sides), FEWEST, RAYS))
        block = max(1, SHADOW_RAYS // rays)
        starts = range(0, len(sides), block)
        parts = [_from_sides(scene, grid, sides[i : i + block], rays) for i in starts]
        keys, met = (dr.concat(part) for part in zip(*parts, strict=True))
        return cls(sides, keys, met, rays)

    def told(self, scene: Scene, gathered: Gathered, points: np.ndarray) -> Scene:
        """Scene that knows the exits of the rooms in which the sensors of some paths lie.

        `points` (sensor, 3) are the sensors [m]: of black surfaces, which are no cells, they tell
        those that they see.
        """
        within, drawn = gathered.within, gathered.drawn
        if within is None or scene.enclosure is None:
            return scene
        inside = np.flatnonzero(within)
        met = _around(scene, gathered.cells.grid, points[inside])
        cells, row = gathered.cells.extended(met), np.repeat(within[inside], RAYS)
        lies = np.zeros((cells.count + 1, int(within.max(initial=0)) + 1), bool)  # in which rooms
        seen = met.weight.numpy() > 0
        lies[cells.of(met).numpy()[seen], row[seen]] = True
        if drawn.within is not None:
            for own in drawn.within.numpy().reshape(drawn.replicates, -1):
                lies[np.arange(len(own)), own] = True
        cell = dr.gather(mi.UInt32, cells.index, self.keys, self.met)
        known = dr.compress(self.met & (cell < dr.opaque(mi.UInt32, cells.count)))
        lane, cell = known.numpy(), dr.gather(mi.UInt32, cell, known).numpy()
        sees = np.zeros((len(self.sides), lies.shape[1]), bool)
        side, first = np.unique(lane // self.rays, return_index=True)  # lanes rise
        if len(side):
            sees[side] = np.logical_or.reduceat(lies[cell], first, axis=0)
        exits = tuple(exits_on_sides(self.sides[own]) for own in sees.T[1:])
        return replace(scene, enclosure=replace(scene.enclosure, exits_by_room=exits))


def _around(scene: Scene, grid: CellGrid, points: np.ndarray) -> Vertices:
    """Vertices that `RAYS` rays in all directions from each point meet; of weight 0 for none."""
    row, ray = row_and_column(dr.arange(mi.UInt32, len(points) * RAYS), RAYS)
    d = mi.warp.square_to_uniform_sphere(even_numbers(ray, row, 1, 0))
    p = dr.gather(mi.Point3f, flat(points), row)
    key, met = _met(scene, grid, p, d)
    return Vertices(row, dr.select(met, mi.Float(1), 0), key, key, mi.Float(), mi.Float())


def _from_sides(
    scene: Scene, grid: CellGrid, sides: np.ndarray, rays: int
) -> tuple[mi.UInt32, mi.Bool]:
    """Key of the cell that every ray from some sides meets, and whether it meets any."""
    side, ray = row_and_column(dr.arange(mi.UInt32, len(sides) * rays), rays)
    edges = sides[:, 1] - sides[:, 0], sides[:, 3] - sides[:, 0]
    corner, along, up, n = (
        dr.gather(mi.Vector3f, flat(rows), side) for rows in (sides[:, 0], *edges, normals(sides))
    )
    uv = even_numbers(ray, side, 0, 0)
    fold = dr.gather(mi.Float, flat(is_triangle(sides)), side) * (uv.x + uv.y) > 1
    uv = dr.select(fold, 1 - uv, uv)
    local = mi.warp.square_to_cosine_hemisphere(even_numbers(ray, side, 0, 1))
    p = corner + uv.x * along + uv.y * up + AWAY * n
    return _met(scene, grid, p, mi.Frame3f(n).to_world(local))


def _met(scene: Scene, grid: CellGrid, p: mi.Point3f, d: mi.Vector3f) -> tuple[mi.UInt32, mi.Bool]:
    """Key of the cell that every ray meets, as `gather` gives it, and whether it meets any."""
    with scene.ray_counter.purpose("EXITS"):
        scene.ray_counter.add("path", mi.Bool(True), dr.width(d))
    si = scene.full.ray_intersect(mi.Ray3f(p, d), mi.RayFlags.Minimal, coherent=False)
    key, met = grid.key(si.p, dr.select(dr.dot(si.n, d) < 0, si.n, -si.n)), si.is_valid()
    dr.eval(key, met)
    return key, met
