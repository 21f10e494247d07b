"""Deposit by photons: light that comes by mirrors, prisms, pipes, or by several panes in turn.

Photons start on the ports of components, from every sun, the sky and the ground, know their bin and
are deposited in the cell of the first diffuse surface that they meet; nothing else is stored.
Squares around the sensors record what crosses them. Per unit radiance of bin b,

    D[cell, b] = Σ flux of the photons of b that land in it / area of the cell.

Every path of light is counted once. A photon counts where its chain is one that no other estimator
knows: it begins with a deviation (anything but going straight through a pane) by the component of
its own port, and it is not a film followed by diffusing panes, which the pane deposits find. So
straight light, and light that another component deviates first, end without a trace, and two
ports of one component must not lie behind one another.

References
----------
.. [1] R. Schregle, "Development and integration of the Radiance photon map extension", Lucerne
   University of Applied Sciences and Arts, 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.accuracy import Accuracy
from drcmitsuba.scene import Scene
from drcmitsuba.transport.cells import Grid
from drcmitsuba.transport.deposit import launch_seed
from drcmitsuba.transport.photon_paths import Found, Lobes, Recorder, follow
from drcmitsuba.transport.ports import Ports, Start, patch_radii
from drcmitsuba.transport.receivers import CellAreas, Squares

LANES = 1 << 21
"""Photons of one launch."""


@dataclass(frozen=True)
class Ledger:
    """Where the flux of photons went, per unit radiance of all bins [m² sr].

    emitted + roulette = landed + absorbed + escaped + others + lost, to rounding; `roulette` is 0
    in the mean.

    Parameters
    ----------
    emitted : float
        What passed the ports.
    landed : float
        On diffuse surfaces.
    absorbed : float
        By mirrors, panes and solids.
    escaped : float
        To the outside.
    others : float
        On chains that other estimators, or other ports, count.
    lost : float
        Still under way after the last surface that was followed.
    roulette : float
        Added to photons that survived, less what was taken with those that did not.
    photons, segments : int
        Photons that were followed, and the flights from surface to surface that they made.
    """

    emitted: float = 0.0
    landed: float = 0.0
    absorbed: float = 0.0
    escaped: float = 0.0
    others: float = 0.0
    lost: float = 0.0
    roulette: float = 0.0
    photons: int = 0
    segments: int = 0

    def plus(self, other: Ledger) -> Ledger:
        """Sum with another one."""
        names = (f.name for f in fields(self))
        return replace(self, **{n: getattr(self, n) + getattr(other, n) for n in names})

    @property
    def share_lost(self) -> float:
        """Part of the emitted flux that was given up."""
        return self.lost / self.emitted if self.emitted else 0.0


@dataclass(frozen=True)
class Landed:
    """D of photons [sr].

    Parameters
    ----------
    areas : CellAreas
    sky, sun : mi.TensorXf, shape (row, bin)
        Of the cells, by ground and sky patches and by suns.
    sensors, mirrored : np.ndarray, shape (sensor, bin)
        Of the sensors, by all bins; and the purely mirrored (or refracted) part of it.
    ledger : Ledger
    """

    areas: CellAreas
    sky: mi.TensorXf
    sun: mi.TensorXf
    sensors: np.ndarray
    mirrored: np.ndarray
    ledger: Ledger

    def on(self, key: mi.UInt32) -> tuple[mi.TensorXf, mi.TensorXf]:
        """D of the cells with some keys, by sky and by suns; 0 where nothing can land."""
        row, known = self.areas.at(key)
        out = []
        for d in (self.sky, self.sun):
            cells, bins = dr.width(key), d.shape[1]
            if not cells or not bins:
                out.append(dr.zeros(mi.TensorXf, (cells, bins)))
                continue
            entry = dr.arange(mi.UInt32, cells * bins)
            stride = dr.opaque(mi.UInt32, bins)
            at, there = (dr.gather(type(x), x, entry // stride) for x in (row, known))
            values = dr.gather(mi.Float, d.array, at * stride + entry % stride, there)
            out.append(mi.TensorXf(values, (cells, bins)))
        return out[0], out[1]


class _Sources(NamedTuple):
    """Suns, or ground and sky patches.

    Parameters
    ----------
    bins : int
    seen : np.ndarray of int
        Those that shine on any port.
    start : callable
        Photons of those, see `Ports.from_suns`.
    """

    bins: int
    seen: np.ndarray
    start: Callable[..., Start]


@dataclass(frozen=True)
class Photons:
    """Photons of a scene.

    Parameters
    ----------
    ports : Ports
    areas : CellAreas
    squares : Squares
    suns : np.ndarray, shape (sun, 3)
    diameter : float
        Angle across a sun [deg].
    subdivision : int or None
        Reinhart's factor MF of the sky; None leaves out ground and sky.
    count : int
        Photons of a sun in one replicate; the sky has as many for each patch.
    surfaces : int
        Followed at most.
    """

    ports: Ports
    areas: CellAreas
    squares: Squares
    suns: np.ndarray
    diameter: float
    subdivision: int | None
    count: int
    surfaces: int

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, suns: np.ndarray,
        diameter: float, subdivision: int | None, accuracy: Accuracy,
    ) -> Photons | None:  # fmt: skip
        """Photons for sensors at points and for all cells; None where there are no ports."""
        if not scene.ports:
            return None
        grid = Grid.of(scene, accuracy.cell_size)
        return cls(
            Ports.of(scene), CellAreas.of(scene, grid, launch_seed(accuracy, 5)),
            Squares.of(scene, points, normals, accuracy.sensor_square), suns, diameter,
            subdivision, accuracy.photons, accuracy.photon_surfaces,
        )  # fmt: skip

    def traced(self, seed: int, progress: Callable[[float], None] = lambda share: None) -> Landed:
        """Trace all photons of a replicate.

        Parameters
        ----------
        seed : int
        progress : callable
            Told the share that is done.
        """
        kinds = self._sky(), self._suns()
        everything = max(1, sum(len(kind.seen) for kind in kinds) * self.count)
        count, done, ledger = len(self.squares.edge), 0, Ledger()
        on_cells, through = [], []
        for kind in kinds:
            n = len(kind.seen)
            sizes = len(self.areas), count, count
            found = Found(*(dr.zeros(mi.Float, size * n) for size in sizes))
            for first in range(0, n * self.count, LANES):
                lanes = min(LANES, n * self.count - first)
                start = kind.start(self.count, first, lanes, seed)
                ledger = ledger.plus(self._follow(start, found, n, seed ^ (first + 1)))
                done += lanes
                progress(done / everything)
            on_cells.append(self._per_area(found.cells, kind))
            through.append(np.zeros((2, count, kind.bins), np.float32))
            flux = np.reshape([found.sensors.numpy(), found.mirrored.numpy()], (2, count, n))
            through[-1][:, :, kind.seen] = flux / self.squares.edge[:, None] ** 2
        sky, sun = on_cells
        sensors, mirrored = np.concatenate(through, axis=2)
        return Landed(self.areas, sky, sun, sensors, mirrored, ledger)

    def _suns(self) -> _Sources:
        could = self.ports.could(self.suns, np.full(len(self.suns), np.radians(self.diameter) / 2))
        seen = np.flatnonzero(could.any(axis=1))
        suns = self.suns[seen]
        return _Sources(
            len(self.suns), seen, lambda *launch: self.ports.from_suns(suns, self.diameter, *launch)
        )

    def _sky(self) -> _Sources:
        patches = Patches(self.subdivision or 1)
        could = self.ports.could(patches.directions, patch_radii(patches))
        bins = len(patches) if self.subdivision else 0
        seen = np.flatnonzero(could[:bins].any(axis=1))
        return _Sources(bins, seen, lambda *launch: self.ports.from_sky(patches, seen, *launch))

    def _per_area(self, flux: mi.Float, kind: _Sources) -> mi.TensorXf:
        """D of the cells from the flux of the bins that were seen."""
        rows, n = len(self.areas), len(kind.seen)
        out = dr.zeros(mi.Float, rows * kind.bins)
        if rows and n:
            entry, count = dr.arange(mi.UInt32, rows * n), dr.opaque(mi.UInt32, n)
            row = entry // count
            column = dr.gather(mi.UInt32, mi.UInt32(kind.seen.astype(np.uint32)), entry % count)
            D = flux / dr.gather(mi.Float, self.areas.area, row)
            dr.scatter(out, D, row * dr.opaque(mi.UInt32, kind.bins) + column)
            dr.eval(out)
        return mi.TensorXf(out, (rows, kind.bins))

    def _follow(self, start: Start, found: Found, bins: int, seed: int) -> Ledger:
        """Follow photons and add what they bring to `found`."""
        dr.eval(start.p, start.d, start.flux, start.bin, start.component)
        lanes = dr.compress(start.flux > 0)
        if dr.width(lanes) == 0:
            return Ledger()
        mine = Start(*(dr.gather(type(x), x, lanes) for x in _columns(start)))
        # Mitsuba's sampler is three times slower in a loop than the generator behind it.
        random = mi.PCG32(dr.width(lanes), dr.opaque(mi.UInt64, seed), mi.UInt64(lanes))
        fates = follow(
            self.ports.scene.full, Lobes.of(self.ports), self.areas, Recorder(self.squares), mine,
            found, dr.opaque(mi.UInt32, bins), dr.opaque(mi.UInt32, self.surfaces), random,
        )  # fmt: skip
        dr.eval(fates, found)  # together: each sum alone would follow all photons again
        sums = [dr.sum(mi.Float64(x)) for x in (mine.flux, *fates)]
        *fluxes, segments = (float(s[0]) for s in sums)
        names = ("emitted", "landed", "absorbed", "escaped", "others", "lost", "roulette")
        told = dict(zip(names, fluxes, strict=True))
        return Ledger(photons=dr.width(lanes), segments=round(segments), **told)


def _columns(start: Start) -> tuple:
    return start.p, start.d, start.flux, start.bin, start.component
