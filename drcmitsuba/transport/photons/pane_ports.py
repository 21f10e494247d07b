"""Sides of panes on which photons start: those that may send light to what deviates it once more.

Light that a pane deviates first counts by photons where a mirror, a solid, a film or a component
deviates it again: see `transport.photons`. What scatters flies on in the half-space before it, so a
shade before which stands nothing of the kind needs no photons.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    MirrorMaterial,
)
from drcmitsuba.scene.geometry import Port, normals, reversed_quads
from drcmitsuba.scene.materials import is_mirroring_glass
from drcmitsuba.scene.scene import Scene, ScenePart
from drcmitsuba.transport.mirrors.planar_mirrors import turns_beyond_mirrors

LEVEL = 1e-6
"""Distance from a plane within which points lie in it, per metre of coordinates."""
_NO_CORNERS = np.zeros((0, 3))


class Side(NamedTuple):
    """Side of a pane on which light may be deviated."""

    part: ScenePart
    quad: np.ndarray
    """Corners [m], shape (4, 3); the front is along the light."""
    from_room: bool
    """Whether the light comes from where the pane faces."""

    @property
    def sends_back(self) -> bool:
        """Whether the pane reflects light that comes to this side."""
        m = self.part.material
        return not isinstance(m, DiffuserMaterial) or m.sides[not self.from_room] > 0


def pane_sides(scene: Scene, *, imaged: bool = False) -> list[Side]:
    """List the sides of panes on which light may be deviated.

    What clear panes mirror has exact images, and starts photons only where surfaces of other kinds
    may deviate it once more, or where photons count what is `imaged`.

    Inside a room only panes that face an opening get light that no surface has deviated.
    """
    sides, followed = [], imaged or turns_beyond_mirrors(scene)
    for part in scene.parts:
        m = part.material
        if isinstance(m, GlazingMaterial) and not followed:
            continue
        if part.component or not (
            is_mirroring_glass(m) or isinstance(m, BsdfMaterial | DiffuserMaterial)
        ):
            continue
        for quad, n in zip(part.quads, normals(part.quads), strict=True):
            # Clear panes without an index mirror to the room only, which is where they face.
            if not isinstance(m, GlazingMaterial) or m.ior is not None:
                sides.append(Side(part, quad, False))
            room = scene.enclosure
            if room is None or ((room.openings - quad[0]) @ n > 1e-3).any():
                sides.append(Side(part, reversed_quads(quad[None])[0], True))
    return sides


def pane_ports(scene: Scene, *, imaged: bool = False) -> list[Port]:
    """Ports on the sides of panes whose light photons count."""
    sides = pane_sides(scene, imaged=imaged)
    if not sides:
        return []
    deviating = _corners(part.quads for part in scene.parts if _deviates(part))
    targets = np.concatenate([deviating, _leading(scene, deviating)])
    before, behind = _meet(np.array([side.quad for side in sides]), targets)
    counts = before | (behind & np.array([side.sends_back for side in sides]))
    counts |= np.array([isinstance(side.part.material, GlazingMaterial) for side in sides])
    return [Port("", side.quad) for side, some in zip(sides, counts, strict=True) if some]


def _deviates(part: ScenePart) -> bool:
    """Whether a surface deviates light that a pane has scattered, so that photons count it."""
    diffuses = isinstance(part.material, DiffuserMaterial) and bool(part.component)
    kinds = MirrorMaterial | DielectricMaterial | BsdfMaterial
    return diffuses or is_mirroring_glass(part.material) or isinstance(part.material, kinds)


def _leading(scene: Scene, deviating: np.ndarray) -> np.ndarray:
    """Corners (corner, 3) of diffusing panes that send light on, by others in turn, to these."""
    left = np.concatenate([np.zeros((0, 4, 3)), *(part.quads for part in scene.scattering)])
    leading, targets = [_NO_CORNERS], deviating
    while len(left) and len(targets):
        lead = np.logical_or(*_meet(left, targets))
        targets, left = left[lead].reshape(-1, 3), left[~lead]
        leading.append(targets)
    return np.concatenate(leading)


def _meet(quads: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether any corner lies before, and behind, the plane of each quad: two masks (quad,)."""
    if not len(corners):
        return np.zeros(len(quads), bool), np.zeros(len(quads), bool)
    n = normals(quads)
    level = LEVEL * (1 + max(abs(corners).max(), abs(quads).max()))
    planes = np.column_stack([n, np.einsum("qi,qi->q", n, quads[:, 0])])
    planes, plane_of = np.unique(np.round(planes, 9), axis=0, return_inverse=True)
    heights = (corners @ plane[:3] - plane[3] for plane in planes)
    sides = np.array([(h.max() > level, h.min() < -level) for h in heights])
    before, behind = sides[plane_of.ravel()].T
    return before, behind


def _corners(quads: Iterable[np.ndarray]) -> np.ndarray:
    """Corners (corner, 3) of several arrays of quads."""
    return np.concatenate([_NO_CORNERS, *(q.reshape(-1, 3) for q in quads)])
