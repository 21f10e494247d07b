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
from drcmitsuba_plugins.symbolic import symbolic

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


LEAST_AGAIN = 1e-3
"""Share of what eyes see from which on a note tells of what lies beyond two openings [–]."""


def note_of(again: float) -> tuple[str, ...]:
    """Note on what eyes see beyond two openings, whose weight is a share of all that they see."""
    if again < LEAST_AGAIN:
        return ()
    note = f"up to {100 * again:.1f} % of what an eye sees lies beyond two openings: the second "
    note += "one is seen with its fill of the number that the first one has"
    return (note,)


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

    def first(self, p: mi.Point3f, d: mi.Vector3f, active: mi.Bool | bool = True) -> mi.Int32:
        """Opening that active rays from p along d meet first, `NO_OPENING` for none."""
        ray, far = mi.Ray3f(p, d), mi.Float(dr.inf)
        return _met(self._scene, self._of_quad, ray, far, mi.Bool(active))[0]

    def at(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Opening in whose panes points (point, 3) lie, `NO_OPENING` for none, int, (point,)."""
        p, n = (mi.Vector3f(*map(flat, np.asarray(each).T)) for each in (points, normals))
        near = NEAR * (1 + dr.max(dr.abs(p)))
        ray = mi.Ray3f(mi.Point3f(p - near * n), n)
        return np.asarray(_met(self._scene, self._of_quad, ray, near, mi.Bool(True))[0].numpy())

    @symbolic
    def noted(
        self, ray: mi.Ray3f, most: mi.Float, first: mi.Int32, again: mi.Bool, active: mi.Bool
    ) -> tuple[mi.Int32, mi.Bool]:
        """Opening that rays have met first, and whether they have met another one since.

        Parameters
        ----------
        ray : mi.Ray3f
        most : mi.Float
            Distances to the surfaces that they meet next [m], infinite for none.
        first, again
            What they had met before.
        active : mi.Bool
        """
        first, again, active = mi.Int32(first), mi.Bool(again), mi.Bool(active)
        start, step = mi.Float(0), mi.UInt32(0)
        panes, openings = self._scene, self._of_quad  # made before a loop is recorded
        while dr.hint(active, exclude=[panes, openings, ray, most]):
            onward = mi.Ray3f(ray.o + start * ray.d, ray.d)
            opening, t = _met(panes, openings, onward, most - start, active)
            active &= opening != NO_OPENING
            again |= active & (first != NO_OPENING) & (first != opening)
            first = dr.select(active & (first == NO_OPENING), opening, first)
            start += t + NEAR * (1 + t)
            step += 1
            active &= step < MOST_IN_LINE
        return first, again


def _met(
    panes: mi.Scene, openings: mi.UInt32, ray: mi.Ray3f, most: mi.Float, active: mi.Bool
) -> tuple[mi.Int32, mi.Float]:
    """First opening within some distances, and its distance [m]."""
    met = panes.ray_intersect_preliminary(ray, coherent=False, active=active)
    within = active & met.is_valid() & (met.t <= most + NEAR * (1 + most))
    opening = mi.Int32(dr.gather(mi.UInt32, openings, met.prim_index // 2, within))
    return dr.select(within, opening, NO_OPENING), met.t
