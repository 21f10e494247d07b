"""Rays of the eye by element: they are followed with each fill in all openings.

Ends beyond an opening count in the trace of each fill that it has, those beside all openings in the
first trace alone. Parts of scenes and entries of glow tables are counted on from fill to fill.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.eye.ends import Ends, EyeEnds, joined, taken
from drcmitsuba.eye.openings import NO_OPENING
from drcmitsuba.eye.paths import EyePaths
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.glow import GlowTable
from drcmitsuba.runtime.flat_arrays import flat_indices

NO_ELEMENT = 0xFFFFFFFF
"""In place of the number of an element: an opening without the fill of a trace."""


class SeenPanes(NamedTuple):
    """Rays that meet scattering panes."""

    ray: mi.UInt32
    at: mi.UInt32
    """Entry among those of the glow tables of all fills."""
    weight: mi.Float
    element: mi.UInt32

    @classmethod
    def none(cls) -> SeenPanes:
        """No rays."""
        return cls(mi.UInt32(), mi.UInt32(), mi.Float(), mi.UInt32())


class ShownSurfaces(NamedTuple):
    """Surfaces that rays of the eye show."""

    ray: mi.UInt32
    p: mi.Vector3f
    n: mi.Vector3f
    weight: mi.Float
    """Weight of E/π."""
    met: mi.UInt32
    """Bits of `OnWay`."""
    element: mi.UInt32


class SeenByElement(NamedTuple):
    """Ends of rays of the eye, with the number of the element of each, see `pixel_paths`."""

    outside: Ends
    of_outside: mi.UInt32
    rough: Ends
    """Rough mirrors."""
    of_rough: mi.UInt32
    panes: SeenPanes
    surfaces: ShownSurfaces


class EyeByElement:
    """Follows rays of the eye with each fill in all openings."""

    def __init__(self, scenes: FacadeScenes, glows: Sequence[GlowTable], diameter: float) -> None:
        self.scenes, self.glows = scenes, glows
        self.eyes = [EyePaths.of(world, diameter, scenes.openings) for world in scenes.fills]
        self.rays, self.beyond = 0, 0.0

    @property
    def again(self) -> float:
        """Sum of the weights of what rays have shown beyond two openings, over their number [–]."""
        return self.beyond / max(1, self.rays)

    def seen(
        self, p: mi.Point3f, d: mi.Vector3f, lane: mi.UInt32, samples: int, seed: int
    ) -> SeenByElement:
        """Follow rays, whose arguments are those of `EyePaths.ends`."""
        self.rays += dr.width(lane)
        ends = [eye.ends(p, d, lane, samples, seed) for eye in self.eyes]
        outside, rough = self._outside(ends), self._rough(ends)
        return SeenByElement(*outside, *rough, self._panes(ends), self._shown(ends))

    def _counted(self, ends: Ends, fill: int) -> tuple[Ends, mi.UInt32]:
        """Ends that count in the trace of a fill, and their elements."""
        openings = self.scenes.openings
        if openings is None or not dr.width(ends.ray):
            return ends, mi.UInt32()
        numbers = openings.elements(fill) + 1
        numbers[-1] = 0 if fill == 0 else NO_ELEMENT  # seen by none: in the first trace alone
        table = flat_indices(np.where(numbers < 0, NO_ELEMENT, numbers))
        last = dr.opaque(mi.UInt32, len(numbers) - 1)
        at = dr.select(ends.opening == NO_OPENING, last, mi.UInt32(ends.opening))
        element = dr.gather(mi.UInt32, table, at)
        some = dr.compress(element != NO_ELEMENT)
        counted = taken(ends, some)
        if dr.width(some):
            self.beyond += float(dr.sum(dr.select(counted.again, counted.weight, 0))[0])
        return counted, dr.gather(mi.UInt32, element, some)

    def _every(self, ends: Sequence[Ends]) -> tuple[list[Ends], mi.UInt32]:
        """Ends of each fill that count, and the elements of all."""
        pairs = [self._counted(each, fill) for fill, each in enumerate(ends)]
        return [own for own, _ in pairs], concat([element for _, element in pairs])

    def _outside(self, ends: Sequence[EyeEnds]) -> tuple[Ends, mi.UInt32]:
        every, elements = self._every([each.outside for each in ends])
        return _joined(every), elements

    def _rough(self, ends: Sequence[EyeEnds]) -> tuple[Ends, mi.UInt32]:
        """Rough mirrors, whose parts are counted on from scene to scene."""
        every, elements = self._every([each.rough for each in ends])
        first = np.cumsum([0, *(len(world.parts) for world in self.scenes.fills)])
        every = [
            own._replace(part=counted_on(own.part, int(start)))
            for own, start in zip(every, first, strict=False)
        ]
        return _joined(every), elements

    def _panes(self, ends: Sequence[EyeEnds]) -> SeenPanes:
        """Rays that meet panes, their entries among those of all tables, weights, and elements."""
        every, elements = self._every([each.panes for each in ends])
        rays, at, weight, first = [], [], [], 0
        for own, glow in zip(every, self.glows, strict=True):
            if dr.width(own.ray):
                entry, value = glow.seen(own.p, own.d, own.weight)
                rays.append(own.ray)
                at.append(counted_on(entry, first))
                weight.append(value)
            first += len(glow)
        if not rays:
            return SeenPanes.none()
        return SeenPanes(concat(rays), concat(at), concat(weight), elements)

    def _shown(self, ends: Sequence[EyeEnds]) -> ShownSurfaces:
        """Surfaces that rays show."""
        every, elements = self._every([each.surfaces for each in ends])
        weight = [
            own.weight * eye.reflected(own) if dr.width(own.ray) else own.weight
            for own, eye in zip(every, self.eyes, strict=True)
        ]
        whole = _joined(every)
        shown = ShownSurfaces(
            whole.ray, mi.Vector3f(whole.front), mi.Vector3f(whole.n), concat(weight), whole.met,
            elements,
        )  # fmt: skip
        dr.eval(*shown)
        return shown


def counted_on(numbers: mi.UInt32, first: int) -> mi.UInt32:
    """Numbers that count from `first` on."""
    return numbers + dr.opaque(mi.UInt32, first) if first and dr.width(numbers) else numbers


def concat(arrays: Sequence[Any]) -> Any:
    """Arrays one after another, of which some may be empty."""
    some = [array for array in arrays if dr.width(array)] or [arrays[0]]
    return some[0] if len(some) == 1 else dr.concat(some)


def _joined(every: Sequence[Ends]) -> Ends:
    """Ends of all fills, one after another."""
    return joined([ends for ends in every if dr.width(ends.ray)] or [every[0]])
