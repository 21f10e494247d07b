"""Deposit by photons: light that comes by mirrors, prisms, pipes, or by several panes in turn.

Photons of every sun, the sky and the ground start on the ports of components. Each has its bin and
is deposited in the cell of the first diffuse surface that it meets. Squares around the sensors
record the photons that cross them. Per unit radiance of bin b,

    D[cell, b] = Σ flux of the photons of b that land in it / area of the cell.

Every path of light is counted once. A photon counts where no other estimator covers its chain: the
chain begins with a deviation (anything but going straight through a pane) by the component of the
photon's port, and it is not a film followed by diffusing panes, which the pane deposits cover. So
straight light, and light that another component deviates first, does not count; where two ports of
a component lie behind one another, light counts from the first.

References
----------
.. [1] R. Schregle, "Development and integration of the Radiance photon map extension", Lucerne
   University of Applied Sciences and Arts, 2015.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import streams

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.random_streams import Draw, Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells import Grid
from drcmitsuba.transport.deposit import Irradiance
from drcmitsuba.transport.launch_size import PHOTONS
from drcmitsuba.transport.pane_ports import pane_sides
from drcmitsuba.transport.photon_paths import FluxSums, Recorder, Traits, follow
from drcmitsuba.transport.ports import ComponentPorts, PhotonSources, Start, of_sky, of_suns
from drcmitsuba.transport.reached import Reached
from drcmitsuba.transport.receivers import CellAreas, Squares

PATCH = 4
"""Number of photons of a sky patch per photon of a sun: a patch counts in every hour."""


@dataclass(frozen=True)
class FluxLedger:
    """Flux of photons by fate, per unit radiance of all bins [m² sr].

    emitted + roulette = landed + absorbed + escaped + others + lost, to rounding; `roulette` is 0
    in the mean.
    """

    emitted: float = 0.0
    """Flux through the ports."""
    landed: float = 0.0
    """Flux onto diffuse surfaces."""
    absorbed: float = 0.0
    """Flux into mirrors, panes and solids."""
    escaped: float = 0.0
    """Flux to the outside."""
    others: float = 0.0
    """Flux on chains that other estimators, or other ports, count."""
    lost: float = 0.0
    """Flux still on its way after the largest number of surfaces."""
    roulette: float = 0.0
    """Flux added to survivors of the roulette, less the flux of the photons that it ended."""
    photons: int = 0
    segments: int = 0
    """Number of photons, and of their flights from surface to surface."""

    def plus(self, other: FluxLedger) -> FluxLedger:
        """Sum of two ledgers."""
        names = (f.name for f in fields(self))
        return replace(self, **{n: getattr(self, n) + getattr(other, n) for n in names})


@dataclass(frozen=True)
class Landed:
    """D of photons [sr]."""

    areas: CellAreas
    sky: mi.TensorXf
    sun: mi.TensorXf
    """D of the cells, by ground and sky patches and by suns, shape (row, bin) each."""
    sensors: np.ndarray
    mirrored: np.ndarray
    """D of the sensors by all bins, and the purely mirrored (or refracted) part of it, shape
    (sensor, bin) each."""
    smear: np.ndarray
    """Error of D of the sensors by the size of the squares, summed over all suns, shape (sensor,).
    Where D is smooth the error of a square of edge h is c·h²: D of the whole square exceeds D of
    its inner quarter by ¾ c·h²."""
    ledgers: dict[str, FluxLedger]
    """Flux by "NAME sky" and "NAME sun" for each component; the panes have an empty name."""

    def on(self, key: mi.UInt32) -> Irradiance:
        """D of the cells with the given keys; 0 where no photon can land."""
        row, known = self.areas.at(key)

        def of(d: mi.TensorXf) -> mi.TensorXf:
            cells, bins = dr.width(key), d.shape[1]
            if not cells or not bins:
                return dr.zeros(mi.TensorXf, (cells, bins))
            entry, stride = dr.arange(mi.UInt32, cells * bins), dr.opaque(mi.UInt32, bins)
            at, there = (dr.gather(type(x), x, entry // stride) for x in (row, known))
            values = dr.gather(mi.Float, d.array, at * stride + entry % stride, there)
            return mi.TensorXf(values, (cells, bins))

        return Irradiance(of(self.sky), of(self.sun))


@dataclass(frozen=True)
class PhotonTracer:
    """Photons of a scene."""

    ports: tuple[ComponentPorts, ...]
    """Ports of the components, and of the panes."""
    areas: CellAreas
    squares: Squares
    suns: np.ndarray
    """Unit vectors, shape (sun, 3)."""
    diameter: float
    """Angle across a sun [deg]."""
    subdivision: int | None
    """Reinhart's factor MF of the sky; None leaves out ground and sky."""
    count: int
    """Photons of a sun to each component in one replicate; a patch has `PATCH` times as many."""
    surfaces: int
    """Largest number of surfaces on a path."""
    APART: ClassVar[int] = 0x10001
    """Distance between the seeds of the components."""

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, suns: np.ndarray,
        diameter: float, subdivision: int | None, accuracy: Accuracy,
    ) -> PhotonTracer | None:  # fmt: skip
        """Prepare photons for sensors at points and for all cells; None without ports.

        Raises
        ------
        InputError
            No light can reach a component.
        """
        every_port = ComponentPorts.of(scene) if scene.followed else ()
        if not every_port:
            return None
        # Behind a closed shade a component sees nothing straight: its light comes by way of panes.
        for ports in () if pane_sides(scene) else every_port:
            if not ports.sky_share().any():
                got = "neither sky nor ground is seen from its ports"
                remedy = "move it, or its ports, to where light comes from"
                raise InputError("case", f"components.{ports.name}", got, remedy)
        grid = Grid.of(scene, accuracy.cell_size)
        seed = launch_seed(accuracy.seed, Stream.CELL_AREAS)
        reached = None
        if scene.near is not None and len(points) and scene.effects.depth != 0:
            reached = Reached.of(scene, points, normals, grid, seed)
        return cls(
            every_port, CellAreas.of(scene, grid, seed, reached),
            Squares.of(scene, points, normals, accuracy.sensor_square), suns, diameter,
            subdivision, accuracy.photons, accuracy.photon_surfaces,
        )  # fmt: skip

    def traced(self, seed: int, progress: Progress = lambda share: None) -> Landed:
        """Trace all photons of a replicate: D of cells and sensors [sr]."""
        patches = len(Patches(self.subdivision)) if self.subdivision else 0
        effects = self.ports[0].scene.effects
        wanted = np.array([effects.ground, *[effects.sky] * (patches - 1)][:patches])
        by_sky, through_sky, _, a = self._landed(
            of_sky(self.subdivision or 1), Draw.SKY, wanted, PATCH * self.count, seed,
            part(progress, 0, 0.3),
        )  # fmt: skip
        by_sun, through_sun, inner, b = self._landed(
            of_suns(self.suns, self.diameter), Draw.SUN, np.ones(len(self.suns), bool), self.count,
            seed + 1, part(progress, 0.3, 1),
        )  # fmt: skip
        sensors, mirrored = np.concatenate([through_sky, through_sun], axis=2)
        smear = 4 / 3 * (through_sun[0].sum(axis=1) - inner)
        names = (ports.name for ports in self.ports)
        ledgers = {
            f"{name} {kind}": ledger
            for name, *both in zip(names, a, b, strict=True)
            for kind, ledger in zip(("sky", "sun"), both, strict=True)
        }
        return Landed(self.areas, by_sky, by_sun, sensors, mirrored, smear, ledgers)

    def _landed(
        self, sources: PhotonSources, draw: Draw, wanted: np.ndarray, photons: int, seed: int,
        progress: Progress,
    ) -> tuple[mi.TensorXf, np.ndarray, np.ndarray, list[FluxLedger]]:  # fmt: skip
        """D of the cells (row, bin), of the sensors (2: all and mirrored, sensor, bin) and of all
        bins in the inner squares (sensor,), by the `wanted` bins, a mask (bin,); and the ledgers.
        """
        bins = len(wanted)
        rows, n, ledgers = len(self.areas), len(self.squares.edge), []
        # At least one entry: a kernel takes no empty array.
        sizes = (max(1, size) for size in (rows * bins, n * bins, n * bins, n))
        sums = FluxSums(*(dr.zeros(mi.Float64, size) for size in sizes))
        squares = Recorder(self.squares)
        for i, ports in enumerate(self.ports):
            could, traits = ports.could(sources)[:bins], Traits.of(ports)
            could = could * wanted[:, None]
            seen = np.flatnonzero(could.any(axis=1))
            block, ledger = max(1, PHOTONS // photons), FluxLedger()
            for first in range(0, len(seen), block):
                some, key = seen[first : first + block], seed + self.APART * i
                with ports.scene.ray_counter.purpose(Stream.PHOTONS.name, draw.name, ports.name):
                    start = ports.start(sources, some, could[some], photons, key)
                    fate = self._follow(
                        ports, traits, squares, sources, start, sums, bins, photons, key
                    )
                ledger = ledger.plus(fate)
                progress((i + (first + len(some)) / len(seen)) / len(self.ports))
            ledgers.append(ledger)
        flux = np.stack([sums.sensors.numpy(), sums.mirrored.numpy()])
        flux = flux[:, : n * bins].reshape(2, n, bins)
        area = self.squares.edge.astype(np.float32) ** 2
        through, inner = (flux / area[:, None]).astype(np.float32), sums.inner.numpy() / (area / 4)
        if not bins or not rows:
            return dr.zeros(mi.TensorXf, (rows, bins)), through, inner, ledgers
        row = dr.arange(mi.UInt32, rows * bins) // dr.opaque(mi.UInt32, bins)
        D = mi.Float(sums.cells) / dr.gather(mi.Float, self.areas.area, row)
        dr.eval(D)
        return mi.TensorXf(D, (rows, bins)), through, inner, ledgers

    def _follow(
        self, ports: ComponentPorts, traits: Traits, squares: Recorder, sources: PhotonSources,
        start: Start, sums: FluxSums, bins: int, photons: int, seed: int,
    ) -> FluxLedger:  # fmt: skip
        """Follow `photons` photons of each source and add their flux to `sums`."""
        dr.eval(*start)
        lanes = dr.compress(start.flux > 0)
        if dr.width(lanes) == 0:
            return FluxLedger()
        start = Start(*(dr.gather(type(x), x, lanes) for x in start))
        # Mitsuba's sampler is three times slower in a loop than the generator behind it.
        number = dr.gather(mi.UInt32, mi.UInt32(sources.numbers), start.bin)
        random = streams(number, seed, ports.index(lanes, photons))
        self.areas.grid.prepare()
        fates = follow(
            ports.scene.full, traits, self.areas, squares, start, sums,
            dr.opaque(mi.UInt32, bins), dr.opaque(mi.UInt32, self.surfaces), random,
        )  # fmt: skip
        dr.eval(fates, *sums)  # together: each sum alone would follow all photons again
        *fluxes, segments = (float(dr.sum(mi.Float64(x))[0]) for x in (start.flux, *fates))
        self.ports[0].scene.ray_counter.take("photon", round(segments))
        names = ("emitted", "landed", "absorbed", "escaped", "others", "lost", "roulette")
        by_fate = dict(zip(names, fluxes, strict=True))
        return FluxLedger(photons=dr.width(lanes), segments=round(segments), **by_fate)
