r"""DGP of the eyes of a case as a function of shares of fills, with derivatives, for searches.

With the shares w of elements, an opening with one fill each, and their factors f,

.. math:: S(w) = \sum_J S_J + \sum_e w_e f_e^2 S_e
          + \sum_p w_{e(p)}\, b(L_p)\, L_p^2 \frac{\omega_p}{P_p^2}, \qquad
          L_p = f_{e(p)} \sum_e w_e f_e L_{p,e}

with the sources S_J of sky and films that join (`joined_sources`), the sums S_e over the suns and
the peaks that are seen by the element e alone, and the surfaces p that are seen, each in an element
e(p) or in none, whose luminances are sums over elements, too.
b is 1 where a luminance is above the threshold of glare sources. The illuminance at the eyes is
that of `SmoothYear`.

Limits: surfaces do not join with what is beside them. Sources join as if all that elements show
were bright. A sun behind a pane of a small share is a source of that share, not one for a part of
the hours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import APPLIED
from drcmitsuba.glare_year.by_element import ElementTracing
from drcmitsuba.glare_year.element_sampler import samples_of
from drcmitsuba.glare_year.eyes import Eyes, eyes
from drcmitsuba.glare_year.joined_sources import JoinedSources, near_elements
from drcmitsuba.glare_year.place import SeenPlace
from drcmitsuba.glare_year.result import CLASSES, GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.surface_light import FIRST
from drcmitsuba.glare_year.year import glare, rated
from drcmitsuba.metrics import smooth_step
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.progress import Stage
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.schema import channel_weights
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import bright_hours
from drcmitsuba.transport.elements.mixed_rows import Rows, mixed
from drcmitsuba.transport.elements.smooth_year import SmoothYear
from drcmitsuba.transport.elements.state_illuminances import weighed
from drcmitsuba.transport.elements.weights import BESIDES

LIMIT = CLASSES["medium"]
"""DGP above which an hour is one of glare."""
RULE = Rule()
LEAST_LIGHT = 1.0
"""Illuminance at an eye below which DGP does not ask for less [lx]."""


class _Surfaces(NamedTuple):
    """Bright surfaces that are seen from one place."""

    elements: np.ndarray
    """Element of every row, the number of all for `BESIDES`, int, shape (row,)."""
    rows: Rows
    """Luminance by each element [cd/m²], flat (entry,)."""
    seen: mi.UInt32
    """Element by which each entry is seen, likewise."""
    at: mi.UInt32
    """Place of each entry's time stamp among the sums, with the first view."""
    views: tuple[tuple[int, mi.Float], ...]
    """Views, and ω / P² of every entry for each [sr]."""


@dataclass(frozen=True)
class SearchedEyes:
    """Eyes of a searched façade, and what they see by element: `design.facade_glare.TracedEyes`."""

    tracing: ElementTracing
    looking: Eyes
    channels: tuple[tuple[float, SmoothYear], ...]
    """Weight in luminance, and illuminance at the eyes, of every colour channel."""
    sources: tuple[np.ndarray, Rows]
    """Elements by which suns and peaks are seen, the number of all for none, and their sums S_e,
    flat (time, view) [cd²/m⁴ sr]."""
    joined: tuple[JoinedSources, ...]
    """Sources that join."""
    surfaces: tuple[_Surfaces, ...]
    """Surfaces of every place."""
    counted: np.ndarray
    """Whether each time stamp has daylight, bool, shape (time,)."""

    @classmethod
    def of(
        cls, tracing: ElementTracing, looking: Eyes, is_open: np.ndarray,
        closings: Sequence[np.ndarray], stage: Stage,
    ) -> SearchedEyes:  # fmt: skip
        """Trace the eyes; `is_open` and `closings` are as for `SmoothYear.of`."""
        with stage("eyes") as done:
            channels = tracing.light_at_eyes(looking, done, kept=1)
        years = [SmoothYear.of(each, tracing.light, is_open, closings) for each in channels]
        weights, count = channel_weights(len(years)), tracing.openings.starts[-1]
        times, views = tracing.light.sky.sizes["time"], len(looking)
        sums: dict[int, np.ndarray] = {}
        joined, surfaces, judged = list[JoinedSources](), [], 0
        with stage("what is seen") as done:
            for place in _few(tracing).places(looking, RULE.least):
                numbers = [count if e == BESIDES else e for e in place.sources]
                light = np.zeros((len(numbers), 5, len(place.views), times), np.float32)
                for k, element in enumerate(place.sources):
                    light[k], peaks = place.light_by(element, RULE)
                    S = sums.setdefault(numbers[k], np.zeros((times, views), np.float32))
                    S[:, place.views] = peaks.T
                joined += _joined(place, looking, np.array(numbers, int), light)
                surfaces.append(_surfaces(place, len(looking), count))
                judged += len(place.views)
                done(judged / views)
        return cls(
            tracing, looking, tuple(zip(weights, years, strict=True)),
            (np.array([*sums], int), tuple(flat(S) for S in sums.values())),
            tuple(joined), tuple(surfaces),
            bright_hours(tracing.light.sky),
        )  # fmt: skip

    def at(self, hours: np.ndarray) -> SearchedEyes:
        """Eyes at some time stamps (hour,), as for `SmoothYear.at`."""
        views, place = len(self.looking), np.full(len(self.counted), -1)
        place[hours] = np.arange(len(hours))
        entries = flat_indices(hours[:, None] * views + np.arange(views))
        (numbers, sums), here = self.sources, flat_indices(hours)
        return replace(
            self,
            channels=tuple((weight, year.at(hours)) for weight, year in self.channels),
            sources=(numbers, tuple(dr.gather(mi.Float, S, entries) for S in sums)),
            joined=tuple(each.at(here) for each in self.joined),
            surfaces=tuple(_at(each, place, views) for each in self.surfaces),
            counted=self.counted[hours],
        )

    @property
    def limit(self) -> float:
        """DGP above which an hour is one of glare."""
        return LIMIT

    def dgp(
        self, shares: mi.Float, factors: mi.Float, sharpness: float | None
    ) -> tuple[mi.TensorXf, ...]:
        """DGP in every state of the façade, with gradients, without its limits 0 and 1.

        Parameters
        ----------
        shares, factors : mi.Float, shape (element + 1,)
            As for `SmoothYear.illuminance`.
        sharpness : float, optional
            That of the step at the threshold of sources; None for the threshold itself.

        Returns
        -------
        tuple of mi.TensorXf, shape (time, view)
        """
        at_eyes = weighed((w, year.illuminance(shares, factors)) for w, year in self.channels)
        return tuple(
            _dgp(Ev, self._sums(own, factors, sharpness))
            for Ev, own in zip(at_eyes.states, self._of_states(shares), strict=True)
        )

    def in_facades(
        self, case: Case, panes: PaneGroups, shares: np.ndarray, stage: Stage
    ) -> GlareYear:
        """Glare by light paths that took no part in the search, with shares of every hour.

        `shares` (time, element) are of the openings of a case, whose fills may let through more or
        less than those of the search.
        """
        tracing, looking = self.tracing, self.looking
        seed = case_seed(tracing.case.accuracy.seed, Stream.FRESH_SEED)
        run = replace(tracing.run, seed=seed, stage=stage)
        fresh = ElementTracing(case, panes, tracing.light, run)
        samples = samples_of(
            [shares], fresh.at_eyes(looking), fresh.places(looking, RULE.least),
            looking, RULE,
        )  # fmt: skip
        return rated(case, tracing.light, looking, (APPLIED,), samples, (), rule=RULE, run=run)

    def of_case(self, case: Case, stage: Stage) -> GlareYear:
        """Glare of another case, as from `glare`."""
        return glare(case, stage=stage)

    def _of_states(self, shares: mi.Float) -> list[mi.Float]:
        """Shares of elements in every state of the façade."""
        row = mi.TensorXf(shares, (1, dr.width(shares)))
        return [shares, *((row @ closing).array for closing in self.channels[0][1].closings)]

    def _sums(self, shares: mi.Float, factors: mi.Float, sharpness: float | None) -> mi.Float:
        """S by shares of elements, flat (time, view)."""
        numbers, rows = self.sources
        S = dr.zeros(mi.Float, len(self.counted) * len(self.looking))
        time = dr.arange(mi.UInt32, len(self.counted)) * dr.opaque(mi.UInt32, len(self.looking))
        for joined in self.joined:
            at = time + dr.opaque(mi.UInt32, joined.view)
            dr.scatter_add(S, joined.sums(shares, factors), at)
        if len(rows):
            S += mixed(rows, _taken(shares * factors * factors, numbers))
        for place in self.surfaces:
            if not dr.width(place.at):
                continue
            L = mixed(place.rows, _taken(shares * factors, place.elements))
            L *= dr.gather(mi.Float, factors, place.seen)
            if sharpness is None:
                bright = dr.select(RULE.threshold < L, mi.Float(1), 0)
            else:
                bright = smooth_step.step(L, RULE.threshold, sharpness)
            term = dr.gather(mi.Float, shares, place.seen) * bright * L * L
            for view, weight in place.views:
                dr.scatter_add(S, term * weight, place.at + view)
        return S


@dataclass(frozen=True)
class EyesOfSearch:
    """Eyes of a case whose façade is searched: a `design.facade_glare.TraceEyes`."""

    looking: Eyes

    @classmethod
    def of(cls, case: Case) -> EyesOfSearch:
        """Eyes of a case; errors are those of `eyes`."""
        return cls(eyes(case))

    def traced(
        self, case: Case, panes: PaneGroups, light: Daylight, effects: EnabledEffects,
        is_open: np.ndarray, closings: Sequence[np.ndarray], stage: Stage,
    ) -> SearchedEyes:  # fmt: skip
        """Trace the eyes of a case whose openings and fills are known.

        Other arguments are as for `SearchedEyes.of`.
        """
        tracing = ElementTracing(case, panes, light, Run.of(case, effects))
        return SearchedEyes.of(tracing, self.looking, is_open, closings, stage)


def worst_view(year: GlareYear) -> tuple[str, xr.Dataset]:
    """View with the most hours of glare in the last state, and their share with its interval [%].

    The interval has `value`, `low` and `high`.
    """
    every = year.interval(LIMIT).isel(state=-1)
    worst = int(every["value"].argmax("view"))
    return year.views[worst], every.isel(view=worst)


def _joined(
    place: SeenPlace, looking: Eyes, numbers: np.ndarray, light: np.ndarray
) -> Iterator[JoinedSources]:
    """Yield the sources of a place view by view.

    `light` (element, 5, view, time) is that of elements with these `numbers`, by
    `SeenPlace.light_by`.
    """
    near = near_elements(place.seen, place.seen.tiles.opened(RULE.opening), place.sources)
    for k, view in enumerate(place.views.tolist()):
        shown = np.flatnonzero(near[k].diagonal())
        rows = tuple(tuple(flat(light[e, j, k]) for e in shown) for j in range(5))
        if len(shown):
            pairs = near[k][np.ix_(shown, shown)]
            yield JoinedSources(view, looking.frames[view], numbers[shown], pairs, rows)


def _dgp(Ev: mi.TensorXf, S: mi.Float) -> mi.TensorXf:
    """DGP (time, view) from E_v [lx] and S."""
    c, E = RULE.constants, dr.maximum(Ev.array, LEAST_LIGHT)
    contrast = dr.log(1 + S * dr.exp(-1.87 * dr.log(E))) / np.log(10)
    value = c.illuminance * Ev.array + c.contrast * contrast + c.offset
    return mi.TensorXf(value, Ev.shape)


def _few(tracing: ElementTracing) -> ElementTracing:
    """Tracing whose surfaces have the first replicates alone: a search knows no intervals."""
    accuracy = tracing.case.accuracy.model_copy(update={"replicates": FIRST})
    return replace(tracing, case=tracing.case.with_tables(accuracy=accuracy))


def _taken(values: mi.Float, index: np.ndarray) -> mi.Float:
    return dr.gather(mi.Float, values, flat_indices(index))


def _at(surfaces: _Surfaces, place: np.ndarray, views: int) -> _Surfaces:
    """Surfaces at some time stamps, which have a place among them, −1 for none (time,)."""
    there = place[surfaces.at.numpy() // views]
    some = np.flatnonzero(there >= 0)
    entries = flat_indices(some)
    return surfaces._replace(
        rows=tuple(dr.gather(mi.Float, row, entries) for row in surfaces.rows),
        seen=dr.gather(mi.UInt32, surfaces.seen, entries),
        at=flat_indices(there[some] * views),
        views=tuple((view, dr.gather(mi.Float, of, entries)) for view, of in surfaces.views),
    )


def _surfaces(place: SeenPlace, views: int, count: int) -> _Surfaces:
    """Bright surfaces of a place; there are so many views and elements in all."""
    light, seen = place.light, place.seen

    def numbered(elements: np.ndarray) -> np.ndarray:
        return np.where(elements == BESIDES, count, elements)

    lit = [k for k, row in enumerate(light.luminance) if row.any()]
    return _Surfaces(
        numbered(np.array(light.rows.elements, int)[lit]),
        tuple(flat(light.luminance[k]) for k in lit),
        flat_indices(numbered(seen.surfaces.element[light.point])),
        flat_indices(light.time * views),
        tuple((int(v), flat(seen.of_points[light.point, i])) for i, v in enumerate(place.views)),
    )
