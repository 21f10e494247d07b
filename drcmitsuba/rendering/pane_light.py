"""Light that no deposit of the room's panes knows, on diffusing panes that the eye sees glow.

Panes of components, as the diffuser at the end of a light pipe, have all of their light here: what
reaches them straight, by panes of the room, and by photons. Panes of the room have that of photons:
by components, or by way of other panes. Squares within the faces of patches count the photons.

Limit: photons count alike at any incidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.rendering.glow import GlowTable, from_row, scattering_of_components
from drcmitsuba.rendering.view_glow import ViewGlow
from drcmitsuba.runtime.random_streams import Draw, Key, Stream
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.panes.acceptance import Acceptance
from drcmitsuba.transport.panes.patches import OFFSET, PanePatches
from drcmitsuba.transport.photons.light import Landed
from drcmitsuba.transport.photons.receivers import SMALLEST, Squares, by_plane, in_plane
from drcmitsuba.transport.rays.openings import within_of

MOST_PLANES = 64
"""Largest number of planes of panes whose photons are counted."""
SUN_SAMPLES = 16
"""Directions from the face of a patch to the sun."""


@dataclass(frozen=True)
class PaneLight:
    """Light on the faces of the diffusing panes of a glow table."""

    table: GlowTable

    @cached_property
    def squares(self) -> Squares | None:
        """Squares within the faces; None without panes, or where these lie in too many planes."""
        every = [p for p in (self.table.patches, self.table.of_components) if p is not None]
        if not every:
            return None
        scene = self.table.scene
        faces = [_faces(scene, patches) for patches in every]
        points, normals, edge = map(np.concatenate, zip(*faces, strict=True))
        if len(by_plane(points, normals)) > MOST_PLANES:
            return None
        return Squares.around(scene, points, normals, edge)

    def by_sky(self, landed: Landed, lit: Deposit, replicate: int) -> mi.TensorXf:
        """Light by the sky's bins on all faces in a replicate, shape (face, bin) [sr].

        `lit` is the deposit of the replicate, whose panes are lit.
        """
        straight = self._straight(lit, replicate, 0)
        return self._joined(landed.sensors().sky, None if straight is None else straight.sky)

    def by_sun(self, landed: Landed | None, lit: Deposit, replicate: int) -> mi.TensorXf:
        """Light by the one sun of a deposit on all faces, as `by_sky`, shape (face, 1) [sr]."""
        straight = self._straight(lit, replicate, SUN_SAMPLES)
        none = dr.zeros(mi.TensorXf, (sum(self.table.faces), 1))
        by_photons = none if landed is None else landed.sensors().sun
        return self._joined(by_photons, None if straight is None else straight.sun)

    def _straight(self, lit: Deposit, replicate: int, samples: int) -> Irradiance | None:
        """Light on the faces of components that photons do not count; None without such panes."""
        patches = self.table.of_components
        if patches is None:
            return None
        key: Key = (Stream.COMPONENT_PANES, replicate)
        p, n = patches.face_points(np.random.default_rng(lit.seed(key, Draw.POINTS)))
        within = within_of(lit.scene, patches.corners_of_faces)
        materials = [part.material for part in scattering_of_components(lit.scene)]
        accepted = Acceptance.of(materials, patches.owner)  # type: ignore[arg-type]
        accepts = None if accepted is None else accepted.at
        deposit = replace(lit, starts=patches.on_faces, accepts=accepts)
        rays = 4 * lit.accuracy.cell_sky_rays
        light = deposit.straight(p, n, key, rays, samples, within=within)
        return light.plus(lit.scattered(p, n, key))

    def _joined(self, by_photons: mi.TensorXf, straight: mi.TensorXf | None) -> mi.TensorXf:
        """Sum of both, of which the latter is on the faces of components alone."""
        if straight is None:
            return by_photons
        room, own = self.table.faces
        return by_photons + from_row(room, room + own, straight)

    def seen(self, glow: ViewGlow, parts: list[mi.TensorXf]) -> mi.Float:
        """Radiance by light on faces (face, column) in every replicate, as the eye sees it.

        It is flat (replicate, entry, column).
        """
        columns = parts[0].shape[1]
        own = dr.concat([self.table.further(E).array for E in parts])
        return glow.of_eye(own, columns)


def _faces(scene: Scene, patches: PanePatches) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points before the faces of patches, their normals, and edges of squares within them [m]."""
    sides = np.array([1.0, -1.0])[:, None]
    n = patches.normal[:, None] * sides
    points = (patches.middle[:, None] + OFFSET * n).reshape(-1, 3)
    u, v = (np.maximum(np.linalg.norm(e, axis=1), 1e-9) for e in (patches.u, patches.v))
    whole = np.linalg.norm(np.cross(patches.u, patches.v), axis=1)
    edge = np.maximum(whole / np.maximum(u, v), SMALLEST)  # the lesser height
    is_square = abs((patches.u * patches.v).sum(axis=1)) < 1e-3 * u * v
    axes = {tuple(n): in_plane(scene, n)[0] for n in np.unique(patches.normal, axis=0)}
    for k, normal in enumerate(patches.normal):
        along = abs(patches.u[k] @ axes[tuple(normal)]) / u[k]
        is_along = is_square[k] and (along < 1e-3 or along > 1 - 1e-3)
        edge[k] *= 1 / 3 if patches.triangular[k] else 1.0 if is_along else np.sqrt(0.5)
    return points, n.reshape(-1, 3), np.repeat(edge, 2)
