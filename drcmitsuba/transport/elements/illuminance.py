r"""Illuminance of a year of known shares of fills, of which no coefficients by element are kept.

.. math:: E = \sum_e w_e L S_e + (G_0 + G_m) \sum_e w_e L D_e

with the luminances L of every time stamp and the share w that the element e has then. Light is
summed over bins before it is gathered, which takes one product by G₀ instead of one for each
element, and only suns that shine while an element has a share are traced for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements.paths import SentBack
from drcmitsuba.transport.elements.scenes import Element
from drcmitsuba.transport.elements.trace import ElementDeposit, ElementTrace, Points
from drcmitsuba.transport.elements.weights import BESIDES, HOURS, Year

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

THREADS = 2


def illuminance(
    case: Case, openings: PaneGroups, suns: Suns, accuracy: Accuracy, effects: EnabledEffects,
    year: Year, *, channel: int = -1, receivers: Points | None = None,
    progress: Progress = lambda share: None,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Yield the illuminance of a year by each replicate.

    Parameters
    ----------
    case, openings, suns, accuracy, effects, channel, receivers
        As for `ElementTrace.of`.
    year : Year
        Luminances of the bins, ground and sky before `suns`, and shares of every time stamp.
    progress : callable
        Takes the share of the work that is done.

    Yields
    ------
    np.ndarray, shape (time, sensor)
        E [lx].

    Raises
    ------
    InputError
        The case has no openings, or fills that no sum can hold.
    """
    wanted = {e: year.suns_of(e) for e in year.hours if e != BESIDES}
    trace = ElementTrace.of(
        case,
        openings,
        suns,
        accuracy,
        effects,
        channel=channel,
        wanted=wanted,
        receivers=receivers,
    )
    year = replace(year, shares=trace.pairs.joined(year.shares))
    dr.flush_malloc_cache()  # rays take other sizes of memory than light does
    with ThreadPoolExecutor(1) as thread:  # sums while further light is traced
        before: list[Future[np.ndarray]] = []
        for r in range(accuracy.replicates):
            total, job = _Sums.of(year, trace, r), None
            for i, (element, light) in enumerate(_lit(trace, r), 1):
                cells = light.cells.whole
                sky, by_sun = cells.sky.numpy(), _by_bin(cells.sun)
                if job is not None:
                    job.result()  # the light of one element waits at most
                lit = element.number, element.bins, _on_sensors(light)
                job = thread.submit(total.add, *lit, sky, by_sun)
                progress((r + i / (len(trace.elements) + 1)) / accuracy.replicates)
            dr.flush_malloc_cache()
            before.append(thread.submit(total.gathered))
            if len(before) > 1:
                yield before.pop(0).result()
        for last in before:
            yield last.result()
    progress(1)


def _lit(trace: ElementTrace, replicate: int) -> Iterator[tuple[Element, ElementDeposit]]:
    """Yield the light of every element in a replicate; what passes no opening first, if any."""
    here = range(replicate, replicate + 1)
    besides = trace.beside(here)
    if besides is not None:
        yield trace.besides, besides
    for element in (each for each in trace.elements if not each.is_opaque):
        yield element, trace.deposited(element, here, besides)


def _on_sensors(light: ElementDeposit) -> np.ndarray:
    """S of all sensors in one replicate, shape (sensor, own bin) [sr]."""
    return np.concatenate([some.direct.whole.numpy() for some in light.sensors])


@dataclass(frozen=True, eq=False)
class _Sums:
    """Illuminances of a year in one replicate, while light is added to them."""

    year: Year
    G: csr_matrix | np.ndarray
    """G₀."""
    onto_blocks: csr_matrix | np.ndarray
    """Light of blocks from cells; a matrix, since only one thread may use the device."""
    returned: SentBack
    E: np.ndarray
    """Illuminance of the sensors before any diffuse reflection [lx], shape (time, sensor)."""
    on_cells: np.ndarray
    """Illuminance of the cells, likewise [lx], shape (time, cell)."""

    @classmethod
    def of(cls, year: Year, trace: ElementTrace, replicate: int) -> _Sums:
        """Begin without light."""
        paths = trace.paths
        sizes = len(trace.points), paths.gathered.cells.count
        G, onto_blocks = paths.matrix(replicate), paths.onto_blocks(replicate)
        return cls(year, G, onto_blocks, paths.returned(replicate), *map(year.dark, sizes))

    def add(
        self, element: int, bins: np.ndarray, sensors: np.ndarray, sky: np.ndarray,
        by_sun: np.ndarray,
    ) -> None:  # fmt: skip
        """Add the light of an element.

        Parameters
        ----------
        element : int
        bins : np.ndarray of int, shape (own bin,)
        sensors : np.ndarray, shape (sensor, own bin)
            S [sr].
        sky : np.ndarray, shape (cell, sky bin)
            D of the cells by ground and sky [sr].
        by_sun : np.ndarray, shape (own sun, cell)
            D of the cells by the suns [sr].
        """
        year, patches = self.year, sky.shape[1]
        year.add_sky(self.E, element, sensors[:, :patches].T)
        year.add_sky(self.on_cells, element, sky.T)
        year.add_suns(self.E, element, bins, np.ascontiguousarray(sensors[:, patches:].T))
        year.add_suns(self.on_cells, element, bins, by_sun)

    def gathered(self) -> np.ndarray:
        """Add what paths gather of the light on cells: E (time, sensor) [lx]."""
        _gather(self.E, self.G, self.on_cells)
        self.returned.add(self.E, (self.onto_blocks @ self.on_cells.T).T, self.year)
        return self.E


def _by_bin(D: mi.TensorXf) -> np.ndarray:
    """D of (cell, bin) in the order (bin, cell)."""
    cells, bins = D.shape
    if cells * bins == 0:
        return np.zeros((bins, cells), np.float32)
    entry, many = dr.arange(mi.UInt32, cells * bins), dr.opaque(mi.UInt32, cells)
    at = entry % many * dr.opaque(mi.UInt32, bins) + entry // many
    return dr.gather(mi.Float, D.array, at).numpy().reshape(bins, cells)


def _gather(E: np.ndarray, G: csr_matrix | np.ndarray, D: np.ndarray) -> None:
    """Add G₀·D to E (time, sensor), of D (time, cell)."""

    def some(start: int) -> None:
        here = slice(start, start + HOURS)
        E[here] += (G @ np.ascontiguousarray(D[here].T)).T

    with ThreadPoolExecutor(THREADS) as threads:
        for _ in threads.map(some, range(0, len(E), HOURS)):
            pass
