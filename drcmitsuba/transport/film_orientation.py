"""Films as they are mounted: their orientation, and the sides that light and receivers reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.scene.scene import Scene


@dataclass(frozen=True)
class Mount:
    """A film in one orientation.

    Parameters
    ----------
    bsdf : mi.BSDF
    frame : np.ndarray, shape (3, 3)
        Rows: the pane's x, y (up) and normal into the room.
    quads : np.ndarray, shape (pane, 4, 3)
        Corners of the panes [m].
    exposed : bool
        Whether nothing lies beyond the panes' plane and no light comes from the room's side: all
        of the film has the same view.
    sides : tuple of int
        Faces that receivers may see: 1 front, −1 back.
    """

    bsdf: Any
    frame: np.ndarray
    quads: np.ndarray
    exposed: bool
    sides: tuple[int, ...]

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
        si.n = self.turn.n
        si.sh_frame = self.turn
        si.wi = outgoing
        return si


def _frame(normal: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The pane's x, y and normal; y is the projection of `up`, as in the plugins."""
    y = up - normal * (up @ normal)
    if np.linalg.norm(y) < 1e-4:
        y = np.array([0.0, 1.0, 0.0]) - normal * normal[1]
    y = y / np.linalg.norm(y)
    return np.array([np.cross(y, normal), y, normal])


def _lit_from_the_room(scene: Scene, pane: np.ndarray, normal: np.ndarray) -> bool:
    """Whether straight light may reach the front: through other walls' openings, or no room."""
    room = scene.enclosure
    if room is None:
        return True
    return bool((np.abs((room.openings - pane[0]) @ normal) > 1e-3).any())


def mounts(scene: Scene) -> list[Mount]:
    """Sort the films of a scene by material and orientation."""
    mounted = []
    for panes in scene.films:
        q, up = panes.quads, np.array(panes.bsdf.up).ravel()
        n = np.cross(q[:, 1] - q[:, 0], q[:, 3] - q[:, 0])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        for normal in np.unique(n.round(6), axis=0):
            quads = q[np.all(np.abs(n - normal) < 1e-5, axis=1)]
            # Without a known room, sensors may stand anywhere.
            beyond = ((scene.corners - quads[0, 0]) @ normal < -1e-3).any()
            behind = bool(beyond) or scene.enclosure is None
            lit = _lit_from_the_room(scene, quads[0], normal)
            sides = (1, -1) if behind else (1,)
            frame = _frame(normal / np.linalg.norm(normal), up)
            mounted.append(Mount(panes.bsdf, frame, quads, not (behind or lit), sides))
    return mounted
