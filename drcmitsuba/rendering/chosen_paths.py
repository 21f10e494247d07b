"""Light paths of a state of the façade, from those by element: a sum, without a ray.

Slots of elements that the state has keep their weight, all others get none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.rendering.facade_scenes import FacadeScenes, looks_of
from drcmitsuba.rendering.pixel_paths import PixelPaths, Sampling
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.elements.marks import share_of


def shares_by_fill(scenes: FacadeScenes, shares: np.ndarray) -> np.ndarray:
    """Share of every fill by the number from 1 of the opening, and of what is in none.

    Parameters
    ----------
    scenes : FacadeScenes
        Scenes with openings.
    shares : np.ndarray, shape (element,)

    Returns
    -------
    np.ndarray, shape (fill, 1 + opening)
        What passes no opening counts with the first fill alone.
    """
    assert scenes.openings is not None
    out = np.zeros((len(scenes.fills), 1 + len(scenes.openings.fills)), np.float32)
    out[0, 0] = 1
    for fill, row in enumerate(out):
        elements = scenes.openings.elements(fill)[:-1]
        row[1:] = np.where(elements >= 0, shares[elements], 0)
    return out


@dataclass(frozen=True, eq=False)
class ChosenPaths:
    """Shares of elements, and the mirrors of all fills in the scene of a state."""

    elements: mi.Float
    """Share of what is beside all openings, 1, and of every element, (1 + element,)."""
    by_fill: np.ndarray
    """As of `shares_by_fill`."""
    scenes: FacadeScenes
    part: mi.UInt32
    """Part of the state's scene by that of the scenes of all fills, one after another."""
    sampling: Sampling

    @classmethod
    def of(
        cls, scenes: FacadeScenes, world: Scene, shares: np.ndarray, sampling: Sampling
    ) -> ChosenPaths:
        """Choose elements by their shares (element,), 0 or 1, which are those of a scene."""
        parts = np.concatenate([_parts_in(fill, world) for fill in scenes.fills])
        return cls(
            flat(np.append(1, shares)), shares_by_fill(scenes, shares), scenes,
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
            pane=paths.pane * share(paths.pane_element),
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
        for k, fill in enumerate(self.scenes.letting_through):
            shares = self.by_fill[fill]
            if shares.any():
                value = dr.gather(mi.Float16, paths.sky, ray + dr.opaque(mi.UInt32, k * rays))
                total += dr.gather(mi.Float, flat(shares), paths.sky_opening) * mi.Float(value)
        return mi.Float16(total)

    def _looks(self, paths: PixelPaths) -> tuple[mi.UInt32, mi.Float16]:
        """Looks at panes of the fills that some opening has: entries and irradiance [sr]."""
        whole = dr.width(paths.weight) * self.sampling.panes
        kept: list[mi.UInt32] = []
        first, used = 0, [bool(shares.any()) for shares in self.by_fill]
        for world, is_used in zip(self.scenes.fills, used, strict=True):
            count = looks_of(world) * whole
            if count and is_used:
                kept.append(dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, first))
            first += count
        if not kept:
            return mi.UInt32(), mi.Float16()
        if sum(map(dr.width, kept)) == dr.width(paths.look):
            return paths.look_at, paths.look
        at = kept[0] if len(kept) == 1 else dr.concat(kept)
        return dr.gather(mi.UInt32, paths.look_at, at), dr.gather(mi.Float16, paths.look, at)


def _parts_in(world: Scene, other: Scene) -> np.ndarray:
    """Part of another scene for each part of a scene, −1 for none, int, shape (part,)."""
    number = {(p.component, p.material, p.closed): i for i, p in enumerate(other.parts)}
    every = (number.get((p.component, p.material, p.closed), -1) for p in world.parts)
    return np.fromiter(every, int, len(world.parts))
