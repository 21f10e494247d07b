"""Paths that the states of a façade share.

States differ by the materials of panes: until a photon meets a pane of the room, all go one way.
With D₀ the light of photons that have met no pane yet, and D₁ that of the others, D = D₀ + D₁. A
further state takes D₀ from the first one, for its bins, and follows those photons alone that met a
pane there. Random numbers are those of a state alone, so no result depends on what is shared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import drjit as dr
import numpy as np

from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.transport.interreflection.interior import SharedInterior
from drcmitsuba.transport.photons.changing_panes import ChangingPanes
from drcmitsuba.transport.photons.light import CommonLight, Landed
from drcmitsuba.transport.photons.tracer import PhotonTracer

KEPT = 1 << 29
"""Largest size of the light that is kept for further states, and of its sums [bytes]."""


class _First(NamedTuple):
    """Photons of the first of some states."""

    tracer: PhotonTracer
    seeds: tuple[int, ...]
    common: tuple[tuple[CommonLight, CommonLight], ...]
    """Light of each replicate until photons met a pane, by the sky and by suns."""


@dataclass
class SharedPhotons:
    """The latest photons that were all followed."""

    _first: _First | None = None

    def traced(
        self, tracer: PhotonTracer, seeds: Sequence[int], progress: Progress = lambda share: None
    ) -> list[Landed]:
        """Trace the photons of replicates with these seeds, as `PhotonTracer.traced`."""
        ends = [part(progress, r / len(seeds), (r + 1) / len(seeds)) for r in range(len(seeds))]
        first, suns = self._first, None
        if first is not None and first.seeds == tuple(seeds):
            suns = _suns_among(tracer, first.tracer)
        if first is None or suns is None or not _differ_by_panes(tracer, first.tracer):
            self.forget()
            return self._all(tracer, seeds, ends)
        few = replace(tracer, panes=first.tracer.panes)
        return [
            few.traced(seed, end, (sky, sun.of_bins(suns)))
            for seed, end, (sky, sun) in zip(seeds, ends, first.common, strict=True)
        ]

    def _all(
        self, tracer: PhotonTracer, seeds: Sequence[int], ends: Sequence[Progress]
    ) -> list[Landed]:
        """Follow all photons, and keep what other states share."""
        world = tracer.ports[0].scene
        numbered = tracer.most_photons < 1 << 32  # in 32 bits
        # Colours follow one another in each state: none would find its own photons.
        if tracer.nbytes <= KEPT and numbered and world.channel < 0:
            tracer = replace(tracer, panes=ChangingPanes.of(world))
        landed, common = list[Landed](), list[tuple[CommonLight, CommonLight]]()
        for seed, end in zip(seeds, ends, strict=True):
            one = tracer.traced(seed, end)
            landed.append(replace(one, common=None))
            if one.common is not None:
                common.append(one.common)
            if sum(kind.nbytes for both in common for kind in both) > KEPT:
                tracer, common = replace(tracer, panes=None), []
        if len(common) == len(landed):
            self._first = _First(tracer, tuple(seeds), tuple(common))
        return landed

    def forget(self) -> None:
        """Give back the memory."""
        self._first = None


def _suns_among(tracer: PhotonTracer, first: PhotonTracer) -> np.ndarray | None:
    """Indices of the suns of a tracer among those of the first; None where it lacks one.

    Equal suns have a bin each, which would all be one.
    """
    place = {sun.tobytes(): i for i, sun in enumerate(first.suns)}
    at = [place.get(sun.tobytes()) for sun in tracer.suns]
    return None if None in at or len(set(at)) < len(at) else np.array(at, int)


def _differ_by_panes(one: PhotonTracer, other: PhotonTracer) -> bool:
    """Whether two tracers differ by the materials of panes at most, and by their suns."""
    panes, worlds = other.panes, [tracer.ports[0].scene for tracer in (one, other)]
    if panes is None or _samples(one) != _samples(other):
        return False
    if any(dr.width(a) != dr.width(b) for a, b in zip(_areas(one), _areas(other), strict=True)):
        return False
    if not all(dr.all(a == b) for a, b in zip(_areas(one), _areas(other), strict=True)):
        return False
    return panes.alone_differ(*worlds)


def _samples(tracer: PhotonTracer) -> list[object]:
    """Ports, squares and settings of a tracer."""
    world, squares = tracer.ports[0].scene, tracer.squares
    arrays = [squares.centre, squares.edge, *(ports.quads for ports in tracer.ports if ports.name)]
    arrays += [a for plane in squares.planes for a in (plane.origin, plane.axes, plane.sensors)]
    numbers = tracer.diameter, tracer.subdivision, tracer.count, tracer.surfaces, world.channel
    names = [ports.name for ports in tracer.ports if ports.name]
    return [numbers, names, world.effects.to_dict(), *(array.tobytes() for array in arrays)]


def _areas(tracer: PhotonTracer) -> tuple[object, ...]:
    return tracer.areas.row, tracer.areas.area


@dataclass(frozen=True)
class SharedPaths:
    """Paths among the surfaces of a room, and photons: the latest that were all traced."""

    interior: SharedInterior = field(default_factory=SharedInterior)
    photons: SharedPhotons = field(default_factory=SharedPhotons)

    def forget(self) -> None:
        """Give back the memory."""
        self.interior.forget()
        self.photons.forget()
