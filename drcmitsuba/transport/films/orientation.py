"""Films as they are mounted: their orientation, and the sides that light and receivers reach."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.scene import Scene

PARALLEL = 1e-3
"""Largest difference of a component of unit normals of one orientation: corners of a pane that are
rounded to millimetres turn it by less."""


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
    only_reflects: bool = False
    """Whether light that passes the film is left out."""

    @property
    def rows(self) -> int:
        """Number of outgoing cells of all sides."""
        return len(self.sides) * self.bsdf.out_cells

    @property
    def context(self) -> mi.BSDFContext:
        """Lobes by which light reaches receivers, without the view straight through."""
        through, back = +mi.BSDFFlags.GlossyTransmission, +mi.BSDFFlags.GlossyReflection
        ctx = mi.BSDFContext()
        ctx.type_mask = through if self.exposed else back if self.only_reflects else through | back
        return ctx

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


def _frame(normal: np.ndarray, up: np.ndarray, level: np.ndarray) -> np.ndarray:
    """The pane's x, y and normal; y is the projection of `up`, or `level`, as in the plugins."""
    y = up - normal * (up @ normal)
    if np.linalg.norm(y) < 1e-4:
        y = level - normal * (level @ normal)
    y = y / np.linalg.norm(y)
    return np.array([np.cross(y, normal), y, normal])


def mounts(scene: Scene) -> list[Mount]:
    """Sort the films of a scene by material and orientation."""
    mounted, room = [], scene.enclosure
    for panes in scene.films:
        n, bsdf = normals(panes.quads), panes.bsdf
        up, level = (np.array(each).ravel() for each in (bsdf.up, bsdf.level))
        left = np.ones(len(n), bool)
        for normal in np.unique(n.round(6), axis=0):
            mine = left & (np.abs(n - normal).max(axis=1) < PARALLEL)
            if not mine.any():
                continue
            quads, left = panes.quads[mine], left & ~mine
            behind = lit = True  # without a known room, sensors may stand anywhere
            if room is not None:
                behind = bool(((scene.corners - quads[0, 0]) @ normal < -1e-3).any())
                # Straight light reaches the front through other walls' openings.
                lit = bool((np.abs((room.openings - quads[0, 0]) @ normal) > 1e-3).any())
            sides = (1, -1) if behind else (1,)
            frame = _frame(normal / np.linalg.norm(normal), up, level)
            mounted.append(Mount(bsdf, frame, quads, not (behind or lit), sides))
    return mounted
