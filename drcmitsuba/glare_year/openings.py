"""Openings that the rays of an eye meet: an end counts with the share of the fill that it saw.

Panes of an opening stand at the same place in all of its fills, and rays of an eye reach it by the
same way in all of them. So one trace with a fill in all openings serves each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.meshes import paired_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.transport.elements.weights import BESIDES

ELSEWHERE = -2
"""In place of an element: an opening without the fill of a trace."""
NO_OPENING = -1
"""In place of an opening: none."""
NEAR = 2e-4
"""Distance within which a surface stands in an opening, over its distance and 1 m [–]."""
MOST_IN_LINE = 4
"""Largest number of openings that are noted between two surfaces."""


@dataclass(frozen=True, eq=False)
class SeenOpenings:
    """Panes of the openings of a case."""

    quads: np.ndarray
    """Corners of the panes [m], shape (quad, 4, 3)."""
    opening: np.ndarray
    """Opening of every pane, int, shape (quad,)."""
    starts: tuple[int, ...]
    """First element of every opening, and last the number of all."""

    @classmethod
    def of(cls, panes: Sequence[GroupedPanes], starts: tuple[int, ...]) -> SeenOpenings:
        """Openings of grouped panes; `starts` are those of their `GroupStates`."""
        counts = [len(each.quads) for each in panes]
        opening = np.repeat([each.group for each in panes], counts)
        return cls(np.concatenate([each.quads for each in panes]), opening, starts)

    @property
    def fills(self) -> np.ndarray:
        """Number of fills of every opening, int, shape (opening,)."""
        return np.diff(self.starts)

    def elements(self, fill: int) -> np.ndarray:
        """Element of every opening in the trace of a fill, and last `BESIDES`, (opening + 1,).

        It is `ELSEWHERE` where the opening has fewer fills.
        """
        first = np.array(self.starts[:-1], int)
        return np.append(np.where(fill < self.fills, first + fill, ELSEWHERE), BESIDES)

    @cached_property
    def _scene(self) -> Any:
        return mitsuba_scene({"panes": paired_mesh("panes", self.quads)})

    @cached_property
    def _of_quad(self) -> mi.UInt32:
        return flat_indices(self.opening)

    def first(self, p: np.ndarray, d: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Opening that rays meet first within some distances, `NO_OPENING` for none, int, (ray,).

        Parameters
        ----------
        p, d : np.ndarray, shape (ray, 3)
            Origins [m] and unit vectors.
        most : np.ndarray, shape (ray,)
            Distances [m], infinite for rays that meet no surface.
        """
        return self._met(p, d, most)[0]

    def both(
        self, p: np.ndarray, d: np.ndarray, most: np.ndarray, before: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """First opening of rays that met `before` (ray,), and whether they meet another now.

        Arguments are as for `first`; `before` may be `NO_OPENING`.
        """
        opening, again = before.copy(), np.zeros(len(p), bool)
        some, start = np.arange(len(p)), np.zeros(len(p))
        for _ in range(MOST_IN_LINE):
            met, far = self._met(p[some] + start[some, None] * d[some], d[some],
                                 most[some] - start[some])  # fmt: skip
            here = met != NO_OPENING
            some, met, far = some[here], met[here], far[here]
            if not len(some):
                break
            fresh = opening[some] == NO_OPENING
            again[some[~fresh & (opening[some] != met)]] = True
            opening[some[fresh]] = met[fresh]
            start[some] += far + NEAR * (1 + far)
        return opening, again

    def _met(self, p: np.ndarray, d: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First opening within some distances, and its distance [m]."""
        if not len(p):
            return np.zeros(0, int), np.zeros(0)
        origin = mi.Point3f(*(flat(p[:, k]) for k in range(3)))
        ray = mi.Ray3f(origin, mi.Vector3f(*(flat(d[:, k]) for k in range(3))))
        met = self._scene.ray_intersect_preliminary(ray, coherent=False)
        t = met.t.numpy().astype(float)
        within = met.is_valid().numpy() & (t <= most + NEAR * (1 + most))
        quad = dr.gather(mi.UInt32, self._of_quad, met.prim_index // 2, met.is_valid())
        return np.where(within, quad.numpy().astype(int), NO_OPENING), t
