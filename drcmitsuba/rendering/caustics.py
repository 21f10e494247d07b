"""Light that components throw on surfaces: photons, counted on small cells of these surfaces.

The irradiance of a surface by photons is that of the cell in which it lies; cells for the light of
a sun are smaller than those for the sky's. The picture blurs patterns of light by their size. What
planar mirrors and rough ones send there of the sun has exact directions, which `hour` looks for; of
the sky photons count it as well.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.rendering.glow import GlowTable
from drcmitsuba.rendering.pane_light import PaneLight
from drcmitsuba.rendering.surface_light import HourSources, SurfaceLight
from drcmitsuba.rendering.view_glow import ViewGlow
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.light.irradiance import under
from drcmitsuba.transport.photons.light import Landed
from drcmitsuba.transport.photons.tracer import PhotonTracer
from drcmitsuba.transport.replicate import Replicates

SKY_CELL, SUN_CELL = 0.15, 0.06
"""Edges of the cells for photons of the sky and of a sun [m]."""
FURTHER = 1.5
"""Edge of the next cells that are tried, where their maps would be too large."""
MOST_BYTES = 1 << 31
"""Largest size of the maps of all bins and replicates, unless no cell is finer than usual."""
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
    panes: PaneLight | None
    """Diffusing panes on which photons are counted; None without any."""
    _by_sky: list[mi.TensorXf] = field(default_factory=list, init=False, repr=False)
    """Light of the sky on these panes in every replicate, once it was asked for."""

    @classmethod
    def of(
        cls, scene: Scene, accuracy: Accuracy, subdivision: int | None, diameter: float,
        table: GlowTable,
    ) -> Caustics | None:  # fmt: skip
        """Trace the photons of the sky; None for a scene without components.

        Panes of the `table` that scatter evenly count them, too.
        """
        if not scene.followed:
            return None
        none, panes = np.zeros((0, 3)), PaneLight(table)
        squares = panes.squares

        def tracer(size: float, photons: int, subdivision: int | None) -> PhotonTracer | None:
            size = _fitting(scene, size, accuracy.cell_size)
            finer = accuracy.model_copy(update={"cell_size": size, "photons": photons})
            imaged = subdivision is not None
            made = PhotonTracer.of(
                scene, none, none, none, diameter, subdivision, finer, imaged=imaged
            )
            if made is None:
                return None
            size_of_maps = 4 * accuracy.replicates * len(made.areas) * max(1, made.patches)
            if size_of_maps > MOST_BYTES and size < accuracy.cell_size:
                return tracer(FURTHER * size, photons, subdivision)
            return made if squares is None else replace(made, squares=squares)

        sky = tracer(SKY_CELL, accuracy.photons, subdivision)
        sun = tracer(SUN_CELL, SUN_PHOTONS * accuracy.photons, None)
        if sky is None:
            return None
        seeds = [launch_seed(accuracy.seed, Stream.PHOTONS, r) for r in range(accuracy.replicates)]
        of_sky = tuple(sky.traced(seed + 1) for seed in seeds)
        return cls(of_sky, sun, accuracy, None if squares is None else panes)

    def by_bin(self) -> CausticMap:
        """Map of the irradiance per luminance of each bin of the sky [sr]."""
        parts = [one.cells[0].array for one in self.of_sky]
        return CausticMap(self.of_sky[0], dr.concat(parts))

    def of_sun(self, sources: HourSources) -> tuple[Landed, ...]:
        """Trace the photons of the sun in every replicate; none where no sun sends any."""
        if not sources.sun > 0 or self.sun is None:
            return ()
        tracer = replace(self.sun, suns=sources.direction[None])
        seeds = (
            launch_seed(self.accuracy.seed, Stream.PHOTONS, r)
            for r in range(self.accuracy.replicates)
        )
        return tuple(tracer.traced(seed + 2) for seed in seeds)

    def under(self, sources: HourSources, of_sun: tuple[Landed, ...]) -> tuple[CausticMap, ...]:
        """Maps of the irradiance [lx] under the sources, with photons from `of_sun`."""
        by_sky = _map(self.of_sky, 0, sources.sky)
        return (by_sky, _map(of_sun, 1, np.array([sources.sun]))) if of_sun else (by_sky,)

    def glow_by_bin(self, glow: ViewGlow, light: SurfaceLight) -> mi.Float:
        """Radiance of panes by photons per luminance of each bin of the sky [1].

        It is as the eye sees it, flat (replicate, entry, bin), and 0 where no pane counts photons.
        """
        if self.panes is None:
            return mi.Float(0)
        return self.panes.seen(glow, self._sky_on(self.panes, light))

    def glow(
        self, glow: ViewGlow, light: SurfaceLight, sources: HourSources,
        by_sun: Replicates | None, of_sun: tuple[Landed, ...],
    ) -> mi.Float:  # fmt: skip
        """Radiance of panes under the sources [cd/m²], flat (replicate, entry); as `glow_by_bin`.

        `by_sun` is from `SurfaceLight.under`, `of_sun` the sun's photons.
        """
        if self.panes is None:
            return mi.Float(0)
        every = []
        for r, D in enumerate(self._sky_on(self.panes, light)):
            E = under(D, sources.sky)
            if by_sun is not None:
                photons = of_sun[r] if of_sun else None
                by = self.panes.by_sun(photons, by_sun.deposits[r], r)
                E += under(by, np.array([sources.sun]))
            every.append(E)
        return self.panes.seen(glow, every)

    def _sky_on(self, panes: PaneLight, light: SurfaceLight) -> list[mi.TensorXf]:
        """Light of the sky's bins on panes in every replicate, which all hours share."""
        if not self._by_sky:
            lit = enumerate(zip(self.of_sky, light.deposits, strict=True))
            self._by_sky.extend(panes.by_sky(landed, deposit, r) for r, (landed, deposit) in lit)
        return self._by_sky


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


def _fitting(scene: Scene, size: float, most: float) -> float:
    """Edge of cells from `size` on [m], of which a large scene holds few enough."""
    while size < most:
        try:
            CellGrid.of(scene, size)
        except InputError:
            size *= FURTHER
        else:
            return size
    return most


def _map(landed: list[Landed] | tuple[Landed, ...], kind: int, L: np.ndarray) -> CausticMap:
    """Map of the photons of the sky (0) or of suns (1) of luminances L (bin,)."""
    E = dr.concat([under(one.cells[kind], L).array for one in landed])
    dr.eval(E)
    return CausticMap(landed[0], E)
