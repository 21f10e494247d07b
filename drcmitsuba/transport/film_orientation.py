"""Films as they are mounted: their orientation, and the sides that light and receivers reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import sample_disk

from drcmitsuba.runtime.flat_arrays import flat, row_and_column
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.launch_size import SHADOW_RAYS
from drcmitsuba.transport.shadow_rays import sun_numbers


@dataclass(frozen=True)
class Mount:
    """A film in one orientation."""

    bsdf: Any
    frame: np.ndarray
    """Rows, shape (3, 3): the pane's x, y (up) and normal into the room."""
    quads: np.ndarray
    """Corners of the panes [m], shape (pane, 4, 3)."""
    exposed: bool
    """Whether nothing lies beyond the panes' plane and no light comes from the room's side: all of
    the film has the same view."""
    sides: tuple[int, ...]
    """Faces that receivers may see: 1 front, −1 back."""

    @property
    def rows(self) -> int:
        """Number of outgoing cells of all sides."""
        return len(self.sides) * self.bsdf.out_cells

    @property
    def cell_size(self) -> np.ndarray:
        """Projected solid angle of every outgoing cell of one side [sr]."""
        basis = getattr(self.bsdf, "basis", None)
        if basis is not None:
            return np.asarray(basis.projected_solid_angle, float)
        return np.full(self.bsdf.out_cells, np.pi / self.bsdf.out_cells)

    @property
    def turn(self) -> mi.Frame3f:
        """The pane's frame."""
        return mi.Frame3f(*(mi.Vector3f(*map(float, axis)) for axis in self.frame))

    def outgoing(self, row: mi.UInt32, uv: mi.Point2f) -> mi.Vector3f:
        """Direction in a row's cell, in the pane's frame."""
        cells = self.bsdf.out_cells
        front = (row < cells) if self.sides[0] == 1 else mi.Bool(False)
        return self.bsdf.out_direction(row % cells, uv, front)

    def interaction(self, outgoing: mi.Vector3f) -> mi.SurfaceInteraction3f:
        """Interaction with the pane that the BSDF is evaluated at."""
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(outgoing))
        si.n, si.sh_frame, si.wi = self.turn.n, self.turn, outgoing
        return si

    def answer_to_suns(
        self, suns: np.ndarray, diameter: float, samples: int, seed: int
    ) -> mi.Float:
        """Tabulate f [1/sr] from suns into the outgoing cells, shape (row · sun,)."""
        out = dr.zeros(mi.Float, self.rows * len(suns))
        directions, ctx = flat(suns), mi.BSDFContext()
        places = mi.UInt32(sun_numbers(suns))
        for start in range(0, dr.width(out), SHADOW_RAYS):
            lane = dr.arange(mi.UInt32, min(SHADOW_RAYS, dr.width(out) - start))
            pair = lane + dr.opaque(mi.UInt32, start)
            row, sun = row_and_column(pair, len(suns))
            centre = dr.gather(mi.Vector3f, directions, sun)
            place = dr.gather(mi.UInt32, places, sun)
            total, cosines = mi.Float(0), mi.Float(0)
            for i in range(samples):
                index = dr.full(mi.UInt32, i, dr.width(lane))
                d = sample_disk(centre, diameter, even_numbers(index, row, seed, 0, place))
                # Where f is the same all over a cell, its centre stands for it.
                even = self.bsdf.out_even
                uv = mi.Point2f(0.5) if even else even_numbers(index, row, seed, 1, place)
                si, wo = self.interaction(self.outgoing(row, uv)), self.turn.to_local(d)
                counts = (wo.z < 0) | (not self.exposed)
                total += dr.select(counts, self.bsdf.eval(ctx, si, wo)[0], 0)
                cosines += dr.select(counts, dr.abs(wo.z), 0)
            dr.scatter(out, dr.select(cosines > 0, total / cosines, 0), pair)
            dr.eval(out)
        return out


def _frame(normal: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The pane's x, y and normal; y is the projection of `up`, as in the plugins."""
    y = up - normal * (up @ normal)
    if np.linalg.norm(y) < 1e-4:
        y = np.array([0.0, 1.0, 0.0]) - normal * normal[1]
    y = y / np.linalg.norm(y)
    return np.array([np.cross(y, normal), y, normal])


def mounts(scene: Scene) -> list[Mount]:
    """Sort the films of a scene by material and orientation."""
    mounted, room = [], scene.enclosure
    for panes in scene.films:
        n, up = normals(panes.quads), np.array(panes.bsdf.up).ravel()
        for normal in np.unique(n.round(6), axis=0):
            quads = panes.quads[np.all(np.abs(n - normal) < 1e-5, axis=1)]
            behind = lit = True  # without a known room, sensors may stand anywhere
            if room is not None:
                behind = bool(((scene.corners - quads[0, 0]) @ normal < -1e-3).any())
                # Straight light reaches the front through other walls' openings.
                lit = bool((np.abs((room.openings - quads[0, 0]) @ normal) > 1e-3).any())
            sides = (1, -1) if behind else (1,)
            frame = _frame(normal / np.linalg.norm(normal), up)
            mounted.append(Mount(panes.bsdf, frame, quads, not (behind or lit), sides))
    return mounted
