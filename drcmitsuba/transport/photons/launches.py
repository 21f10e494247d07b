"""Photons of one kind of bins, sky and ground or suns, launch by launch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import streams

from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.runtime.launch_size import PHOTONS
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Draw, Stream
from drcmitsuba.transport.photons.fluxes import FluxSums
from drcmitsuba.transport.photons.paths import Recorder, Traits, follow
from drcmitsuba.transport.photons.ports import PhotonSources
from drcmitsuba.transport.photons.receivers import CellAreas
from drcmitsuba.transport.photons.starts import PhotonStarts, Rows, Start
from drcmitsuba.transport.photons.surfaces import PhotonScene

SCATTER = 0x51CA77E5
"""Distance between the seeds of photons and of the surfaces that scatter them."""
_NO_PHOTONS = np.zeros((2, 0), np.uint32)


@dataclass(frozen=True)
class PhotonKind:
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
class PhotonLaunches:
    """Photons of one kind of bins from the ports of some components."""

    kind: PhotonKind
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
        rows = Rows.of(starts.every, kind.sources, kind.sends)
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
        self, rows: Rows, some: Mapping[str, np.ndarray] | None
    ) -> Iterator[tuple[float, Rows, mi.UInt32]]:
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
        return Traits.of(self.starts, self.imaged)

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
