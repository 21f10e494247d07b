r"""The smooth twin of a year of known elements: E by any shares, with exact derivatives.

.. math:: E = L \, \Big( C_0 + \sum_e w_e C_e + G_m(w) \big( D_0 + \sum_e w_e D_e \big) \Big)

with the light by element of `transport.elements`, the means of all results, in two states: with the
shade open, and with the shade before what it covers. The shares are those of all time stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.schema import positions
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import blended
from drcmitsuba.transport.elements.light import ElementLight, LightByElement
from drcmitsuba.transport.elements.marked_light import MarkedLight

Rows = tuple[Any, ...]
"""Arrays (mi.Float) of equal length, one for each element."""
AT_ONCE = 64
"""Number of arrays that one kernel reads."""


class Illuminances(NamedTuple):
    """Illuminance of a period, tensors (time, sensor) [lx]."""

    open: mi.TensorXf
    shaded: mi.TensorXf
    """E with the shade open, and with the shade before all that it covers."""
    direct: mi.TensorXf
    """E by straight sun, the shade open."""

    def scaled(self, factor: float) -> Illuminances:
        """Illuminance times a factor."""
        return self if factor == 1 else Illuminances(*(E * factor for E in self))

    def plus(self, other: Illuminances) -> Illuminances:
        """Illuminance and that of another channel."""
        return Illuminances(*(a + b for a, b in zip(self, other, strict=True)))


def mixed(arrays: Rows, weights: mi.Float) -> mi.Float:
    """Compute Σ weight · array in one pass over the arrays.

    A matrix product, or a loop over one long array, takes six times as long (Dr.Jit 1.5, LLVM).
    """
    total = mi.Float(0)
    for start in range(0, len(arrays), AT_ONCE):
        for i, array in enumerate(arrays[start : start + AT_ONCE], start):
            total += dr.gather(mi.Float, weights, i) * array
        dr.eval(total)
    return total


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
    closing: mi.TensorXf
    """Matrix (element + 1, element + 1) that turns shares into those with the shade closed."""
    besides: tuple[mi.Float, mi.Float, mi.Float]
    """C, block means of D, and C by straight light, of light that passes no opening."""
    same: _Part
    """Elements whose shares the shade does not change."""
    opened: _Part
    """The others that may have a share while the shade is open."""
    closed: _Part | None
    """The others that may have a share while it is closed; None without a shade."""
    straight: tuple[np.ndarray, Rows]
    """Elements that straight light passes and the coefficients of each, flat (bin, sensor) [sr]."""
    returned: tuple[mi.UInt32, mi.UInt32, tuple[mi.UInt32, ...], mi.Float]
    """Sensor, block, elements and weight of paths that met openings; the number of all elements
    stands for none."""
    sky: mi.TensorXf
    """Luminance [cd/m²], shape (time, sky bin)."""
    suns: tuple[tuple[mi.UInt32, mi.Float], ...]
    """Bin and luminance [cd/m²] of each sun that is blended at a time stamp."""

    @classmethod
    def of(
        cls, light: LightByElement, daylight: Daylight, is_open: np.ndarray, closing: np.ndarray
    ) -> SmoothYear:
        """Put light by element under the daylight of a case.

        Parameters
        ----------
        light : LightByElement
            Its light between surfaces is followed on paths, not solved on cells.
        daylight : Daylight
        is_open : np.ndarray of bool, shape (element,)
            Whether an element may have a share while the shade is open.
        closing : np.ndarray, shape (element, element)
            Matrix that turns shares into those with the shade before all that it covers; 0 on the
            diagonal of what it covers.

        Raises
        ------
        InputError
            The daylight has bins that the light does not know, or an adaptive sun.
        """
        _check_sky(light, daylight)
        bins, elements, sky = _lit(light), light.elements, daylight.sky
        suns = _suns(daylight, light.labels, bins)
        covered = (closing.diagonal() == 0) & is_open
        shade = (closing[covered] > 0).any(axis=0)
        moves = covered | shade
        no_opening = np.diag(np.append(np.zeros(len(elements), np.float32), 1))

        def part(mask: np.ndarray) -> _Part:
            at = np.flatnonzero(mask & [element.gives_light for element in elements])
            some = [elements[e] for e in at]
            return _Part(at, *(_rows(some, name, bins) for name in ("total", "blocks")))

        lit = [element.is_lit["straight"] for element in elements]
        passed = np.flatnonzero(lit & is_open)
        total, blocks, straight = (
            _rows([light.besides], name, bins)[0] for name in ("total", "blocks", "straight")
        )
        return cls(
            months=sky["clock"].dt.month.values,
            step_hours=daylight.step_hours,
            shape=(len(bins), light.besides.blocks.shape[2], len(light.positions)),
            closing=mi.TensorXf(np.pad(closing, (0, 1)) + no_opening),
            besides=(total, blocks, straight),
            same=part(is_open & ~moves),
            opened=part(is_open & moves),
            closed=part(shade) if moves.any() else None,
            straight=(passed, _rows([elements[e] for e in passed], "straight", bins)),
            returned=_returned(light),
            sky=mi.TensorXf(sky["sky"].values.astype(np.float32)),
            suns=suns,
        )

    def illuminance(self, shares: mi.Float, factors: mi.Float) -> Illuminances:
        """Illuminance by shares of elements.

        Parameters
        ----------
        shares : mi.Float, shape (element + 1,)
            Shares while the shade is open. Gradients flow through.
        factors : mi.Float, shape (element + 1,)
            Factors of the light that comes in by an element. Light that it sends back into the
            room keeps its weight.

        Returns
        -------
        Illuminances
            E [lx].
        """
        is_open, shaded, straight = self.coefficients(shares, factors)
        E = self._accumulated(is_open)
        E_shaded = E if self.closed is None else self._accumulated(shaded)
        direct = self._by_sun(straight)
        dr.eval(E, E_shaded, direct)  # else each metric would compute them again
        return Illuminances(E, E_shaded, direct)

    def coefficients(
        self, shares: mi.Float, factors: mi.Float
    ) -> tuple[mi.Float, mi.Float, mi.Float]:
        """Coefficients by shares of elements; parameters as for `illuminance`.

        Returns
        -------
        open, shaded, straight : mi.Float
            C with the shade open, C with it closed, and the straight part of the first, flat
            (bin, sensor) [sr].
        """
        total, blocks, straight = self.besides
        same = self._sum(self.same, shares * factors, (total, blocks))
        lit = self._sum(self.opened, shares * factors, same)
        C = C_shaded = self._with_returned(shares, *lit)
        if self.closed is not None:
            behind = (mi.TensorXf(shares, (1, dr.width(shares))) @ self.closing).array
            lit = self._sum(self.closed, behind * factors, same)
            C_shaded = self._with_returned(behind, *lit)
        passed, rows = self.straight
        return C, C_shaded, straight + mixed(rows, _taken(shares * factors, passed))

    def _sum(
        self, part: _Part, weights: mi.Float, more: tuple[mi.Float, mi.Float]
    ) -> tuple[mi.Float, mi.Float]:
        """C and block means of D by some elements, and more light, flat (bin, …)."""
        if len(part.elements) == 0:
            return more
        own = _taken(weights, part.elements)
        return more[0] + mixed(part.total, own), more[1] + mixed(part.blocks, own)

    def _with_returned(self, weights: mi.Float, total: mi.Float, D: mi.Float) -> mi.Float:
        """C with light that openings send back, flat (bin, sensor)."""
        bins, blocks, sensors = self.shape
        sensor, block, met, weight = self.returned
        if dr.width(weight) == 0 or blocks == 0:
            return total
        factor = mi.Float64(weights)  # in double precision, since its gradient is a sum, too
        for element in met:
            weight = weight * dr.gather(mi.Float64, factor, element)
        G = dr.zeros(mi.Float64, blocks * sensors)
        dr.scatter_add(G, mi.Float64(weight), block * sensors + sensor)
        sent_back = mi.TensorXf(D, (bins, blocks)) @ mi.TensorXf(mi.Float(G), (blocks, sensors))
        return total + sent_back.array

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
    every = (light.besides, *light.elements)
    some = [each.bins for each in every if each.gives_light]
    return np.unique(np.concatenate([np.arange(light.sky_bins), *some]))


def _rows(some: Sequence[ElementLight], name: str, bins: np.ndarray) -> Rows:
    """Mean over the results of an array of each element, in the order of `bins`, flat."""
    out = []
    for light in some:
        own = getattr(light, name).mean(axis=0)
        whole = np.zeros((len(bins), own.shape[1]), np.float32)
        known = np.isin(light.bins, bins)
        whole[np.searchsorted(bins, light.bins[known])] = own[known]
        out.append(flat(whole))
    return tuple(out)


def _returned(light: LightByElement) -> tuple[Any, ...]:
    """Sensor, block, elements and weight of all paths that met openings."""
    paths = [back for back in light.returned if isinstance(back, MarkedLight)]
    assert len(paths) == light.replicates, "light between surfaces is not solved on cells"
    sensor, block, met, weight = (
        np.concatenate([getattr(back, name) for back in paths])
        for name in ("sensor", "block", "met", "weight")
    )
    elements = np.where(met < 0, len(light.elements), met).T
    return (
        *map(flat_indices, (sensor, block)),
        tuple(map(flat_indices, elements)),
        flat(weight / np.float32(light.replicates)),
    )


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
