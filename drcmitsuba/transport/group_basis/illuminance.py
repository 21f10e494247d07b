r"""Illuminance of a year of states, of which no coefficients by group and state are kept.

.. math:: E = \sum_e L_e S_e + (G_0 + G_m) \sum_e L_e D_e

with the luminances :math:`L_e` of the time stamps that have the element e. The light of the suns is
summed over bins before it is gathered, which takes one product by G₀ instead of one for each
element, and only suns that shine while an element is chosen are traced for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.group_basis.marked_light import MarkedLight
from drcmitsuba.transport.group_basis.trace import GroupTrace
from drcmitsuba.transport.group_basis.year import BESIDES, HOURS, Year

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

THREADS = 2


def illuminance(
    case: Case, suns: Suns, accuracy: Accuracy, effects: EnabledEffects, year: Year, *,
    channel: int = -1, progress: Progress = lambda share: None,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Yield the illuminance of a year by each replicate.

    Parameters
    ----------
    case, suns, accuracy, effects, channel
        As for `GroupTrace.of`.
    year : Year
        Luminances of the bins, ground and sky before `suns`, and elements of every time stamp.
    progress : callable
        Takes the share of the work that is done.

    Yields
    ------
    np.ndarray, shape (time, sensor)
        E [lx].

    Raises
    ------
    InputError
        The case has no groups, or states that no sum can hold.
    """
    wanted = {e: year.suns_of(e) for e in year.hours if e != BESIDES}
    trace = GroupTrace.of(case, suns, accuracy, effects, channel=channel, wanted=wanted)
    paths, shape = trace.paths, (len(trace.points), trace.paths.blocks)
    marked = MarkedLight.by_replicate(paths.marked(), accuracy.replicates, shape)
    for r, returned in enumerate(marked):
        E, by_sky, by_suns = (year.dark(n) for n in (*shape, paths.cells.count))
        G = paths.matrix(r)
        for i, light in enumerate(trace.light(r), 1):
            number, bins, S, D = light
            sky = D.sky.numpy()
            patches = sky.shape[1]
            year.add_sky(E, number, (S[:, :patches] + G @ sky).T)
            year.add_sky(by_sky, number, (paths.means @ sky).T)
            year.add_suns(E, number, bins, np.ascontiguousarray(S[:, patches:].T))
            year.add_suns(by_suns, number, bins, _by_bin(D.sun))
            progress((r + i / (len(trace.elements) + 1)) / accuracy.replicates)
        _gather(E, G, by_suns)
        returned.add(E, by_sky + (paths.means @ by_suns.T).T, year.hours, year.chosen)
        progress((r + 1) / accuracy.replicates)
        yield E


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
