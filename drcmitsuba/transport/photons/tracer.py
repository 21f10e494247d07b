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

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import streams

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.runtime.launch_size import PHOTONS
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.random_streams import Draw, Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.photons.changing_panes import ChangingPanes
from drcmitsuba.transport.photons.fluxes import FluxSums
from drcmitsuba.transport.photons.light import CommonLight, FluxLedger, Landed, PhotonLight
from drcmitsuba.transport.photons.pane_ports import pane_sides
from drcmitsuba.transport.photons.paths import Recorder, Traits, follow
from drcmitsuba.transport.photons.ports import (
    ComponentPorts,
    PhotonSources,
    Start,
    of_sky,
    of_suns,
    patch_ratio,
)
from drcmitsuba.transport.photons.reached import ReachedSurfaces
from drcmitsuba.transport.photons.receivers import CellAreas, Squares
from drcmitsuba.transport.photons.starts import PhotonRows, PhotonStarts
from drcmitsuba.transport.photons.surfaces import PhotonScene

SCATTER = 0x51CA77E5
"""Distance between the seeds of photons and of the surfaces that scatter them."""
_NO_PHOTONS = np.zeros((2, 0), np.uint32)
PATCH = 4
"""Number of photons of a patch of Tregenza's sky per photon of a sun: it counts in every hour."""


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
    """Photons of a sun to each component in one replicate."""
    surfaces: int
    """Largest number of surfaces on a path."""
    world: PhotonScene
    """Surfaces that photons meet."""
    imaged: bool = False
    """Whether light by way of planar mirrors, and of rough ones in few planes, counts; it has exact
    directions: see `image_suns` and `sun_lobes`."""
    panes: ChangingPanes | None = None
    """Panes that other states change: light until they are met is kept for these states."""
    APART: ClassVar[int] = 0x10001
    """Distance between the seeds of the components."""

    @classmethod
    def of(
        cls, scene: Scene, points: np.ndarray, normals: np.ndarray, suns: np.ndarray,
        diameter: float, subdivision: int | None, accuracy: Accuracy, *, imaged: bool = False,
    ) -> PhotonTracer | None:  # fmt: skip
        """Prepare photons for sensors at points and for all cells; None without ports.

        Raises
        ------
        InputError
            No light can reach a component.
        """
        every_port = ComponentPorts.of(scene, imaged=imaged) if scene.followed else ()
        if not every_port:
            return None
        # Behind a closed shade a component sees nothing straight: its light comes by way of panes.
        shares = [] if pane_sides(scene, imaged=imaged) else PhotonStarts(every_port).sky_share()
        for ports, share in zip(every_port, shares, strict=False):
            if not share.any():
                got = "neither sky nor ground is seen from its ports"
                remedy = "move it, or its ports, to where light comes from"
                raise InputError("case", f"components.{ports.name}", got, remedy)
        grid = CellGrid.of(scene, accuracy.cell_size)
        seed = launch_seed(accuracy.seed, Stream.CELL_AREAS)
        reached = None
        if scene.near is not None and len(points) and scene.effects.depth != 0:
            reached = ReachedSurfaces.of(scene, points, normals, grid, seed)
        return cls(
            every_port, CellAreas.of(scene, grid, seed, reached),
            Squares.of(scene, points, normals, accuracy.sensor_square), suns, diameter,
            subdivision, accuracy.photons, accuracy.photon_surfaces, PhotonScene.of(scene), imaged,
        )  # fmt: skip

    @property
    def patches(self) -> int:
        """Number of bins of ground and sky."""
        return len(Patches(self.subdivision)) if self.subdivision else 0

    @property
    def nbytes(self) -> int:
        """Size of the sums of one kind of bins, where panes may change [bytes]."""
        rows = len(self.areas) + 3 * len(self.squares.edge)
        return 16 * rows * max(self.patches, len(self.suns))

    @property
    def most_photons(self) -> int:
        """Number of photons of all components by the sky or by suns, whichever are more."""
        sources = len(of_sky(self.subdivision).bins) if self.subdivision else 0
        of_kinds = sources * of_patch(self.count, self.subdivision), len(self.suns) * self.count
        return len(self.ports) * max(of_kinds)

    def traced(
        self, seed: int, progress: Progress = lambda share: None,
        known: tuple[CommonLight, CommonLight] | None = None,
    ) -> Landed:  # fmt: skip
        """Trace all photons of a replicate: D of cells and sensors [sr].

        Where light until they meet a pane is `known`, by the sky and by suns, from another state
        and the same seed, only photons are followed that met one.
        """
        effects, every_sun = self.ports[0].scene.effects, np.ones(len(self.suns), bool)
        ground_and_sky = [effects.ground, *[effects.sky] * (self.patches - 1)]
        wanted = np.array(ground_and_sky[: self.patches], bool)
        sky, suns = of_sky(self.subdivision or 1), of_suns(self.suns, self.diameter)
        by_sky = self._landed(
            _Kind(sky, Draw.SKY, wanted, of_patch(self.count, self.subdivision), seed),
            part(progress, 0, 0.3),
            None if known is None else known[0],
        )  # fmt: skip
        by_sun = self._landed(
            _Kind(suns, Draw.SUN, every_sun, self.count, seed + 1), part(progress, 0.3, 1),
            None if known is None else known[1],
        )  # fmt: skip
        ledgers = {
            f"{ports.name} {name}": FluxLedger.of(by.fates[ports.name])
            for ports in self.ports
            for name, by in (("sky", by_sky), ("sun", by_sun))
        }
        common = None
        if by_sky.common is not None and by_sun.common is not None:
            common = by_sky.common, by_sun.common
        return Landed(self.areas, (by_sky.light, by_sun.light), ledgers, common)

    @cached_property
    def _starts(self) -> list[PhotonStarts]:
        """Ports of all components, whose photons fly together, and those of the panes."""
        kinds = ([p for p in self.ports if bool(p.name) == is_named] for is_named in (True, False))
        return [PhotonStarts(tuple(every), self.panes) for every in kinds if every]

    def _landed(self, kind: _Kind, progress: Progress, known: CommonLight | None) -> _OfKind:
        """Trace the photons of one kind of bins from all ports."""
        bins, halves, count = len(kind.wanted), 1 + (self.panes is not None), len(self.ports)
        areas, edges = self.areas.area, self.squares.edge
        zero = FluxSums.of(len(self.areas), len(edges), bins, count, halves > 1)
        met, first, fates = dict[str, np.ndarray](), 0, list[np.ndarray]()
        squares, sums = Recorder(self.squares), zero
        for starts in self._starts:
            own = len(starts.every)
            ended = part(progress, first / count, (first + own) / count)
            seeds = kind.seed + self.APART * np.arange(first, first + own)
            sums = sums._replace(fates=mi.Float64(zero.fates))
            launches = _Launches(
                kind, starts, seeds, self.world, self.areas, self.surfaces, self.imaged
            )
            by_pane = launches.followed(None if known is None else known.met, squares, sums, ended)
            met |= {name: each for name, each in by_pane.items() if name}
            fates.append(sums.by_fate(count, halves, bins)[:, :own])
            launches.count_photons(fates[-1])
            first += own
        each = np.concatenate(fates, axis=1).swapaxes(0, 1)
        by_name = dict(zip((ports.name for ports in self.ports), each, strict=True))
        light = partial(PhotonLight.of, sums, areas, edges, bins)
        if known is not None:
            every = {name: each[1] + known.fates.get(name, 0) for name, each in by_name.items()}
            return _OfKind(known.light.plus(light(1)), every)
        every = {name: each.sum(axis=0) for name, each in by_name.items()}
        before = light(0)
        if halves == 1:
            return _OfKind(before, every)
        early = {name: by_name[name][0] for name in met}
        common = CommonLight(before, met, early, kind.photons)
        return _OfKind(before.plus(light(1)), every, common)


def of_patch(photons: int, subdivision: int | None) -> int:
    """Number of photons of a sky patch, and of a part of the ground, for so many of a sun."""
    return max(1, PATCH * photons // patch_ratio(subdivision or 1) ** 2)


class _OfKind(NamedTuple):
    """Light of the photons of one kind of bins, and their fates."""

    light: PhotonLight
    fates: dict[str, np.ndarray]
    """`FATES` and `COUNTS` by the name of the ports, shape (fate, bin)."""
    common: CommonLight | None = None
    """Light that other states share, where panes may change."""


@dataclass(frozen=True)
class _Kind:
    """Sky and ground, or suns."""

    sources: PhotonSources
    draw: Draw
    wanted: np.ndarray
    """Whether each bin sends photons, shape (bin,)."""
    photons: int
    """Number of photons of a source from the ports of a component."""
    seed: int

    @property
    def sends(self) -> np.ndarray:
        """Whether each source sends photons, shape (source,)."""
        bins = self.sources.bins
        return self.wanted[bins] if len(self.wanted) else np.zeros(len(bins), bool)


@dataclass(frozen=True)
class _Launches:
    """Photons of one kind of bins from the ports of some components."""

    kind: _Kind
    starts: PhotonStarts
    seeds: np.ndarray
    """Seed of the photons of every component."""
    world: PhotonScene
    areas: CellAreas
    surfaces: int
    """Largest number of surfaces on a path."""
    imaged: bool
    """Whether light that has images counts, see `Traits`."""

    def followed(
        self, some: Mapping[str, np.ndarray] | None, squares: Recorder, sums: FluxSums,
        progress: Progress,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """Follow all photons, or `some` of the components that these name.

        Their flux is added to `sums`.

        Returns
        -------
        dict of np.ndarray of uint32, shape (photon,)
            Photons that met a pane that may change, as in `CommonLight.met`.
        """
        kind, starts, is_named = self.kind, self.starts, bool(self.starts.names[0])
        listed = starts.panes is not None and is_named and some is None
        rows = PhotonRows.of(starts.every, kind.sources, kind.sends)
        met = [_NO_PHOTONS]
        with starts.scene.ray_counter.purpose(*self._purpose):
            for share, here, lane in self._launches(rows, some if is_named else None):
                start = starts.start(kind.sources, here, kind.photons, self.seeds, lane)
                followed = self._follow(start, squares, sums)
                met += self._numbers(start, lane, *followed) if listed else []
                progress(share)
        component, number = np.concatenate(met, axis=1)
        return {name: number[component == c] for c, name in enumerate(starts.names)}

    @property
    def _purpose(self) -> tuple[str, str, str]:
        """Purpose of the photons' rays: those of panes have an empty name at the end."""
        whose = "components" if self.starts.names[0] else ""
        return Stream.PHOTONS.name, self.kind.draw.name, whose

    def count_photons(self, fates: np.ndarray) -> None:
        """Count the flights of photons, whose `fates` are those of `FluxSums.by_fate`."""
        counter = self.starts.scene.ray_counter
        with counter.purpose(*self._purpose):
            counter.take("photon", round(fates[:, :, -1].sum()))

    def _launches(
        self, rows: PhotonRows, some: Mapping[str, np.ndarray] | None
    ) -> Iterator[tuple[float, PhotonRows, mi.UInt32]]:
        """Yield, for each launch, the share that is done after it, its rows, and its lanes."""
        count = self.kind.photons
        if some is None:
            block = max(1, PHOTONS // count)
            for first in range(0, len(rows), block):
                here = rows.some(slice(first, first + block))
                done = (first + len(here)) / len(rows)
                yield done, here, dr.arange(mi.UInt32, len(here) * count)
            return
        place = np.zeros((len(self.starts.names), len(self.kind.sources.bins)), int)
        place[rows.component, rows.source] = np.arange(len(rows))
        named = [(c, some[name]) for c, name in enumerate(self.starts.names)]
        row = np.concatenate([place[c][photons // count] for c, photons in named])
        index = np.concatenate([photons % count for _, photons in named])
        for first in range(0, len(row), PHOTONS):
            mine = slice(first, first + PHOTONS)
            used, at = np.unique(row[mine], return_inverse=True)
            lanes = flat_indices(at * count + index[mine])
            yield min(1.0, (first + PHOTONS) / len(row)), rows.some(used), lanes

    def _follow(self, start: Start, squares: Recorder, sums: FluxSums) -> tuple[mi.UInt32, mi.Bool]:
        """Follow photons and add their flux; those with any, and whether each met a pane."""
        kind, starts = self.kind, self.starts
        dr.eval(*start)
        lanes = dr.compress(start.flux > 0)
        if not dr.width(lanes):
            return lanes, mi.Bool()
        some = Start(*(dr.gather(type(x), x, lanes) for x in start))
        # Mitsuba's sampler is three times slower in a loop than the generator behind it.
        number = dr.gather(mi.UInt32, mi.UInt32(kind.sources.numbers), some.source)
        seeds = (starts.seed(self.seeds + apart, some.component) for apart in (0, SCATTER))
        random = (streams(number, seed, some.index) for seed in seeds)
        self.areas.grid.prepare()
        sizes = len(kind.wanted), self.surfaces
        by_pane = follow(
            self.world, self._traits, self.areas, squares, some, sums,
            *(dr.opaque(mi.UInt32, size) for size in sizes), *random,
        )  # fmt: skip
        dr.eval(by_pane, *sums)  # together: each alone would follow all photons again
        return lanes, by_pane

    @cached_property
    def _traits(self) -> Traits:
        starts = self.starts
        return Traits.of(starts.scene, starts.names, starts.panes, self.imaged)

    def _numbers(
        self, start: Start, lane: mi.UInt32, followed: mi.UInt32, by_pane: mi.Bool
    ) -> Iterator[np.ndarray]:
        """Yield components and numbers of photons that met a pane, or to which panes stop light."""
        count = dr.opaque(mi.UInt32, self.kind.photons)
        dark = start.by_pane & (start.flux <= 0)  # they may be bright in another state
        met = [dr.compress(dark)]
        if dr.width(followed):
            met.append(dr.gather(mi.UInt32, followed, dr.compress(by_pane)))
        for at in met:
            if dr.width(at):
                columns = (start.source, lane, start.component)
                source, index, component = (dr.gather(mi.UInt32, x, at) for x in columns)
                yield np.stack([component.numpy(), (source * count + index % count).numpy()])
