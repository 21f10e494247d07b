r"""The smooth twin of a year of known elements: E by any shares, with exact derivatives.

.. math:: E = L \, \Big( C_0 + \sum_e w_e C_e + G_m(w) \big( D_0 + \sum_e w_e D_e \big) \Big)

with the light by element of `transport.elements`, the means of all results, in two states: with the
shade open, and with the shade before what it covers. The shares are those of all time stamps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.aligned_arrays import aligned_zeros
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, shared
from drcmitsuba.schema import positions
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import blended
from drcmitsuba.transport.elements.light import ElementLight, LightByElement
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs
from drcmitsuba.transport.elements.mixed_rows import Rows, mixed
from drcmitsuba.transport.elements.smooth_return import SmoothReturn
from drcmitsuba.transport.elements.state_illuminances import Illuminances, evaluated
from drcmitsuba.transport.elements.straight_pairs import NO_MIRROR, StraightPairs

ChangePairs = Callable[[StraightPairs, Sequence[str]], StraightPairs]
"""Function of pairs and the labels of their bins."""


class _Part(NamedTuple):
    """Elements that are weighed together, with C and block means of D of each, flat (bin, …)."""

    elements: np.ndarray
    total: Rows
    blocks: Rows


@dataclass(frozen=True)
class SmoothYear:
    """Light by element under the sky of a period.

    Shares are those of all elements, followed by 1 for the light that passes no opening.
    """

    months: np.ndarray
    """Month of each time stamp, 1 to 12, int, shape (time,)."""
    step_hours: float
    """Duration of a time step [h]."""
    shape: tuple[int, int, int]
    """Numbers of bins, blocks and sensors."""
    labels: tuple[str, ...]
    """Labels of the bins."""
    closings: tuple[mi.TensorXf, ...]
    """Matrices (element + 1, element + 1) that turn shares into those of each further state."""
    besides: tuple[mi.Float, mi.Float]
    """C and block means of D of light that passes no opening."""
    same: _Part
    """Elements whose shares no state changes."""
    opened: _Part
    """The others that may have a share while everything is open."""
    closed: tuple[_Part, ...]
    """The others that may have a share in each further state; none without a shade."""
    straight: StraightPairs
    """Straight light of the open state."""
    groups: tuple[StraightPairs, ...]
    """That by each group of panes where there are several."""
    pairs: MirroredPairs
    """Pairs of elements, whose weights follow those of all elements."""
    returned: SmoothReturn
    """Light that openings send back."""
    sky: mi.TensorXf
    """Luminance [cd/m²], shape (time, sky bin)."""
    suns: tuple[tuple[mi.UInt32, mi.Float], ...]
    """Bin and luminance [cd/m²] of each sun that is blended at a time stamp."""

    @classmethod
    def of(
        cls, light: LightByElement, daylight: Daylight, is_open: np.ndarray,
        closings: Sequence[np.ndarray], group: np.ndarray | None = None,
    ) -> SmoothYear:  # fmt: skip
        """Put light by element under the daylight of a case.

        Parameters
        ----------
        light : LightByElement
        daylight : Daylight
        is_open : np.ndarray of bool, shape (element,)
            Whether an element may have a share while everything is open.
        closings : sequence of np.ndarray, shape (element, element)
            Matrices that turn shares into those of each further state, that of the shade before
            all that it covers first; 0 on the diagonal of what is covered.
        group : np.ndarray of int, shape (element,), optional
            Number of every element's group of panes, −1 for none, where there are several.

        Raises
        ------
        InputError
            The daylight has bins that the light does not know, or an adaptive sun.
        """
        _check_sky(light, daylight)
        bins, elements, sky = _lit(light), light.elements, daylight.sky
        pairs, every = light.pairs, (*light.elements, light.besides, *light.mirrored)
        suns = _suns(daylight, light.labels, bins)
        covered = [(closing.diagonal() == 0) & is_open for closing in closings]
        shades = [(m[some] > 0).any(axis=0) for m, some in zip(closings, covered, strict=True)]
        moves = np.any([*covered, *shades], axis=0)
        stays = pairs.joined(np.broadcast_to(~moves, len(elements)))
        known: dict[tuple[str, int], mi.Float] = {}
        no_opening = np.diag(np.append(np.zeros(len(elements), np.float32), 1))

        def part(mask: np.ndarray) -> _Part:
            places = np.flatnonzero(mask)  # those of pairs follow what passes no opening
            places = np.where(places < len(elements), places, places + 1).tolist()
            at = [e for e in places if every[e].gives_light]
            for name in ("total", "blocks"):
                new = [e for e in at if (name, e) not in known]
                rows = _rows([every[e] for e in new], name, bins)
                known.update(zip(((name, e) for e in new), rows, strict=True))
            return _Part(
                np.array(at, int), *(tuple(known[n, e] for e in at) for n in ("total", "blocks"))
            )

        def straight(mask: np.ndarray, mirrored: Any = ()) -> StraightPairs:
            some = {(e, NO_MIRROR): every[e] for e in np.flatnonzero(mask).tolist()}
            own = {which: (lit.bins, lit.pairs) for which, lit in (some | dict(mirrored)).items()}
            return StraightPairs.of(own, bins, len(light.positions))

        both = zip(pairs.mirrors, pairs.passed, light.mirrored, strict=True)
        mirrored = {(e, m): lit for m, e, lit in both if is_open[e] and is_open[m]}

        groups = () if group is None else range(group.max(initial=-1) + 1)
        total, blocks = (_rows([light.besides], name, bins)[0] for name in ("total", "blocks"))
        return cls(
            months=sky["clock"].dt.month.values,
            step_hours=daylight.step_hours,
            shape=(len(bins), light.besides.blocks.shape[2], len(light.positions)),
            labels=tuple(light.labels[b] for b in bins),
            closings=tuple(mi.TensorXf(np.pad(m, (0, 1)) + no_opening) for m in closings),
            besides=(total, blocks),
            same=part(pairs.joined(is_open) & stays),
            opened=part(pairs.joined(is_open) & ~stays),
            # Of what some other state covers, shares may stay in this one.
            closed=tuple(
                part(pairs.joined(some | (is_open & (m.diagonal() > 0))) & ~stays)
                for some, m in zip(shades, closings, strict=True)
            )
            if moves.any()
            else (),
            straight=straight(np.append(is_open, True), mirrored),
            groups=tuple(straight(is_open & (group == g)) for g in groups),
            pairs=pairs,
            returned=SmoothReturn.of(light.returned, len(elements)),
            sky=mi.TensorXf(sky["sky"].values.astype(np.float32)),
            suns=suns,
        )

    def at(self, hours: np.ndarray) -> SmoothYear:
        """Year of some time stamps (hour,), with the light of the bins that shine in them."""
        patches, (_, blocks, sensors) = self.sky.shape[1], self.shape
        suns = [(bin_.numpy()[hours], L.numpy()[hours]) for bin_, L in self.suns]
        shine = [bin_[L != 0] for bin_, L in suns]
        bins = np.unique(np.concatenate([np.arange(patches), *shine]))
        known: dict[int, mi.Float] = {}  # parts have arrays in common

        def of_bins(rows: Rows, width: int) -> Rows:
            entries = flat_indices(bins[:, None] * width + np.arange(width))
            for row in rows:
                if id(row) not in known:
                    known[id(row)] = dr.gather(mi.Float, row, entries)
            dr.eval(known)
            return tuple(known[id(row)] for row in rows)

        def part(of: _Part) -> _Part:
            total, light = of_bins(of.total, sensors), of_bins(of.blocks, blocks)
            return _Part(of.elements, total, light)

        total, D = self.besides
        (total,), (D,) = of_bins((total,), sensors), of_bins((D,), blocks)
        step = self.step_hours * len(self.months) / len(hours)
        return replace(
            self, months=self.months[hours], step_hours=step, shape=(len(bins), blocks, sensors),
            labels=tuple(self.labels[b] for b in bins), besides=(total, D),
            same=part(self.same), opened=part(self.opened), closed=tuple(map(part, self.closed)),
            straight=self.straight.at(bins), groups=tuple(each.at(bins) for each in self.groups),
            sky=mi.TensorXf(np.ascontiguousarray(self.sky.numpy()[hours])),
            suns=tuple(
                (flat_indices(np.where(L != 0, np.searchsorted(bins, bin_), 0)), flat(L))
                for bin_, L in suns
            ),
        )  # fmt: skip

    def illuminance(self, shares: mi.Float, factors: mi.Float) -> Illuminances:
        """Illuminance by shares of elements.

        Parameters
        ----------
        shares : mi.Float, shape (element + 1,)
            Shares while the shade is open. Gradients flow through.
        factors : mi.Float, shape (element + 1,)
            Factors of the light that comes in by an element, from surfaces outside as well. Light
            that it sends back into the room keeps its weight.

        Returns
        -------
        Illuminances
            E [lx].
        """
        return evaluated(self.states(shares, factors), self.straight_light(shares, factors))

    def states(self, shares: mi.Float, factors: mi.Float, first: int = 0) -> list[mi.TensorXf]:
        """E [lx] in the states from the `first` one on, 0 the open one; else as `illuminance`."""
        E = list(map(self._accumulated, self.coefficients(shares, factors, first)))
        return E if self.closed else E * (1 + len(self.closings) - first)

    def straight_light(self, shares: mi.Float, factors: mi.Float) -> list[mi.TensorXf]:
        """E by straight sun [lx], as `straight_sun`; parameters are those of `illuminance`."""
        return self.straight_sun(lambda pairs: pairs.weighed(shares, factors))

    def straight_sun(self, weighed: Callable[[StraightPairs], mi.Float]) -> list[mi.TensorXf]:
        """E by straight sun [lx], all of it and that by each group, of C that pairs weigh up to."""
        return [self._by_sun(weighed(pairs)) for pairs in (self.straight, *self.groups)]

    def with_straight(self, change: ChangePairs) -> SmoothYear:
        """Year with other pairs of straight light, made of these and the labels of the bins."""
        straight, *groups = (change(pairs, self.labels) for pairs in (self.straight, *self.groups))
        return replace(self, straight=straight, groups=tuple(groups))

    def coefficients(
        self, shares: mi.Float, factors: mi.Float, first: int = 0
    ) -> tuple[mi.Float, ...]:
        """C of the states from the `first` one on, flat (bin, sensor) [sr].

        Where all states are alike, it is that of one of them. Parameters are those of `states`.
        """
        same = self._sum(self.same, self._weights(shares, factors), self.besides)
        closings = (None, *self.closings) if self.closed else (None,)
        kinds = [*zip(closings, (self.opened, *self.closed), strict=True)]
        states = []
        for closing, part in kinds[first:] or kinds:
            own = shares
            if closing is not None:
                own = (mi.TensorXf(shares, (1, dr.width(shares))) @ closing).array
            lit = self._sum(part, self._weights(own, factors), same)
            states.append(self.returned.added(*lit, own, factors))
        return tuple(states)

    def _weights(self, shares: mi.Float, factors: mi.Float) -> mi.Float:
        """Weights of all elements, of what passes no opening, and of the pairs."""
        own = shares * factors
        if not len(self.pairs):
            return own
        mirrors, passed = np.array(self.pairs.mirrors), np.array(self.pairs.passed)
        return dr.concat((own, _taken(shares, mirrors) * _taken(own, passed)))

    def _sum(
        self, part: _Part, weights: mi.Float, more: tuple[mi.Float, mi.Float]
    ) -> tuple[mi.Float, mi.Float]:
        """C and block means of D by some elements, and more light, flat (bin, …)."""
        if len(part.elements) == 0:
            return more
        own, (C, D) = _taken(weights, part.elements), more
        D = D + mixed(part.blocks, own) if self.shape[1] else D
        return C + mixed(part.total, own), D

    def _accumulated(self, coefficients: mi.Float) -> mi.TensorXf:
        """E [lx] from C, flat (bin, sensor)."""
        patches, sensors = self.sky.shape[1], self.shape[2]
        of_sky = dr.gather(mi.Float, coefficients, dr.arange(mi.UInt32, patches * sensors))
        return self.sky @ mi.TensorXf(of_sky, (patches, sensors)) + self._by_sun(coefficients)

    def _by_sun(self, coefficients: mi.Float) -> mi.TensorXf:
        """E [lx] by the suns alone, from C, flat (bin, sensor)."""
        shape, sensors = (len(self.months), self.shape[2]), dr.opaque(mi.UInt32, self.shape[2])
        total = dr.zeros(mi.Float, shape[0] * shape[1])
        at = dr.arange(mi.UInt32, dr.width(total))
        time, sensor = at // sensors, at % sensors
        for bin_, L in self.suns:
            row = dr.gather(mi.UInt32, bin_, time) * sensors
            C = dr.gather(mi.Float, coefficients, row + sensor)
            total += C * dr.gather(mi.Float, L, time)
        return mi.TensorXf(total, shape)


def _taken(values: mi.Float, index: np.ndarray) -> mi.Float:
    return dr.gather(mi.Float, values, flat_indices(index))


def _lit(light: LightByElement) -> np.ndarray:
    """Bins that any light comes from: ground, all sky patches, and some suns; int, (bin,)."""
    every = (light.besides, *light.elements, *light.mirrored)
    some = [each.bins for each in every if each.gives_light]
    return np.unique(np.concatenate([np.arange(light.sky_bins), *some]))


def _rows(some: Sequence[ElementLight], name: str, bins: np.ndarray) -> Rows:
    """Mean over the results of an array of each element, in the order of `bins`, flat."""
    return tuple(_row(light.bins, getattr(light, name), bins) for light in some)


def _row(own: np.ndarray, results: np.ndarray, bins: np.ndarray) -> mi.Float:
    """Mean over results (result, own bin, …) in the order of `bins`, flat; it may share memory."""
    mean = results[0] if len(results) == 1 else results.mean(axis=0)
    if np.array_equal(own, bins):
        return shared(mean)
    whole, known = aligned_zeros((len(bins), mean.shape[1]), np.float32), np.isin(own, bins)
    whole[np.searchsorted(bins, own[known])] = mean[known]
    return shared(whole)


def _check_sky(light: LightByElement, daylight: Daylight) -> None:
    """Refuse a sky of other patches, or one that was made for one façade."""
    sky = light.labels[: light.sky_bins]
    if tuple(map(str, daylight.sky["bin"].values)) != sky:
        got = f"{daylight.sky.sizes['bin']} bins of the sky, the light has {len(sky)}"
        remedy = "compute the light with the subdivision of this sky"
        raise InputError("light", "bin", got, remedy)
    if "blend_bin" not in daylight.sky:
        raise InputError("case", "sun.model", "adaptive", "take another one")


def _suns(daylight: Daylight, labels: tuple[str, ...], bins: np.ndarray) -> tuple[Any, ...]:
    """Bin and luminance of each blended sun; 0 for suns that light no element."""
    blend, sun, terms = blended(daylight.sky), daylight.sky["sun"].values, []
    everywhere, lit = {*labels, ""}, [labels[b] for b in bins]
    for names, weights in zip(blend.bins.T, blend.weights.T, strict=True):
        strange = [b for b, w in zip(names, weights, strict=True) if w and b not in everywhere]
        if strange:
            got = f"no {strange[0]!r} ({len(strange)} missing)"
            raise InputError("light", "bin", got, "compute the light for this sky")
        at = positions(names, lit, missing=-1)
        L = np.where(at >= 0, weights.astype(float) * sun, 0)
        terms.append((flat_indices(np.maximum(at, 0)), flat(L)))
    return tuple(terms)
