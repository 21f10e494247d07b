"""A basis under a sky: the illuminance of a period by any composition, with gradients.

`Basis.totals`, followed by `accumulate.by_source`, gives the same without gradients.
"""

from __future__ import annotations

from collections.abc import Mapping
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
from drcmitsuba.transport.facade_basis.basis import Basis
from drcmitsuba.transport.facade_basis.facade import Palette, Tiles, elements

Rows = tuple[Any, ...]
"""Arrays (mi.Float) of equal length, one for each element."""
AT_ONCE = 64
"""Number of arrays that one kernel reads."""


class Illuminances(NamedTuple):
    """Illuminance of a period, tensors (time, sensor) [lx]."""

    open: mi.TensorXf
    shaded: mi.TensorXf
    """E with the shade open, and with the shade before all clear tiles."""
    direct: mi.TensorXf
    """E by straight sun, the shade open."""


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
    grouped: Rows


def _rows(arrays: np.ndarray, chosen: np.ndarray) -> Rows:
    """Mean over the groups of each chosen array (element, group, …), flat."""
    return tuple(flat(arrays[i].mean(axis=0)) for i in chosen)


@dataclass(frozen=True)
class BasisYear:
    """A façade's basis under the sky of a period."""

    tiles: Tiles
    palette: Palette
    months: np.ndarray
    """Month of each time stamp, 1 to 12, int, shape (time,)."""
    step_hours: float
    """Duration of a time step [h]."""
    shape: tuple[int, int, int]
    """Numbers of bins, blocks and sensors."""
    parts: Mapping[str, _Part]
    """`covered` by the shade, the `shade` itself, and all `other` elements."""
    straight: tuple[np.ndarray, Rows]
    """Elements that straight light passes and the coefficients of each, flat (bin, sensor) [sr]."""
    returned: tuple[mi.UInt32, mi.UInt32, mi.UInt32, mi.Float]
    """Sensor, block, mark and weight of paths that met the façade."""
    sky: mi.TensorXf
    """Luminance [cd/m²], shape (time, sky bin)."""
    suns: tuple[tuple[mi.UInt32, mi.Float], ...]
    """Bin and luminance [cd/m²] of each sun that is blended at a time stamp."""

    @classmethod
    def of(cls, basis: Basis, light: Daylight) -> BasisYear:
        """Put a basis under the light of a case.

        Raises
        ------
        InputError
            The light has bins that the basis does not know, or an adaptive sun.
        """
        sky = tuple(label for label in basis.labels if not label.startswith("sun_"))
        if tuple(map(str, light.sky["bin"].values)) != sky:
            got = f"{light.sky.sizes['bin']} bins of the sky, the basis has {len(sky)}"
            remedy = "compute the basis with the subdivision of this sky"
            raise InputError("basis", "bin", got, remedy)
        palette, groups = basis.palette, basis.total.shape[1]
        bins, sensors = basis.total.shape[2:]
        material = basis.elements % len(palette.names)
        covered = palette.clear[material]
        shade = np.zeros_like(covered)
        if palette.shade is not None:
            shade = material == palette.names.index(palette.shade)
        kinds = {"covered": covered & ~shade, "shade": shade, "other": ~covered & ~shade}
        parts = {}
        for kind, mask in kinds.items():
            at = np.flatnonzero(mask)
            total, grouped = (_rows(a, at) for a in (basis.total, basis.grouped))
            parts[kind] = _Part(basis.elements[at], total, grouped)
        back, passed = basis.returned, np.arange(len(basis.straight_elements))
        return cls(
            tiles=basis.tiles,
            palette=palette,
            months=light.sky["clock"].dt.month.values,
            step_hours=light.step_hours,
            shape=(bins, basis.grouped.shape[3], sensors),
            parts=parts,
            straight=(basis.straight_elements, _rows(basis.straight, passed)),
            returned=(
                *map(flat_indices, (back.row % sensors, back.block, back.mark)),
                flat(back.weight / groups),
            ),
            sky=mi.TensorXf(light.sky["sky"].values.astype(np.float32)),
            suns=_suns(basis, light),
        )

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of the materials, the columns of a composition."""
        return self.palette.names

    def illuminance(
        self, share: mi.TensorXf, scale: Mapping[str, mi.Float] | None = None
    ) -> Illuminances:
        """Illuminance by a composition.

        Parameters
        ----------
        share : mi.TensorXf, shape (tile, material)
            Shares of the tiles' area, the shade open; rows sum to 1. Gradients flow through.
        scale : dict, optional
            Factors of the light that comes in by a material, by default 1. Light that the
            material sends back into the room keeps its weight.

        Returns
        -------
        Illuminances
            E [lx].
        """
        is_open, shaded, straight = self.coefficients(share, scale)
        E = self._accumulated(is_open)
        E_shaded = E if self.palette.shade is None else self._accumulated(shaded)
        direct = self._by_sun(straight)
        dr.eval(E, E_shaded, direct)  # else each metric would compute them again
        return Illuminances(E, E_shaded, direct)

    def coefficients(
        self, share: mi.TensorXf, scale: Mapping[str, mi.Float] | None = None
    ) -> tuple[mi.Float, mi.Float, mi.Float]:
        """Coefficients of a composition; parameters as for `illuminance`.

        Returns
        -------
        open, shaded, straight : mi.Float
            C with the shade open, C with it closed, and the straight part of the first, flat
            (bin, sensor) [sr].
        """
        behind = share @ mi.TensorXf(self.palette.closing)
        factors = self._factors(scale or {})
        lit, lit_behind = share.array * factors, behind.array * factors
        other = self._mixed("other", lit)
        through = self._mixed("covered", lit)
        of_shade = self._mixed("shade", lit_behind)
        is_open = _sums(other, through)
        if self.palette.own_shade:
            is_open = _sums(is_open, self._mixed("shade", lit))
        C = C_shaded = self._with_returned(share, *is_open)
        if self.palette.shade is not None:
            C_shaded = self._with_returned(behind, *_sums(other, of_shade))
        return C, C_shaded, mixed(self.straight[1], _taken(lit, self.straight[0]))

    def _factors(self, scale: Mapping[str, mi.Float]) -> mi.Float:
        """Factor of the light of every element, flat (tile, material)."""
        for name in scale:
            if name not in self.materials:
                known = ", ".join(self.materials)
                raise InputError("design", "scale", f"no material {name!r}", f"choose of {known}")
        column = dr.arange(mi.UInt32, len(self.tiles) * len(self.materials)) % len(self.materials)
        factors = dr.ones(mi.Float, dr.width(column))
        for name, value in scale.items():
            factors = dr.select(column == self.materials.index(name), value, factors)
        return factors

    def _mixed(self, kind: str, lit: mi.Float) -> tuple[mi.Float, mi.Float]:
        """C and block means of D by some elements, flat (bin, …)."""
        part, (bins, blocks, sensors) = self.parts[kind], self.shape
        if len(part.elements) == 0:
            return dr.zeros(mi.Float, bins * sensors), dr.zeros(mi.Float, bins * blocks)
        weights = _taken(lit, part.elements)
        return mixed(part.total, weights), mixed(part.grouped, weights)

    def _with_returned(self, share: mi.TensorXf, total: mi.Float, grouped: mi.Float) -> mi.Float:
        """C with light that the façade sends back, flat (bin, sensor)."""
        bins, blocks, sensors = self.shape
        row, block, mark, weight = self.returned
        if dr.width(weight) == 0 or blocks == 0:
            return total
        met = mi.Float64(dr.concat((mi.Float(1), share.array)))  # its gradient is a sum, too
        for element in elements(mark):
            weight = weight * dr.gather(mi.Float64, met, element)
        G = dr.zeros(mi.Float64, blocks * sensors)
        dr.scatter_add(G, mi.Float64(weight), block * sensors + row)
        D = mi.TensorXf(grouped, (bins, blocks))
        return total + (D @ mi.TensorXf(mi.Float(G), (blocks, sensors))).array

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


def _sums(a: tuple[mi.Float, ...], b: tuple[mi.Float, ...]) -> tuple[mi.Float, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _taken(values: mi.Float, index: np.ndarray) -> mi.Float:
    return dr.gather(mi.Float, values, flat_indices(index))


def _suns(basis: Basis, light: Daylight) -> tuple[Any, ...]:
    """Bin and luminance of each blended sun; 0 for suns behind the façade."""
    if "blend_bin" not in light.sky:
        raise InputError("case", "sun.model", "adaptive", "take another one for a façade basis")
    everywhere = {*basis.labels, *basis.suns, ""}
    blend, sun = blended(light.sky), light.sky["sun"].values
    terms = []
    for labels, weights in zip(blend.bins.T, blend.weights.T, strict=True):
        strange = [b for b, w in zip(labels, weights, strict=True) if w and b not in everywhere]
        if strange:
            got = f"no {strange[0]!r} ({len(strange)} missing)"
            raise InputError("basis", "bin", got, "compute the basis for this sky")
        at = positions(labels, basis.labels, missing=-1)
        L = np.where(at >= 0, weights.astype(float) * sun, 0)
        terms.append((flat_indices(np.maximum(at, 0)), flat(L)))
    return tuple(terms)
