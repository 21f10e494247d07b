r"""Light by element, and the coefficients of any façade from it.

.. math:: C(w) = S_0 + G_0 D_0 + \sum_e w_e (S_e + G_0 D_e)
          + G_m(w) \Big( D_0 + \sum_e w_e D_e \Big)

with S and D the light on sensors and cells that comes in by the element e, one opening with one
fill, before any diffuse reflection; S₀ and D₀ the light that passes no opening; w the share that a
fill takes of its opening; G₀ the paths that met no opening, and G_m those that did, each with the
product of the shares of the fills that it met. Pairs of elements, of which one mirrors the light of
the other, are further elements, whose share is the product of both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.aligned_arrays import aligned_zeros
from drcmitsuba.runtime.pieces import pieces
from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.schema import mean_and_error
from drcmitsuba.transport.coefficient_arrays import with_values, without_values
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs
from drcmitsuba.transport.elements.paths import SentBack
from drcmitsuba.transport.elements.straight_light import StraightLight
from drcmitsuba.transport.elements.weights import BESIDES, Year, chosen

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

LATEST = 8
"""Number of façades whose light that openings send back is kept."""


@dataclass(frozen=True, eq=False)
class ElementLight:
    """Light that comes in by an opening with one fill, in all replicates."""

    bins: np.ndarray
    """Bins that it has light of, positions among all labels, int, shape (own bin,): ground and all
    sky patches, then some suns."""
    pairs: StraightLight
    """C by straight light [sr]."""
    direct: np.ndarray | None
    """C before any diffuse reflection [sr], shape (replicate, own bin, sensor); None where nothing
    scatters, so that it is `straight`."""
    total: np.ndarray
    """C without light that met openings from inside [sr], likewise."""
    blocks: np.ndarray
    """Light on blocks of cells, or targets of `solved_paths`, by paths that met no opening [sr],
    shape (replicate, own bin, block)."""
    first: int = 0
    """Row of the first bin in the arrays that all elements share; see `LightByElement.rows`."""

    @cached_property
    def is_lit(self) -> dict[str, bool]:
        """Whether each array has any light."""
        return {name: bool(array.any()) for name, array in self._arrays.items()}

    @property
    def straight(self) -> np.ndarray:
        """C by straight light [sr], shape (replicate, own bin, sensor), made when asked for."""
        return self.pairs.dense()

    @property
    def _arrays(self) -> dict[str, np.ndarray]:
        arrays = {"straight": self.pairs.C, "total": self.total, "blocks": self.blocks}
        return arrays if self.direct is None else arrays | {"direct": self.direct}

    def seen_at(self, bins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of some bins and the sensors that see them, and C of these pairs [sr].

        `bins` are positions among all labels in rising order, int, shape (bin,). The places of the
        pairs are those in a flat array (bin, sensor), shape (pair,); C is (replicate, pair).
        """
        places, seen = self.places_at(bins)
        return places, self.pairs.C[:, seen]

    def places_at(self, bins: np.ndarray) -> tuple[np.ndarray, np.ndarray | slice]:
        """Such places, and the pairs that they are of: indices, or a slice of all of them."""
        own, sensor = self.pairs.pairs
        at, kept = np.searchsorted(bins, self.bins), np.isin(self.bins, bins)
        if kept.all():
            return at[own] * self.pairs.shape[1] + sensor, slice(None)
        seen = np.flatnonzero(kept[own])
        return at[own[seen]] * self.pairs.shape[1] + sensor[seen], seen

    def times(self, factor: float, rows: ElementRows) -> ElementLight:
        """Light times a factor, whose `total` and `blocks` are put into dark `rows`."""
        light, f = self.within(rows), np.float32(factor)
        for name in ("total", "blocks"):
            if self.is_lit[name]:
                np.multiply(getattr(self, name), f, out=getattr(light, name))
        pairs = replace(self.pairs, C=self.pairs.C * f)
        return replace(light, pairs=pairs, direct=None if self.direct is None else self.direct * f)

    def within(self, rows: ElementRows) -> ElementLight:
        """Light with its part of the `rows` of all elements; an opaque one has none."""
        here = slice(self.first, self.first + len(self.bins))
        return replace(self, total=rows.total[:, here], blocks=rows.blocks[:, here])

    @property
    def gives_light(self) -> bool:
        """Whether any sensor gets its light, be it by way of openings alone."""
        return self.is_lit["total"] or self.is_lit["blocks"]

    def row_of(self, bins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places of own bins in `bins`, some of all bins in rising order, and their own places."""
        own = np.flatnonzero(np.isin(self.bins, bins))
        return np.searchsorted(bins, self.bins[own]), own

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]; one without light takes none."""
        lit = sum(a.nbytes for name, a in self._arrays.items() if self.is_lit[name])
        return lit + self.pairs.places.nbytes


class ElementRows(NamedTuple):
    """Light of several elements, bin by bin, those of one element after those of another."""

    total: np.ndarray
    """C without light that met openings from inside [sr], shape (replicate, row, sensor)."""
    blocks: np.ndarray
    """That on blocks of cells, or targets, likewise [sr], shape (replicate, row, block)."""


@dataclass(frozen=True, eq=False)
class LightByElement:
    """Coefficients by opening and fill."""

    openings: GroupStates
    """Names of the openings and of their fills."""
    positions: np.ndarray
    """Positions of the sensors [m], shape (sensor, 3)."""
    labels: tuple[str, ...]
    """Bins: ground, sky patches, suns."""
    sky_bins: int
    """Number of bins of ground and sky, which come first."""
    rows: ElementRows
    """Light of all elements row by row: `total` and `blocks` of each are a part of them."""
    besides: ElementLight
    """Light that passes no opening."""
    elements: tuple[ElementLight, ...]
    """Light of every opening with every fill, opening by opening."""
    mirrored: tuple[ElementLight, ...]
    """Light of the `pairs`."""
    pairs: MirroredPairs
    returned: tuple[SentBack, ...]
    """Light that openings send back into the room, in every replicate."""
    _sent_back: dict[bytes, tuple[np.ndarray, ...]] = field(
        default_factory=dict, init=False, repr=False
    )
    """Results of `sent_back` that are kept, the latest last."""

    @property
    def replicates(self) -> int:
        """Number of independent results."""
        return len(self.besides.total)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        light = sum(each.nbytes for each in (self.besides, *self.elements, *self.mirrored))
        return light + sum(back.nbytes for back in self.returned)

    def shares(self, indices: np.ndarray) -> np.ndarray:
        """Shares (…, element) of openings with one fill each, `indices` (…, opening)."""
        *first, elements = self.openings.starts
        return chosen(np.array(first), np.asarray(indices), elements)

    def standing(self, shares: np.ndarray) -> LightByElement:
        """Light by the surfaces that stand by the shares of all elements: always the same ones."""
        return self

    def light(self, element: int) -> ElementLight:
        """Light of an element or a pair, whose numbers follow, or the light `BESIDES`."""
        if element == BESIDES:
            return self.besides
        count = len(self.elements)
        return self.elements[element] if element < count else self.mirrored[element - count]

    def coefficients(self, shares: np.ndarray) -> xr.Dataset:
        """Coefficients of a façade.

        Parameters
        ----------
        shares : np.ndarray, shape (element,)
            Share of its opening that every element takes; those of an opening add up to 1.

        Returns
        -------
        xr.Dataset
            As from `transport.coefficients.compute` [sr].
        """
        some, bins = self._some(shares), np.arange(len(self.labels))
        lit = self._straight(some, bins)
        scattered = [(light, share) for light, share in some if light.direct is not None]
        direct = lit
        if scattered:
            clear = [(light, share) for light, share in some if light.direct is None]
            direct = self._straight(clear, bins) + self._scattered(scattered, bins)
        total, data = self.total(shares, bins), {}
        parts = {"straight": lit, "direct": direct, "interreflected": total - direct}
        for name, values in parts.items():
            for end, array in zip(("", "_se"), mean_and_error(values), strict=True):
                data[name + end] = np.ascontiguousarray(array.T)
        empty = without_values(list(self.labels), self.positions)
        return with_values(empty, data, np.ascontiguousarray(total.transpose(0, 2, 1)))

    def replicates_at(self, shares: np.ndarray, bins: np.ndarray) -> xr.Dataset:
        """`replicates` of the coefficients of a façade, at some bins alone.

        Parameters
        ----------
        shares : np.ndarray, shape (element,)
            As for `coefficients`.
        bins : np.ndarray of int, shape (bin,)
            Positions of bins among all labels, in rising order: those of ground and sky are among
            them.
        """
        empty = without_values([self.labels[bin] for bin in bins.tolist()], self.positions)
        return with_values(empty, {}, self.total(shares, bins).transpose(0, 2, 1))

    def straight(self, shares: np.ndarray, bins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Part `straight` of the coefficients of a façade, at some bins alone.

        Parameters
        ----------
        shares : np.ndarray, shape (element,)
            As for `coefficients`.
        bins : np.ndarray of int, shape (bin,)
            Positions of bins among all labels, in rising order.

        Returns
        -------
        tuple of np.ndarray, shape (bin, sensor)
            C and its standard error [sr].
        """
        some = [(each, share) for each, share in self._some(shares) if each.pairs.places.size]
        out = np.zeros((2, len(bins), len(self.positions)), np.float32)
        if len(some) == 1:
            ((light, share),) = some
            places, seen = light.places_at(bins)
            of_pairs = light.pairs.statistics
            if share != 1:
                of_pairs = mean_and_error(np.float32(share) * light.pairs.C)
            for array, values in zip(out, of_pairs, strict=True):
                array.reshape(-1)[places] = values[seen]
        elif some:
            parts = [(*light.seen_at(bins), np.float32(share)) for light, share in some]
            seen = np.zeros(out[0].size, bool)
            for own, *_ in parts:
                seen[own] = True
            places = np.flatnonzero(seen)
            total = np.zeros((self.replicates, len(places)), np.float32)
            for own, C, share in parts:
                total[:, np.searchsorted(places, own)] += C if share == 1 else share * C
            for array, values in zip(out, mean_and_error(total), strict=True):
                array.reshape(-1)[places] = values
        return out[0], out[1]

    def _some(self, shares: np.ndarray) -> list[tuple[ElementLight, float]]:
        """Light of a façade and its shares, what passes no opening first."""
        weights = self.pairs.joined(shares)
        some = [(self.light(e), float(weights[e])) for e in np.flatnonzero(weights).tolist()]
        return [(self.besides, 1.0), *some]

    def total(self, shares: np.ndarray, bins: np.ndarray) -> np.ndarray:
        """C of a façade after all reflections [sr], shape (replicate, bin, sensor).

        Arguments are those of `replicates_at`.
        """
        choice, G = self._choice(self._some(shares), bins), self.sent_back(shares)
        total = np.empty((self.replicates, len(bins), len(self.positions)), np.float32)

        def of_replicate(r: int) -> None:
            C, D = choice @ self.rows.total[r], choice @ self.rows.blocks[r]
            for here in pieces(len(bins), C.shape[1]):
                np.add(C[here], D[here] @ G[r], out=total[r, here])

        in_threads(of_replicate, range(len(total)))
        return total

    def sent_back(self, shares: np.ndarray) -> tuple[np.ndarray, ...]:
        """Light of sensors by light on blocks that openings send back, in every replicate.

        `shares` are those of all elements (element,). The arrays (block, sensor) of the latest
        façades are kept: a state is asked for its hours, for all hours, and for its sources.
        """
        key = np.asarray(shares, np.float32).tobytes()
        if (known := self._sent_back.pop(key, None)) is None:
            known = tuple(np.ascontiguousarray(each.weighed(shares).T) for each in self.returned)
        self._sent_back[key] = known
        for old in [*self._sent_back][:-LATEST]:
            del self._sent_back[old]
        return known

    def _straight(self, some: list[tuple[ElementLight, float]], bins: np.ndarray) -> np.ndarray:
        """Σ w · straight light of some bins, (replicate, bin, sensor)."""
        out = np.zeros((self.replicates, len(bins) * len(self.positions)), np.float32)
        for light, share in some:
            places, C = light.seen_at(bins)
            out[:, places] += C if share == 1 else np.float32(share) * C
        return out.reshape(self.replicates, len(bins), len(self.positions))

    def _scattered(self, some: list[tuple[ElementLight, float]], bins: np.ndarray) -> np.ndarray:
        """Σ w · direct light of scattering fills, of some bins, (replicate, bin, sensor)."""
        out = np.zeros((self.replicates, len(bins), len(self.positions)), np.float32)
        for light, share in some:
            assert light.direct is not None
            at, own = light.row_of(bins)
            out[:, at] += np.float32(share) * light.direct[:, own]
        return out

    def _choice(self, some: list[tuple[ElementLight, float]], bins: np.ndarray) -> csr_matrix:
        """Shares w that elements have in the light of some bins, shape (bin, row)."""
        at, row, share = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0, np.float32)]
        for light, w in some:
            if light.gives_light:
                place, own = light.row_of(bins)
                at.append(place)
                row.append(light.first + own)
                share.append(np.full(len(own), w, np.float32))
        entries = np.concatenate(share), (np.concatenate(at), np.concatenate(row))
        return sparse.csr_matrix(entries, (len(bins), self.rows.total.shape[1]))

    def scaled(self, factors: np.ndarray) -> LightByElement:
        """Light with factors (element,) of what comes in by each; what it sends back stays."""
        if (factors == 1).all():
            return self
        rows = ElementRows(*(aligned_zeros(part.shape, np.float32) for part in self.rows))
        besides = self.besides.times(1.0, rows)
        of_pairs = factors[list(self.pairs.passed)].tolist()
        elements, mirrored = (
            tuple(light.times(f, rows) for light, f in zip(lights, own, strict=True))
            for lights, own in ((self.elements, factors.tolist()), (self.mirrored, of_pairs))
        )
        returned = tuple(each.scaled(factors) for each in self.returned)
        return replace(
            self, rows=rows, besides=besides, elements=elements, mirrored=mirrored,
            returned=returned,
        )  # fmt: skip

    def illuminance(self, L: csr_matrix, shares: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the illuminance of a year by each replicate.

        Parameters
        ----------
        L : csr_matrix, shape (time, bin)
            Luminances of all bins [cd/m²].
        shares : np.ndarray, shape (time, element)
            Share of its opening that every element takes at every time stamp.

        Yields
        ------
        np.ndarray, shape (time, sensor)
            E [lx].
        """
        year = Year.of(L, self.pairs.joined(shares), self.sky_bins)
        receivers = len(self.positions), self.besides.blocks.shape[2]
        for r, returned in enumerate(self.returned):
            E, D = (year.dark(n) for n in receivers)
            for number in year.hours:
                light = self.light(number)
                year.add(E, number, light.bins, light.total[r])
                year.add(D, number, light.bins, light.blocks[r])
            returned.add(E, D, year)
            yield E
