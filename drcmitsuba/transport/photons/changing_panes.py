"""Panes that the states of a façade may change: photons are told apart by whether they met one.

Until then light goes the same way in all states that differ by the materials of these panes.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, GlazingMaterial
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import Scene, ScenePart

_PANES = GlazingMaterial | DiffuserMaterial | BsdfMaterial


@dataclass(frozen=True)
class ChangingPanes:
    """All panes of a scene that belong to no component."""

    quads: np.ndarray
    """Panes [m], shape (pane, 4, 3)."""

    @classmethod
    def of(cls, scene: Scene) -> ChangingPanes:
        """Collect the panes of a scene."""
        panes = (part.quads for part in scene.parts if _is_pane(part))
        return cls(np.concatenate([np.zeros((0, 4, 3)), *panes]))

    @cached_property
    def _known(self) -> Counter[bytes]:
        return Counter(quad.tobytes() for quad in self.quads)

    def have(self, part: ScenePart) -> bool:
        """Whether all quads of a part are such panes."""
        return all(quad.tobytes() in self._known for quad in part.quads)

    def alone_differ(self, one: Scene, other: Scene) -> bool:
        """Whether two scenes have these panes, and differ by their materials at most."""
        rests = []
        for scene in (one, other):
            mine = [part for part in scene.parts if self.have(part)]
            if Counter(q.tobytes() for part in mine for q in part.quads) != self._known:
                return False
            rest = (part for part in scene.parts if not self.have(part))
            rests.append([(p.material, p.component, p.closed, p.quads.tobytes()) for p in rest])
        return rests[0] == rests[1]

    def stand_before(self, quads: np.ndarray, normals: np.ndarray) -> bool:
        """Whether light may pass a pane on its way to ports (port, 4, 3) with their normals."""
        if not len(self.quads):
            return False
        corners = self.quads.reshape(-1, 3)
        heights = ((corners - quad[0]) @ n for quad, n in zip(quads, normals, strict=True))
        return any(h.min() < 0 for h in heights)

    @cached_property
    def _scene(self) -> mi.Scene:
        mesh = quad_mesh("panes", self.quads)
        return mitsuba_scene({"panes": mesh})

    def passed(self, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool) -> mi.Bool:
        """Whether active rays from points along directions pass a pane."""
        return self._scene.ray_test(mi.Ray3f(p, d), coherent=False, active=active)


def _is_pane(part: ScenePart) -> bool:
    return not part.component and isinstance(part.material, _PANES)
