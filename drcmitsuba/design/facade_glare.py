r"""Hours of glare of a searched façade: DGP of every eye by a composition, smooth and hard.

With the shares w of elements, an opening with one fill each, and their factors f,

.. math:: S(w) = \sum_e w_e f_e^2 S_e
          + \sum_p w_{e(p)}\, b(L_p)\, L_p^2 \frac{\omega_p}{P_p^2}, \qquad
          L_p = f_{e(p)} \sum_e w_e f_e L_{p,e}

with the sums S_e over the glare sources that are seen by the element e alone, and the surfaces p
that are seen, each in an element e(p) or in none, whose luminances are sums over elements, too.
b is 1 where a luminance is above the threshold of glare sources. The illuminance at the eyes is
that of `SmoothYear`. DGP of the states of the façade is mixed as their illuminance is.

Limits: sources of two tiles, or of a tile and a surface beside it, do not join. Where their
luminance is the same, the sum is: that of joined sources has the mean of their luminances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import APPLIED
from drcmitsuba.design.facade_groups import FacadeGroups, applied, smooth_applied
from drcmitsuba.design.facade_tiles import TiledLight
from drcmitsuba.glare_year.by_element import ElementTracing
from drcmitsuba.glare_year.element_sampler import samples_of
from drcmitsuba.glare_year.eyes import Eyes, eyes
from drcmitsuba.glare_year.place import SeenPlace
from drcmitsuba.glare_year.result import CLASSES, GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.surface_light import FIRST
from drcmitsuba.glare_year.year import rated
from drcmitsuba.metrics import smooth_step
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.progress import Stage
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.schema import channel_weights
from drcmitsuba.sky.luminances import bright_hours
from drcmitsuba.transport.elements.smooth_year import Rows, SmoothYear, mixed
from drcmitsuba.transport.elements.state_illuminances import Illuminances
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
class FacadeGlare:
    """Eyes of a searched façade, and what they see by element."""

    tracing: ElementTracing
    looking: Eyes
    channels: tuple[tuple[float, SmoothYear], ...]
    """Weight in luminance, and illuminance at the eyes, of every colour channel."""
    sources: tuple[np.ndarray, Rows]
    """Elements by which sources are seen, the number of all for none, and their sums S_e, flat
    (time, view) [cd²/m⁴ sr]."""
    surfaces: tuple[_Surfaces, ...]
    """Surfaces of every place."""
    counted: np.ndarray
    """Whether each time stamp has daylight, bool, shape (time,)."""

    @classmethod
    def of(cls, tiled: TiledLight, stage: Stage) -> FacadeGlare:
        """Trace the eyes of a case whose light is known by tile; errors are those of `eyes`."""
        tracing = tiled.tracing
        assert tracing is not None
        looking, light = eyes(tracing.case), tracing.light
        with stage("eyes") as done:
            channels = tracing.light_at_eyes(looking, done, kept=1)
        years = [
            SmoothYear.of(each, light, tiled.is_open, tiled.closings, tiled.group)
            for each in channels
        ]
        weights, count = channel_weights(len(years)), tracing.openings.starts[-1]
        times, views = light.sky.sizes["time"], len(looking)
        sums: dict[int, np.ndarray] = {}
        surfaces = []
        with stage("what is seen") as done:
            for place in _few(tracing).places(looking, RULE.least):
                for element in place.sources:
                    S = sums.setdefault(element, np.zeros((times, views), np.float32))
                    S[:, place.views] = place.sums_by(element, looking, RULE)
                surfaces.append(_surfaces(place, looking, count))
                done(sum(len(one.views) for one in surfaces) / views)
        numbers = np.array([count if e == BESIDES else e for e in sums], int)
        return cls(
            tracing, looking, tuple(zip(weights, years, strict=True)),
            (numbers, tuple(flat(S) for S in sums.values())), tuple(surfaces),
            bright_hours(light.sky),
        )  # fmt: skip

    def smooth(
        self, shares: mi.Float, factors: mi.Float, E: Illuminances, rules: Rules,
        groups: FacadeGroups | None, sharpness: float,
    ) -> mi.TensorXf:  # fmt: skip
        """Soft share of the hours with glare at each view [%], shape (view,), with gradients.

        Parameters
        ----------
        shares, factors : mi.Float, shape (element + 1,)
            As for `SmoothYear.illuminance`.
        E : Illuminances
            Illuminance of the sensors, whose direct sun closes the shade.
        rules, groups
            Rule of the shade, as for `facade_groups.smooth_applied`.
        sharpness : float
        """

        def bright(L: mi.Float) -> mi.Float:
            return smooth_step.step(L, RULE.threshold, sharpness)

        of_states = self._states(shares, factors, E, bright)
        dgp = smooth_applied(of_states, rules, groups, sharpness)
        is_counted = mi.TensorXf(self.counted.astype(np.float32)[:, None])
        hours = smooth_step.total(smooth_step.passed(dgp, LIMIT, sharpness) * is_counted, axis=0)
        return hours * (100 / self._count)

    def hard(
        self, shares: mi.Float, factors: mi.Float, E: Illuminances, direct: xr.DataArray,
        rules: Rules, groups: FacadeGroups | None,
    ) -> np.ndarray:  # fmt: skip
        """Share of the hours whose DGP is above `LIMIT` at each view [%], shape (view,).

        `direct` is `E.direct` with the coordinates of the sensors.
        """

        def bright(L: mi.Float) -> mi.Float:
            return dr.select(RULE.threshold < L, mi.Float(1), 0)

        of_states = self._states(shares, factors, E, bright)
        dgp = applied(of_states, direct, rules, groups)[self.counted]
        return np.asarray(100 * (dgp > LIMIT).sum(axis=0) / self._count)

    def afresh(
        self, shares: mi.Float, E: Illuminances, direct: xr.DataArray, rules: Rules,
        groups: FacadeGroups | None, stage: Stage,
    ) -> GlareYear:  # fmt: skip
        """Glare of a composition by light paths that took no part in the search, shade applied.

        Parameters are those of `hard`.
        """
        count = len(E.states)
        numbers = [dr.full(mi.TensorXf, k, (len(self.counted), 1)) for k in range(count)]
        numbered = E._replace(open=numbers[0], shaded=numbers[1], others=tuple(numbers[2:]))
        state = applied(numbered, direct, rules, groups)[:, 0].astype(int)
        every = np.stack([own.numpy()[:-1] for own in self._of_states(shares)])
        tracing, looking = self.tracing, self.looking
        seed = case_seed(tracing.case.accuracy.seed, Stream.FRESH_SEED)
        fresh = replace(tracing, run=replace(tracing.run, seed=seed, stage=stage))
        samples = samples_of(
            {APPLIED: every[state]}, fresh.at_eyes(looking), fresh.places(looking, RULE.least),
            looking, RULE,
        )  # fmt: skip
        return rated(
            tracing.case, tracing.light, looking, (APPLIED,), samples, (), rule=RULE, run=fresh.run
        )

    def _of_states(self, shares: mi.Float) -> list[mi.Float]:
        """Shares of elements in every state of the façade."""
        row = mi.TensorXf(shares, (1, dr.width(shares)))
        return [shares, *((row @ closing).array for closing in self.channels[0][1].closings)]

    @property
    def _count(self) -> int:
        """Number of time stamps with daylight."""
        return max(1, int(self.counted.sum()))

    def _states(
        self, shares: mi.Float, factors: mi.Float, E: Illuminances,
        bright: Callable[[mi.Float], mi.Float],
    ) -> Illuminances:  # fmt: skip
        """DGP (time, view) of every state in place of its illuminance."""
        (weight, first), *others = self.channels
        at_eyes = first.illuminance(shares, factors).scaled(weight)
        for weight, year in others:
            at_eyes = at_eyes.plus(year.illuminance(shares, factors).scaled(weight))
        dgp = [
            self._dgp(Ev, self._sums(own, factors, bright))
            for Ev, own in zip(at_eyes.states, self._of_states(shares), strict=True)
        ]
        return E._replace(open=dgp[0], shaded=dgp[1], others=tuple(dgp[2:]))

    def _sums(
        self, shares: mi.Float, factors: mi.Float, bright: Callable[[mi.Float], mi.Float]
    ) -> mi.Float:
        """S by shares of elements, flat (time, view)."""
        numbers, rows = self.sources
        size = len(self.counted) * len(self.looking)
        S = dr.zeros(mi.Float, size)
        if len(rows):
            S += mixed(rows, _taken(shares * factors * factors, numbers))
        for place in self.surfaces:
            if not dr.width(place.at):
                continue
            L = mixed(place.rows, _taken(shares * factors, place.elements))
            L *= dr.gather(mi.Float, factors, place.seen)
            term = dr.gather(mi.Float, shares, place.seen) * bright(L) * L * L
            for view, weight in place.views:
                dr.scatter_add(S, term * weight, place.at + view)
        return S

    def _dgp(self, Ev: mi.TensorXf, S: mi.Float) -> mi.TensorXf:
        """DGP (time, view), without its limits 0 and 1."""
        c, E = RULE.constants, dr.maximum(Ev.array, LEAST_LIGHT)
        contrast = dr.log(1 + S * dr.exp(-1.87 * dr.log(E))) / np.log(10)
        value = c.illuminance * Ev.array + c.contrast * contrast + c.offset
        return mi.TensorXf(value, Ev.shape)


def worst_view(year: GlareYear) -> tuple[str, xr.Dataset]:
    """View with the most hours of glare in the last state, and their share with its interval [%].

    The interval has `value`, `low` and `high`.
    """
    every = year.interval(LIMIT).isel(state=-1)
    worst = int(every["value"].argmax("view"))
    return year.views[worst], every.isel(view=worst)


def asked_of(case: Case) -> bool:
    """Whether `[design]` asks for hours of glare; InputError where it does, but there is no eye."""
    asked = case.design is not None and case.design.asks_glare
    if asked:
        eyes(case)
    return asked


def _few(tracing: ElementTracing) -> ElementTracing:
    """Tracing whose surfaces have the first replicates alone: a search knows no intervals."""
    accuracy = tracing.case.accuracy.model_copy(update={"replicates": FIRST})
    return replace(tracing, case=tracing.case.with_tables(accuracy=accuracy))


def _taken(values: mi.Float, index: np.ndarray) -> mi.Float:
    return dr.gather(mi.Float, values, flat_indices(index))


def _surfaces(place: SeenPlace, looking: Eyes, count: int) -> _Surfaces:
    """Bright surfaces of a place; `count` is the number of all elements."""
    light, seen = place.light, place.seen
    local = np.einsum("pi,vki->vpk", seen.directions, looking.frames[place.views])
    weights = seen.tiles.by_pixel / position_index(local) ** 2 * (local[..., 2] > 0)
    of_points = np.asarray((seen.showing.T @ weights.T).T)

    def numbered(elements: np.ndarray) -> np.ndarray:
        return np.where(elements == BESIDES, count, elements)

    lit = [k for k, row in enumerate(light.luminance) if row.any()]
    return _Surfaces(
        numbered(np.array(light.rows.elements, int)[lit]),
        tuple(flat(light.luminance[k]) for k in lit),
        flat_indices(numbered(seen.surfaces.element[light.point])),
        flat_indices(light.time * len(looking)),
        tuple((int(v), flat(of_points[i, light.point])) for i, v in enumerate(place.views)),
    )
