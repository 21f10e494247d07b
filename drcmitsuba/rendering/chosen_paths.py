"""Light paths of a state of the façade, from those by element: a sum, without a ray.

Slots of elements that the state has keep their weight, all others get none. What panes glow with is
looked up in the table of the state's own panes, patch by patch at the same place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.eye.openings import NO_OPENING
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.glow import GlowTable
from drcmitsuba.rendering.pixel_paths import PixelPaths, Sampling
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.elements.marks import share_of


@dataclass(frozen=True, eq=False)
class ChosenPaths:
    """Shares of elements, and what panes and mirrors of all fills are in the scene of a state."""

    elements: mi.Float
    """Share of what is beside all openings, 1, and of every element, (1 + element,)."""
    fills: mi.Float
    """Share of every fill, by the number from 1 of the opening that a ray passes, 0 for none: flat
    (fill, 1 + opening)."""
    openings: int
    used: tuple[int, ...]
    """Fills that any opening has."""
    entry: mi.UInt32
    """Entry of the state's glow table by that of the tables of all fills, one after another."""
    seen: mi.Float
    """1 where there is such an entry, else 0."""
    looked: mi.Float
    """Share with which looks at the entry count."""
    columns: tuple[int, ...]
    """Columns of looks that count."""
    part: mi.UInt32
    """Part of the state's scene by that of the scenes of all fills, one after another."""
    sampling: Sampling

    @classmethod
    def of(
        cls, scenes: FacadeScenes, glows: Sequence[GlowTable], glow: GlowTable,
        shares: np.ndarray, sampling: Sampling,
    ) -> ChosenPaths:  # fmt: skip
        """Choose elements.

        Parameters
        ----------
        scenes : FacadeScenes
            Scenes with openings.
        glows : sequence of GlowTable
            Table of the panes' radiance in the scene of every fill.
        glow : GlowTable
            The same in the scene of the state.
        shares : np.ndarray, shape (element,)
            Share of its opening that each element takes, 0 or 1.
        sampling : Sampling
        """
        openings = scenes.openings
        assert openings is not None
        count, fills = len(openings.fills), range(len(scenes.fills))
        by_fill = np.zeros((len(fills), 1 + count), np.float32)
        by_fill[0, 0] = 1
        looked, columns, first = [], list[int](), 0
        for fill, table in zip(fills, glows, strict=True):
            elements = openings.elements(fill)[:-1]
            known = elements >= 0
            by_fill[fill, 1:][known] = shares[elements[known]]
            of_entries = by_fill[fill, table.opening_of_entries(openings) - NO_OPENING]
            looked.append(of_entries)
            columns += [first + k for k in range(table.columns) if of_entries.any()]
            first += table.columns
        entry = np.concatenate([np.zeros(0, int), *(table.entries_in(glow) for table in glows)])
        parts = np.concatenate([_parts_in(world, glow.scene) for world in scenes.fills])
        return cls(
            flat(np.append(1, shares)), flat(by_fill), count,
            tuple(np.flatnonzero(by_fill.any(axis=1)).tolist()),
            flat_indices(np.maximum(entry, 0)), flat(entry >= 0),
            flat(np.concatenate([np.zeros(0), *looked])), tuple(columns),
            flat_indices(np.maximum(parts, 0)), sampling,
        )  # fmt: skip

    def in_state(self, paths: PixelPaths) -> PixelPaths:
        """Light paths of some pixels in the state."""

        def share(element: mi.UInt32) -> mi.Float:
            return dr.gather(mi.Float, self.elements, element)

        none, look_at, look = mi.UInt32(), *self._looks(paths)
        chosen = replace(
            paths,
            outside=paths.outside * share(paths.outside_element),
            rough=paths.rough * share(paths.rough_element),
            rough_part=dr.gather(mi.UInt32, self.part, paths.rough_part),
            pane=paths.pane * share(paths.pane_element)
            * dr.gather(mi.Float, self.seen, paths.pane_at),
            pane_at=dr.gather(mi.UInt32, self.entry, paths.pane_at),
            weight=paths.weight * share(paths.element),
            gather=self._gathered(paths), sky=self._sky(paths), look_at=look_at, look=look,
            outside_element=none, rough_element=none, pane_element=none, element=none,
            gather_marked=none, gather_mark=none, sky_opening=none,
        )  # fmt: skip
        dr.eval(chosen.arrays())
        return chosen

    def _gathered(self, paths: PixelPaths) -> mi.Float16:
        """Irradiance per irradiance of rays to other surfaces."""
        out = mi.Float16(paths.gather)
        if dr.width(paths.gather_marked):
            value = mi.Float(dr.gather(mi.Float16, out, paths.gather_marked))
            value *= share_of(paths.gather_mark, self.elements)
            dr.scatter(out, mi.Float16(value), paths.gather_marked)
        return out

    def _sky(self, paths: PixelPaths) -> mi.Float16:
        """Irradiance of rays to the sky [sr]."""
        rays = dr.width(paths.sky_bin)
        if not rays:
            return mi.Float16()
        ray, total = dr.arange(mi.UInt32, rays), mi.Float(0)
        for fill in self.used:
            at = paths.sky_opening + dr.opaque(mi.UInt32, fill * (1 + self.openings))
            value = dr.gather(mi.Float16, paths.sky, ray + dr.opaque(mi.UInt32, fill * rays))
            total += dr.gather(mi.Float, self.fills, at) * mi.Float(value)
        return mi.Float16(total)

    def _looks(self, paths: PixelPaths) -> tuple[mi.UInt32, mi.Float16]:
        """Looks at panes: entries and irradiance [sr]."""
        whole = dr.width(paths.weight) * self.sampling.panes
        if not whole or not self.columns:
            return mi.UInt32(), mi.Float16()
        at, look = [], []
        for column in self.columns:
            ray = dr.arange(mi.UInt32, whole) + dr.opaque(mi.UInt32, column * whole)
            entry = dr.gather(mi.UInt32, paths.look_at, ray)
            value = mi.Float(dr.gather(mi.Float16, paths.look, ray))
            look.append(mi.Float16(value * dr.gather(mi.Float, self.looked, entry)))
            at.append(dr.gather(mi.UInt32, self.entry, entry))
        return dr.concat(at), dr.concat(look)


def _parts_in(world: Scene, other: Scene) -> np.ndarray:
    """Part of another scene for each part of a scene, −1 for none, int, shape (part,)."""
    number = {(p.component, p.material, p.closed): i for i, p in enumerate(other.parts)}
    every = (number.get((p.component, p.material, p.closed), -1) for p in world.parts)
    return np.fromiter(every, int, len(world.parts))
