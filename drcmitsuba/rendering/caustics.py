"""Light that components throw on surfaces: photons, counted on small cells of these surfaces.

The irradiance of a surface by photons is that of the cell in which it lies; cells for the light of
a sun are smaller than those for the sky's. The picture blurs patterns of light by their size. What
planar mirrors and rough ones send there of the sun has exact directions, which `hour` looks for; of
the sky photons count it as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.rendering.surface_light import HourSources
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.photons.light import Landed
from drcmitsuba.transport.photons.tracer import PhotonTracer

SKY_CELL, SUN_CELL = 0.15, 0.06
"""Edges of the cells for photons of the sky and of a sun [m]."""
SUN_PHOTONS = 32
"""Photons of the one sun of a picture, over `accuracy.photons` of each sun of a year."""


@dataclass(frozen=True)
class Caustics:
    """Photons of a scene with components."""

    of_sky: tuple[Landed, ...]
    """Photons of the sky in every replicate."""
    sun: PhotonTracer | None
    """Tracer of a sun's photons; None where all of its light has exact directions."""
    accuracy: Accuracy

    @classmethod
    def of(
        cls, scene: Scene, accuracy: Accuracy, subdivision: int | None, diameter: float
    ) -> Caustics | None:
        """Trace the photons of the sky; None for a scene without components."""
        none = np.zeros((0, 3))

        def tracer(size: float, photons: int, subdivision: int | None) -> PhotonTracer | None:
            size = min(size, accuracy.cell_size)
            finer = accuracy.model_copy(update={"cell_size": size, "photons": photons})
            imaged = subdivision is not None
            return PhotonTracer.of(
                scene, none, none, none, diameter, subdivision, finer, imaged=imaged
            )

        sky = tracer(SKY_CELL, accuracy.photons, subdivision)
        sun = tracer(SUN_CELL, SUN_PHOTONS * accuracy.photons, None)
        if sky is None:
            return None
        seeds = [launch_seed(accuracy.seed, Stream.PHOTONS, r) for r in range(accuracy.replicates)]
        return cls(tuple(sky.traced(seed + 1) for seed in seeds), sun, accuracy)

    def by_bin(self) -> CausticMap:
        """Map of the irradiance per luminance of each bin of the sky [sr]."""
        parts = [one.cells[0].array for one in self.of_sky]
        return CausticMap(self.of_sky[0], dr.concat(parts))

    def under(self, sources: HourSources) -> tuple[CausticMap, ...]:
        """Maps of the irradiance [lx] under the sources, which may have no sun."""
        maps = [_map(self.of_sky, 0, sources.sky)]
        if sources.sun > 0 and self.sun is not None:
            tracer = replace(self.sun, suns=sources.direction[None])
            seeds = (
                launch_seed(self.accuracy.seed, Stream.PHOTONS, r)
                for r in range(self.accuracy.replicates)
            )
            maps.append(_map([tracer.traced(s + 2) for s in seeds], 1, np.array([sources.sun])))
        return tuple(maps)


@dataclass(frozen=True)
class CausticMap:
    """Irradiance on the cells of all surfaces."""

    landed: Landed
    """Photons of one replicate, whose cells are those of all."""
    E: mi.Float
    """Irradiance [lx], flat (replicate, cell); or (replicate, cell, bin), see `Caustics.by_bin`."""

    def on(self, p: mi.Point3f, n: mi.Normal3f, replicate: mi.UInt32) -> mi.Float:
        """Irradiance of points of surfaces in their replicates [lx]."""
        at, known = self.cells(p, n, replicate)
        return dr.gather(mi.Float, self.E, at, known)

    def cells(
        self, p: mi.Point3f, n: mi.Normal3f, replicate: mi.UInt32
    ) -> tuple[mi.UInt32, mi.Bool]:
        """Entries (replicate, cell) of points of surfaces, and whether photons fell there."""
        areas = self.landed.areas
        row, known = areas.at(areas.grid.key(p, n))
        at = replicate * dr.opaque(mi.UInt32, len(areas)) + row
        return dr.select(known, at, 0), known


def _map(landed: list[Landed] | tuple[Landed, ...], kind: int, L: np.ndarray) -> CausticMap:
    """Map of the photons of the sky (0) or of suns (1) of luminances L (bin,)."""
    column, parts = mi.TensorXf(flat(L), (len(L), 1)), []
    for one in landed:
        D = one.cells[kind]
        parts.append((D @ column).array if D.shape[1] else dr.zeros(mi.Float, D.shape[0]))
    E = dr.concat(parts)
    dr.eval(E)
    return CausticMap(landed[0], E)
