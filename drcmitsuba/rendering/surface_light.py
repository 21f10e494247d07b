r"""Light on the surfaces of a scene: irradiance of the cells by all ways, hour by hour.

Every replicate has points of its own that stand for the cells. Its irradiance of a cell is

.. math:: E_r = H_{r,\mathrm{sky}} L_\mathrm{sky} + H_{r,\mathrm{sun}} L_\mathrm{sun},

with H = D + T·H where light between cells is solved, and H = D where paths follow all bounces. The
sky's H is computed once; the sun's for the exact sun of an hour.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.rendering.glow import Glow
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cell_points import Drawn
from drcmitsuba.transport.deposit import Deposit, Irradiance
from drcmitsuba.transport.diffusing_panes import PanePatches
from drcmitsuba.transport.film_peaks import Peaks
from drcmitsuba.transport.films import Films
from drcmitsuba.transport.photons import PhotonTracer
from drcmitsuba.transport.replicate import Replicate
from drcmitsuba.transport.solved_cells import Transfer


@dataclass(frozen=True)
class Sources:
    """Light of an hour."""

    sky: np.ndarray
    """Luminances of ground and sky patches [cd/m²], shape (bin,)."""
    sun: float
    """Luminance of the sun [cd/m²]; 0 without a sun that lights the scene."""
    direction: np.ndarray
    """Unit vector to the sun, shape (3,)."""


def base_deposit(
    scene: Scene, accuracy: Accuracy, subdivision: int | None, diameter: float
) -> Deposit:
    """Deposit of a scene by the sky alone."""
    size, none = 2 * accuracy.cell_size, np.zeros((0, 3))
    panes = [panes.quads for panes in scene.scattering]
    patches = PanePatches.of(panes, size) if panes else None
    films = Films.of(scene, size, none, diameter)
    return Deposit(scene, none, diameter, subdivision, accuracy, patches, films)


@dataclass(frozen=True)
class Glowing:
    """Panes that scatter, as they glow at an instant."""

    whole: mi.Float
    """Radiance of the panes' entries [cd/m²], flat (replicate, entry)."""
    rest: mi.Float
    """The same without the sun in the narrow peaks of films."""
    peaks: tuple[Peaks, ...]
    """Narrow peaks of films, which surfaces look for along their directions."""


@dataclass(frozen=True)
class SurfaceLight:
    """Cells of a scene, and the light of the sky on them."""

    base: Deposit
    """Deposit by the sky alone, before `lit`."""
    keys: mi.UInt32
    """Key of every cell."""
    drawn: tuple[Drawn | None, ...]
    """Points that stand for the cells, in every replicate; None where there are no cells."""
    transfer: Transfer | None
    """Light between cells; None where paths follow all bounces."""
    replicates: tuple[Replicate, ...]
    """The sky's light in every replicate."""
    photons: PhotonTracer | None = None
    """Photons to the cells; None without components."""

    @classmethod
    def of(
        cls, base: Deposit, keys: mi.UInt32, drawn: tuple[Drawn | None, ...],
        transfer: Transfer | None,
    ) -> SurfaceLight:  # fmt: skip
        """Compute the light of the sky."""
        none, followed = np.zeros((0, 3)), base.scene.followed and dr.width(keys) > 0
        photons = None
        if followed:
            photons = PhotonTracer.of(
                base.scene, none, none, none, base.diameter, base.subdivision, base.accuracy
            )
        light = cls(base, keys, drawn, transfer, (), photons)
        return replace(light, replicates=tuple(light._lit(base)))

    @property
    def cells(self) -> int:
        """Number of cells."""
        return dr.width(self.keys)

    def _lit(self, base: Deposit) -> list[Replicate]:
        """Light on the cells and panes in every replicate."""
        every = [Replicate(r, base.lit(r)) for r in range(base.accuracy.replicates)]
        for one, drawn in zip(every, self.drawn, strict=True):
            one.transfer = self.transfer
            if drawn is not None:
                if self.photons is not None:
                    seed = launch_seed(base.accuracy.seed, Stream.PHOTONS, one.number)
                    subdivision = base.subdivision
                    tracer = replace(self.photons, suns=base.suns, subdivision=subdivision)
                    one.landed = tracer.traced(seed)
                one.meet(drawn, self.keys)
                one.join()
        return every

    def under(self, sun: np.ndarray) -> list[Replicate]:
        """Light of one sun, a unit vector (3,), in every replicate."""
        suns, base = sun[None], self.base
        films = None if base.films is None else base.films.with_suns(suns, base.diameter)
        base = replace(base, suns=suns, subdivision=None, films=films)
        scattered = films is not None or base.patches is not None or self.photons is not None
        if self.cells and not scattered:
            return self._straight(base)
        return self._lit(base)

    def _straight(self, base: Deposit) -> list[Replicate]:
        """Light that comes straight to the cells: all replicates in one launch."""
        drawn = [one for one in self.drawn if one is not None]
        p, n = dr.concat([one.p for one in drawn]), dr.concat([one.n for one in drawn])
        told = [one.within for one in drawn if one.within is not None]
        numbers = dr.concat(
            [self.keys + mi.UInt32(0x9E3779B1 * r & 0xFFFFFFFF) for r in range(len(drawn))]
        )
        D = base.straight(
            p, n, (Stream.CELLS, 0), base.accuracy.cell_sky_rays, numbers=numbers,
            within=dr.concat(told) if told else None,
        ).sun.array  # fmt: skip
        dr.eval(D)
        lane, every = dr.arange(mi.UInt32, self.cells), []
        none = dr.zeros(mi.TensorXf, (self.cells, 0))
        for r in range(len(drawn)):
            of_cells = dr.gather(mi.Float, D, lane + dr.opaque(mi.UInt32, r * self.cells))
            one = Replicate(r, base, transfer=self.transfer)
            one.cells = Irradiance(none, mi.TensorXf(of_cells, (self.cells, 1)))
            if self.transfer is not None:
                one.indirect = Irradiance(*self.transfer.indirect(r, *one.cells))
            every.append(one)
        return every

    def irradiance(self, sources: Sources, by_sun: list[Replicate]) -> mi.Float:
        """Irradiance of the cells [lx], flat (replicate, cell)."""
        parts = []
        for r, one in enumerate(self.replicates):
            E = _irradiance(one, 0, sources.sky)
            if by_sun:
                E += _irradiance(by_sun[r], 1, np.array([sources.sun]))
            parts.append(E)
        return dr.concat(parts) if self.cells else mi.Float(0)

    def glow(self, glow: Glow, sources: Sources, by_sun: list[Replicate]) -> Glowing:
        """Panes as they glow under the sources."""
        if not len(glow):
            return Glowing(mi.Float(0), mi.Float(0), ())
        whole, rest, peaks = [], [], tuple[Peaks, ...]()
        for r, one in enumerate(self.replicates):
            L = glow.radiance(one.deposit, sources.sky, 0, mi.Float())
            whole.append(L)
            rest.append(L)
            if by_sun:
                lit, none = by_sun[r].deposit, np.zeros(0)
                seed = launch_seed(self.base.accuracy.seed, Stream.EYE_PANES) + 2 + r
                answer = glow.answer(lit, seed)
                left, peaks = glow.split(answer)
                whole[-1] = L + glow.radiance(lit, none, sources.sun, answer)
                rest[-1] = L + glow.radiance(lit, none, sources.sun, left)
        return Glowing(dr.concat(whole), dr.concat(rest), peaks)


def _irradiance(one: Replicate, kind: int, L: np.ndarray) -> mi.Float:
    """E of the cells by a kind of bins (0 the sky's, 1 suns) of luminances L (bin,)."""
    assert one.cells is not None
    column = mi.TensorXf(flat(L), (len(L), 1))
    if one.cells[kind].shape[1] == 0:
        return dr.zeros(mi.Float, one.cells[kind].shape[0])
    E = (one.cells[kind] @ column).array
    if one.transfer is not None and one.indirect is not None:
        E += dr.gather(mi.Float, (one.indirect[kind] @ column).array, one.transfer.blocks.of)
    return E
