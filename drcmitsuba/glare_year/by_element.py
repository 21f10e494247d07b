"""Light by element at eyes, and on all that they see: any façade is a sum of it.

case, openings ─ illuminance by element ─► E_v: `KnownYear`, exact for every façade
eyes ─ rays, a trace for each number of a fill ─► `SeenPlace`
     ─ points of surfaces, those of all fills ──► their luminance by element

What openings send back into the room onto surfaces is, of the light that an element brings in, that
of the façade whose openings all have the fill of its number: exact where they have, else to first
order. Light at the eyes is exact for every façade.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.chosen_facade import light_of_channels
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import luminances_of
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.eye.openings import SeenOpenings
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.place import SeenPlace, seen_places
from drcmitsuba.glare_year.seen import SeenSurfaces
from drcmitsuba.glare_year.state import again_with, coarser, on_paths
from drcmitsuba.glare_year.surface_light import LightRows
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import rotation
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.schema import channel_weights
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements import LightByElement, chosen
from drcmitsuba.transport.elements.known_year import KnownYear
from drcmitsuba.transport.elements.weights import BESIDES

COEFFICIENTS = 1 << 26
"""Largest number of coefficients of surfaces in one replicate that are in memory at once: each set
of points loads the scenes of all elements."""


@dataclass(frozen=True, eq=False)
class ElementTracing:
    """Light by element of a case for eyes and surfaces."""

    case: Case
    panes: PaneGroups
    """Openings and their fills."""
    light: Daylight
    run: Run

    @property
    def openings(self) -> GroupStates:
        """Names of the openings and of their fills."""
        return self.panes.states

    @property
    def rows(self) -> LightRows:
        """Rows of the light of surfaces."""
        return LightRows.of(self.openings.starts)

    def light_at_eyes(
        self, looking: Eyes, done: Progress, kept: int | None = None
    ) -> tuple[LightByElement, ...]:
        """Light at the eyes by element, channel by channel; `kept` as of `elements.compute`."""
        run = on_paths(self.run)
        accuracy, at = run.accuracy(self.case, len(looking)), (looking.points, looking.forward)
        return light_of_channels(
            self.case, self.panes, self.light.suns, accuracy, run.enabled_effects, done, kept,
            receivers=at,
        )  # fmt: skip

    def at_eyes(self, looking: Eyes) -> EyeIlluminance:
        """Vertical illuminance at the eyes by element."""
        with self.run.timed("eyes") as done:
            channels = self.light_at_eyes(looking, done)
            return EyeIlluminance(tuple(KnownYear.of(each, self._L) for each in channels))

    def places(self, looking: Eyes, least: float) -> Iterator[SeenPlace]:
        """Trace what is seen from each place by every element; see `seen_places`."""
        effects, openings = self.run.enabled_effects, self.openings
        panes = grouped_panes(self.case, effects, self.panes)
        scenes = [
            scene.load(self.case, openings.label(row), -1, effects, self.panes)
            for row in openings.in_step
        ]
        seen_openings = SeenOpenings.of(panes, openings.starts)
        yield from seen_places(
            self.case, scenes, seen_openings, self.rows, self._traced, self.light, looking,
            self.run, least=least, coefficients=COEFFICIENTS,
        )  # fmt: skip

    def _traced(self, surfaces: SeenSurfaces, replicates: int, again: bool) -> _ByElement:
        """Light of surfaces by element; a `Tracer`.

        Points in a room of boxes and beyond its walls are traced apart: those within are lit by way
        of its openings alone.
        """
        shape = len(self.rows.elements), replicates, len(surfaces.points), self._L.shape[0]
        out = np.zeros(shape, np.float32)
        inside = self._inside(surfaces.points)
        for some in (np.flatnonzero(inside), np.flatnonzero(~inside)):
            if len(some):
                self._trace(surfaces.take(some), replicates, again, out, some)
        return _ByElement(out)

    def _inside(self, points: np.ndarray) -> np.ndarray:
        """Whether points lie in a room of boxes, bool (point,); True where there is none."""
        room = self.case.room
        if room is None:
            return np.ones(len(points), bool)
        own = points @ rotation(self.case)
        return np.asarray(((own > 0) & (own < np.array(room.size))).all(axis=1))

    def _trace(
        self, surfaces: SeenSurfaces, replicates: int, again: bool, out: np.ndarray,
        some: np.ndarray,
    ) -> None:  # fmt: skip
        """Add the light of surfaces to `out` (row, replicate, point, time) at `some` points."""
        run = again_with(self.run) if again else self.run
        # Surfaces have no rows for pairs of elements.
        effects = replace(run.enabled_effects, pane_to_pane=False)
        accuracy = run.accuracy(coarser(self.case, replicates), len(surfaces.points))
        channels = light_of_channels(
            self.case, self.panes, self.light.suns, accuracy, effects, _untold,
            receivers=(surfaces.points, surfaces.normals),
        )  # fmt: skip
        for each, weight, share in zip(
            channels, surfaces.weight.T, channel_weights(len(channels)), strict=True
        ):
            year = KnownYear.of(each, self._L)
            factor = (share * weight).astype(np.float32)[:, None]
            for row, element in enumerate(self.rows.elements):
                if element in year.lit:
                    E = year.of_element(element, self._like(element))
                    out[row][:, some] += factor * E.swapaxes(1, 2)

    @cached_property
    def _L(self) -> Any:
        """Luminances of all bins [cd/m²], csr matrix (time, bin)."""
        labels = (*Patches(self.case.sky.subdivision).labels, *self.light.suns.labels)
        return luminances_of(self.light, labels)

    def _like(self, element: int) -> np.ndarray:
        """Shares (element,) of the façade with the fill of an element's number in all openings."""
        *first, count = self.openings.starts
        fill = 0
        if element != BESIDES:
            fill = element - first[np.searchsorted(first, element, side="right") - 1]
        return chosen(np.array(first), np.minimum(fill, self.openings.last), count)


def _untold(share: float) -> None:
    """Progress of one of many parts."""


@dataclass(frozen=True, eq=False)
class _ByElement:
    """Luminances of surfaces by element; see `TracedSurfaces`."""

    luminance: np.ndarray
    """[cd/m²], float32, shape (row, replicate, point, time)."""

    def mean(self) -> np.ndarray:
        """Mean over the replicates, see `TracedSurfaces`."""
        return np.asarray(self.luminance.mean(axis=1))

    def each(self, points: np.ndarray) -> np.ndarray:
        """Luminance by each replicate, see `TracedSurfaces`."""
        return self.luminance[:, :, points]


@dataclass(frozen=True, eq=False)
class EyeIlluminance:
    """Vertical illuminance at eyes by element."""

    years: tuple[KnownYear, ...]
    """Illuminances of every colour channel."""

    def in_facade(self, shares: np.ndarray, hours: np.ndarray | None = None) -> np.ndarray:
        """E_v by each replicate [lx], (replicate, time, view), of shares (time, element).

        At time stamps that are not among the `hours`, by default all, it is 0.
        """
        first = self.years[0].light
        times = self.years[0].L.shape[0]
        hours = np.arange(times) if hours is None else hours
        out = np.zeros((first.replicates, times, len(first.positions)), np.float32)
        for weight, year in zip(channel_weights(len(self.years)), self.years, strict=True):
            out[:, hours] += weight * year.illuminance(shares[hours], hours)
        return out
