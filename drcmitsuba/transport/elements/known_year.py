r"""Light by element in a year of known luminances, of which any façade is a weighted sum.

.. math:: E = \sum_e w_e E_e + G_m(w) \sum_e w_e B_e

with the illuminances E_e of sensors and B_e of blocks of cells by the element e, made once for all
façades, and the paths G_m that met openings. Openings with a single fill are the same in all
façades. Where paths met no others, G_m is, too, and E_e takes in G_m B_e.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.aligned_arrays import aligned_rows
from drcmitsuba.runtime.flat_arrays import shared
from drcmitsuba.runtime.pieces import pieces, run
from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.transport.elements.light import LATEST, LightByElement
from drcmitsuba.transport.elements.weights import BESIDES, MOST_ROWS, Year, different_rows

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True, eq=False)
class KnownYear:
    """Illuminances of a year by element."""

    light: LightByElement
    L: csr_matrix
    """Luminances of all bins [cd/m²], shape (time, bin)."""
    lit: Mapping[int, np.ndarray]
    """Illuminances of sensors, and of blocks of cells where G_m differs between façades, by every
    element that gives light, and by `BESIDES` with the elements that are the same in all façades
    [lx], shape (replicate, time, receiver)."""
    _means: dict[bytes, dict[int, np.ndarray]] = field(default_factory=dict, init=False, repr=False)
    """Results of `of_means` that are kept."""

    @staticmethod
    def nbytes(light: LightByElement, hours: int) -> int:
        """Memory of a year of so many time stamps [bytes]."""
        blocks = light.besides.blocks.shape[2] if _returns_differ(light) else 0
        receivers = len(light.positions) + blocks
        return 4 * len(_summed(light)) * light.replicates * hours * receivers

    @classmethod
    def of(cls, light: LightByElement, L: csr_matrix) -> KnownYear:
        """Sum the light of every element over the bins."""
        summed, differ, sensors = _summed(light), _returns_differ(light), len(light.positions)
        elements, blocks = len(light.elements), light.besides.blocks.shape[2]
        every = light.pairs.joined(np.ones((L.shape[0], elements), np.float32))
        whole = Year.of(L, every, light.sky_bins)
        shape = (light.replicates, L.shape[0], sensors + blocks * differ)
        lit = {e: aligned_rows(shape) for e in summed}
        same = () if differ else light.sent_back(np.ones(elements))

        def of_replicate(job: tuple[int, int]) -> None:
            target, r = job
            E = lit[target][r]
            D = E[:, sensors:] if differ else whole.dark(blocks)
            for number in summed[target]:
                own = light.light(number)
                whole.add(E[:, :sensors], number, own.bins, own.total[r])
                whole.add(D, number, own.bins, own.blocks[r])
            if not differ:
                E += D @ same[r]

        in_threads(of_replicate, [(e, r) for e in summed for r in range(light.replicates)])
        return cls(light, L, lit)

    def illuminance(self, shares: np.ndarray, hours: np.ndarray | None = None) -> np.ndarray:
        """Illuminance of a façade.

        Parameters
        ----------
        shares : np.ndarray, shape (time, element), or (element,) for all time stamps
            Share of its opening that every element takes.
        hours : np.ndarray of int, optional
            Time stamps of the year that are asked for, in rising order; by default all of them.

        Returns
        -------
        np.ndarray, shape (replicate, time, sensor)
            E [lx].
        """
        hours = np.arange(self.L.shape[0]) if hours is None else hours
        rows, of_hour = different_rows(shares, len(hours))
        light = self.light
        E = np.empty((light.replicates, len(hours), len(light.positions)), np.float32)
        if len(rows) > MOST_ROWS:
            self._by_hour(E, rows[of_hour], hours)
        elif len(hours):
            self._by_row(E, rows, of_hour, hours)
        return E

    def of_element(self, element: int, shares: np.ndarray) -> np.ndarray:
        """Illuminance by the whole of one element, or by `BESIDES`, (replicate, time, sensor) [lx].

        What openings send back of it into the room is that of a façade with `shares` (element,).
        """
        sensors, lit = len(self.light.positions), self.lit[element]
        if not self.differs:
            return lit
        return np.stack(
            [
                each[:, :sensors] + each[:, sensors:] @ G
                for each, G in zip(lit, self.light.sent_back(shares), strict=True)
            ]
        )

    @cached_property
    def differs(self) -> bool:
        """Whether G_m differs between façades."""
        return _returns_differ(self.light)

    @cached_property
    def on_device(self) -> dict[int, tuple[mi.Float, ...]]:
        """Illuminances by element and replicate, flat (time, receiver) [lx]; only CUDA copies."""
        return {e: tuple(map(shared, lit)) for e, lit in self.lit.items()}

    def of_means(self, weights: np.ndarray) -> dict[int, np.ndarray]:
        """Means over sensors by element, by weights (mean, sensor): (replicate, time, mean) [lx].

        All façades of a case ask for the same ones, those of its spaces, which are kept. They are
        summed in the precision of the weights.
        """
        assert not self.differs
        key = weights.tobytes()
        if key not in self._means:
            self._means[key] = {
                e: np.stack([each @ weights.T for each in lit]).astype(np.float32)
                for e, lit in self.lit.items()
            }
            for old in [*self._means][:-LATEST]:
                del self._means[old]
        return self._means[key]

    def _by_row(
        self, E: np.ndarray, rows: np.ndarray, of_hour: np.ndarray, hours: np.ndarray
    ) -> None:
        """Fill in E of few different shares (row, element), each of which holds in many hours."""
        differs, sensors = self.differs, E.shape[2]
        jobs = [
            (row, hours_of[here])
            for row, hours_of in enumerate(np.flatnonzero(of_hour == k) for k in range(len(rows)))
            for here in pieces(len(hours_of), sensors)
        ]

        G = [self.light.sent_back(row) for row in rows if differs]

        def of_replicate(r: int) -> None:
            for row, at in jobs:
                here = run(at)
                if differs:
                    X = self._weighed(r, rows[row], hours[at])
                    E[r, here] = X[:, :sensors] + X[:, sensors:] @ G[row][r]
                elif isinstance(here, slice):
                    self._weighed(r, rows[row], hours[at], E[r, here])
                else:
                    E[r, here] = self._weighed(r, rows[row], hours[at])

        in_threads(of_replicate, range(len(E)))

    def _by_hour(self, E: np.ndarray, shares: np.ndarray, hours: np.ndarray) -> None:
        """Fill in E of shares (time, element) that differ from hour to hour."""
        differs, sensors = self.differs, E.shape[2]
        year = Year.of(self.L[hours], shares, self.light.sky_bins)

        def of_replicate(r: int) -> None:
            X = self._weighed(r, shares, hours)
            E[r] = X[:, :sensors]
            if differs:
                self.light.returned[r].add(E[r], X[:, sensors:], year)

        in_threads(of_replicate, range(len(E)))

    def _weighed(
        self, replicate: int, shares: np.ndarray, hours: np.ndarray, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Σ w_e of all elements' light at some hours (hour, receiver), shares (…, element)."""
        at, parts, shares = run(hours), [], self.light.pairs.joined(shares)
        for number, lit in self.lit.items():
            part = lit[replicate][at]
            if number == BESIDES:
                parts.append(part)
            elif (share := shares[..., number]).any():
                parts.append(part if (share == 1).all() else part * share[..., None])
        first, second, *more = parts if len(parts) > 1 else (parts[0], np.float32(0))
        out = np.add(first, second, out=out)
        for part in more:
            out += part
        return out


def _fixed(light: LightByElement) -> np.ndarray:
    """Whether each element is the only fill of its opening, bool, shape (element,); then pairs."""
    fills = np.diff(light.openings.starts)
    return light.pairs.joined(np.repeat(fills == 1, fills))


def _summed(light: LightByElement) -> dict[int, list[int]]:
    """Elements whose light is summed as one, by the number of the sum.

    They are an element by itself, or, as `BESIDES`, what is the same in all façades.
    """
    always = [BESIDES, *np.flatnonzero(_fixed(light)).tolist()]
    by_choice = np.flatnonzero(~_fixed(light)).tolist()
    gives = {e: light.light(e).gives_light for e in (*always, *by_choice)}
    return {BESIDES: [e for e in always if gives[e]]} | {e: [e] for e in by_choice if gives[e]}


def _returns_differ(light: LightByElement) -> bool:
    """Whether openings send back other light in other façades."""
    by_choice = np.flatnonzero(~_fixed(light))
    return any(np.isin(each.met, by_choice).any() for each in light.returned)
