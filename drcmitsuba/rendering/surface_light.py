r"""Light on the surfaces of a scene: irradiance of the cells by all ways, hour by hour.

Every replicate has points of its own that stand for the cells. Before any diffuse reflection, the
irradiance of a cell is

.. math:: E_{0,r} = D_{r,\mathrm{sky}} L_\mathrm{sky} + D_{r,\mathrm{sun}} L_\mathrm{sun},

and E = E₀ + T·E where light between cells is solved, E = E₀ where paths follow all bounces. The
sky's D is computed once; the sun's for the exact sun of an hour.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.rendering.view_glow import ViewGlow
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.films.peaks import Peaks
from drcmitsuba.transport.interreflection.solved_cells import Transfer
from drcmitsuba.transport.light.irradiance import under
from drcmitsuba.transport.photons.tracer import PhotonTracer
from drcmitsuba.transport.replicate import Replicates


@dataclass(frozen=True)
class HourSources:
    """Light of an hour."""

    sky: np.ndarray
    """Luminances of ground and sky patches [cd/m²], shape (bin,)."""
    sun: float
    """Luminance of the sun [cd/m²]; 0 without a sun that lights the scene."""
    direction: np.ndarray
    """Unit vector to the sun, shape (3,)."""


@dataclass(frozen=True)
class Glowing:
    """Panes that scatter, as they glow at an instant."""

    whole: mi.Float
    """Radiance of the panes' entries as the eye sees it [cd/m²], flat (replicate, entry)."""
    rest: mi.Float
    """The same for surfaces that look at panes, without the sun in the narrow peaks of films."""
    peaks: tuple[Peaks, ...]
    """Narrow peaks of films, which surfaces look for along their directions."""


@dataclass(frozen=True)
class SurfaceLight:
    """Cells of a scene, and the light of the sky on them."""

    base: Deposit
    """Deposit by the sky alone, before `lit`."""
    keys: mi.UInt32
    """Key of every cell."""
    drawn: CellPoints
    """Points that stand for the cells in every replicate."""
    transfer: Transfer | None
    """Light between cells; None where paths follow all bounces."""
    sky: Replicates | None
    """The sky's light in all replicates, before any diffuse reflection; None before it is
    computed."""
    photons: PhotonTracer | None = None
    """Photons to the cells; None without components."""

    @classmethod
    def of(
        cls, base: Deposit, keys: mi.UInt32, drawn: CellPoints, transfer: Transfer | None
    ) -> SurfaceLight:
        """Compute the light of the sky."""
        none, followed = np.zeros((0, 3)), base.scene.followed and dr.width(keys) > 0
        photons = None
        if followed:
            photons = PhotonTracer.of(
                base.scene, none, none, none, base.diameter, base.subdivision, base.accuracy
            )
        light = cls(base, keys, drawn, transfer, None, photons)
        return replace(light, sky=light._lit(base))

    @property
    def cells(self) -> int:
        """Number of cells."""
        return dr.width(self.keys)

    @property
    def deposits(self) -> tuple[Deposit, ...]:
        """The sky's light on the panes in every replicate."""
        return () if self.sky is None else self.sky.deposits

    def _lit(self, base: Deposit) -> Replicates:
        """Light on the cells and panes in every replicate."""
        numbers = range(base.accuracy.replicates)
        every = Replicates(numbers, tuple(map(base.lit, numbers)))
        if self.cells:
            if self.photons is not None:
                suns, subdivision = base.suns, base.subdivision
                tracer = replace(self.photons, suns=suns, subdivision=subdivision)
                seeds = (launch_seed(base.accuracy.seed, Stream.PHOTONS, r) for r in numbers)
                every.landed = tuple(map(tracer.traced, seeds))
            every.meet(self.drawn, self.keys)
            every.join()
        return every

    def under(self, sun: np.ndarray) -> Replicates:
        """Light of one sun, a unit vector (3,), in all replicates."""
        suns, base = sun[None], self.base
        films = None if base.films is None else base.films.with_suns(suns, base.diameter)
        return self._lit(replace(base, suns=suns, subdivision=None, films=films))

    def irradiance(self, sources: HourSources, by_sun: Replicates | None) -> mi.Float:
        """Irradiance of the cells [lx], flat (replicate, cell)."""
        if self.sky is None or not self.cells:
            return mi.Float(0)
        assert self.sky.cells is not None
        E = under(self.sky.cells.sky, sources.sky)
        if by_sun is not None:
            assert by_sun.cells is not None
            E += under(by_sun.cells.sun, np.array([sources.sun]))
        return self.reflected(E).array

    def reflected(self, direct: mi.TensorXf) -> mi.TensorXf:
        """Irradiance with the light that cells have reflected, shape (replicate · cell, bin).

        `direct` is that before any diffuse reflection.
        """
        if self.transfer is None:
            return direct
        return direct + self.transfer.indirect(range(self.base.accuracy.replicates), direct)

    def glow(self, glow: ViewGlow, sources: HourSources, by_sun: Replicates | None) -> Glowing:
        """Panes as they glow under the sources."""
        if not len(glow.table):
            none = dr.zeros(mi.Float, max(1, len(self.deposits) * len(glow)))
            return Glowing(none, none, ())
        table, whole, rest, peaks = glow.table, [], [], tuple[Peaks, ...]()
        for r, deposit in enumerate(self.deposits):
            L = table.radiance(deposit, sources.sky, 0, mi.Float())
            whole.append(L)
            rest.append(L)
            if by_sun is not None:
                lit, none = by_sun.deposits[r], np.zeros(0)
                seed = launch_seed(self.base.accuracy.seed, Stream.EYE_PANES) + 2 + r
                answer = table.answer(lit, seed)
                left, peaks = table.split(answer)
                whole[-1] = L + table.radiance(lit, none, sources.sun, answer)
                rest[-1] = L + table.radiance(lit, none, sources.sun, left)
        return Glowing(glow.of_eye(dr.concat(whole)), glow.of_surfaces(dr.concat(rest)), peaks)
