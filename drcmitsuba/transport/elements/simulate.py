"""Light of every opening with every fill: what any façade, hour by hour, is recombined from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import ceil

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.runtime.aligned_arrays import aligned_zeros
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements.light import ElementLight, ElementRows, LightByElement
from drcmitsuba.transport.elements.light_on_receivers import Matrix
from drcmitsuba.transport.elements.paths import ElementPaths
from drcmitsuba.transport.elements.scenes import Element
from drcmitsuba.transport.elements.straight_light import Entries, StraightLight
from drcmitsuba.transport.elements.trace import ElementDeposit, ElementTrace, Points

MOST_BYTES = 12 << 30
"""Largest memory of light by element [bytes]."""
BLOCKS = 300
"""Number of blocks of cells of a room, about."""
LEAST_DRAWS, TILES = 2, 8
"""Least number of draws by which an element is lit, and number of openings of one size up to which
each is lit by all draws: many tiles have the samples of each, and random numbers of their own."""
ALIGNED = 16
"""Rows of an element are a multiple of so many, so that each element begins where kernels ask."""
TOGETHER = 1 << 26
"""Largest number of values of D that replicates have in the same launches."""


def compute(
    case: Case, openings: PaneGroups, suns: Suns, accuracy: Accuracy, effects: EnabledEffects, *,
    channel: int = -1, receivers: Points | None = None, kept: int | None = None,
    most_bytes: int = MOST_BYTES,
    progress: Progress = lambda share: None,
) -> LightByElement:  # fmt: skip
    """Compute the coefficients of every opening with every fill.

    Parameters
    ----------
    case, openings, suns, accuracy, effects, channel, receivers
        As for `ElementTrace.of`.
    kept : int, optional
        Number of independent results, a divisor of the number of replicates; each is the mean over
        replicates / kept of them. By default every replicate is kept.
    most_bytes : int
        Largest memory of the coefficients [bytes].
    progress : callable
        Takes the share of the work that is done.

    Returns
    -------
    LightByElement
        Coefficients [sr].

    Raises
    ------
    InputError
        The case has no openings, or more elements than memory holds.
    """
    kept = accuracy.replicates if kept is None else kept
    draws = accuracy.replicates // kept
    assert draws * kept == accuracy.replicates
    trace = ElementTrace.of(
        case, openings, suns, accuracy, effects, channel=channel, draws=draws, receivers=receivers
    )
    trace = _within_memory(trace, kept, most_bytes)
    _check_size(case, trace, kept, _sizes(trace, kept), most_bytes)
    every = (trace.besides, *trace.elements)
    every_row, lights = _dark(trace, kept, every)
    straight: list[list[Entries]] = [[] for _ in every]
    lit_by = [draws_of_light(draws, element) for element in every]
    most = max(trace.paths.gathered.cells.count, len(trace.points))
    together = max(1, TOGETHER // (most * len(trace.labels)))
    if min(lit_by) < draws:  # the first draws of each result stand apart
        together = min(together, draws)
    results, paths = range(0), list[tuple[Matrix, Matrix]]()
    for some in _launches(accuracy.replicates, draws, together):
        before, results = results, range(some.start // draws, (some.stop - 1) // draws + 1)
        if results != before:  # one result may take several launches
            paths = [_matrices(trace.paths, k) for k in results]
        besides: dict[range, ElementDeposit | None] = {}
        for i, (element, own) in enumerate(zip(every, lit_by, strict=True)):
            here = range(some.start, min(some.stop, (results.stop - 1) * draws + own))
            if here and not element.is_opaque:
                if here not in besides:
                    besides[here] = trace.beside(here)
                light = besides[here] if i == 0 else trace.deposited(element, here, besides[here])
                if light is not None:
                    _add(lights[i], straight[i], results, own, light, paths)
            done = some.start + (some.stop - some.start) * i / len(trace.elements)
            progress(done / accuracy.replicates)
    lights = [
        replace(light, pairs=StraightLight.of(entries, kept, light.pairs.shape))
        for light, entries in zip(lights, straight, strict=True)
    ]
    return LightByElement(
        openings=trace.openings,
        positions=trace.positions,
        labels=trace.labels,
        sky_bins=trace.sky_bins,
        rows=every_row,
        besides=lights[0],
        elements=tuple(lights[1 : 1 + trace.openings.starts[-1]]),
        mirrored=tuple(lights[1 + trace.openings.starts[-1] :]),
        pairs=trace.pairs,
        returned=tuple(map(trace.paths.returned, range(kept))),
    )


def memory(
    openings: GroupStates, suns: Suns, accuracy: Accuracy, sensors: int, subdivision: int
) -> int:
    """Memory that light by element of so many `sensors` takes, about [bytes]."""
    bins = openings.starts[-1] * (len(Patches(subdivision)) + len(suns.labels))
    return _size(sensors, BLOCKS, accuracy.replicates, bins)


def draws_of_light(draws: int, element: Element) -> int:
    """Number of a result's draws by which an element is lit; all `draws` count for paths."""
    if element.photons is not None:
        return draws
    return min(draws, max(LEAST_DRAWS, ceil(draws * TILES * element.part)))


def _launches(replicates: int, draws: int, together: int) -> Iterator[range]:
    """Yield replicates that share launches: those of whole results, or some of one result's."""
    whole, step = draws, together
    if together >= draws:
        whole, step = replicates, together // draws * draws
    for start in range(0, replicates, whole):
        for first in range(start, start + whole, step):
            yield range(first, min(first + step, start + whole))


def _dark(
    trace: ElementTrace, kept: int, every: Sequence[Element]
) -> tuple[ElementRows, list[ElementLight]]:
    """Light of 0 of every element, of which opaque ones have the same rows."""
    sensors, blocks = len(trace.points), trace.paths.blocks
    count = [-(-len(e.bins) // ALIGNED) * ALIGNED for e in every]
    ends = np.cumsum(
        [max(count), *(0 if e.is_opaque else n for e, n in zip(every, count, strict=True))]
    )
    rows = ElementRows(
        *(aligned_zeros((kept, int(ends[-1]), n), np.float32) for n in (sensors, blocks))
    )
    lights = []
    for element, end in zip(every, ends.tolist(), strict=False):
        shape = len(element.bins), sensors
        direct = np.zeros((kept, *shape), np.float32) if element.scatters else None
        first = 0 if element.is_opaque else end
        pairs = StraightLight.of((), kept, shape)
        light = ElementLight(element.bins, pairs, direct, *rows, first)
        lights.append(light.within(rows))
    return rows, lights


def _add(
    light: ElementLight, straight: list[Entries], results: range, draws: int,
    deposited: ElementDeposit, paths: list[tuple[Matrix, Matrix]],
) -> None:  # fmt: skip
    """Add the light of some replicates to results of `draws` each, gathered by their matrices.

    What comes straight is appended to `straight`.
    """
    these, count = slice(results.start, results.stop), light.total.shape[2]
    total, blocks = light.total[these], light.blocks[these]
    with one_blas_thread():  # most matrices are small
        for sensors in deposited.sensors:
            first, here = sensors.here.start, (..., sensors.here)
            for k, bin, receiver, C in sensors.straight.entries(len(results), draws):
                straight.append(Entries(results[k], bin * count + first + receiver, C))
                if light.direct is None:
                    total[k, bin, first + receiver] += C
            if light.direct is not None:
                sensors.direct.add_to([light.direct[these][here], total[here]], draws)
        for out, matrices in zip((total, blocks), zip(*paths, strict=True), strict=True):
            deposited.cells.add_to([out], draws, matrices)


def _matrices(paths: ElementPaths, result: int) -> tuple[Matrix, Matrix]:
    """Matrices of a result from cells (cell, sensor), (cell, block): light is kept bin by bin."""
    first, second = (
        np.ascontiguousarray(G.T) if isinstance(G, np.ndarray) else G.T.tocsr()
        for G in (paths.matrix(result), paths.onto_blocks(result))
    )
    return first, second


def _size(sensors: int, blocks: int, kept: int, bins: int) -> int:
    """Memory of C and D of so many bins, by all results [bytes]."""
    return 4 * kept * bins * (2 * sensors + blocks)


def _sizes(trace: ElementTrace, kept: int) -> list[int]:
    """Memory of every element that gives light [bytes]."""
    lit = (each for each in (trace.besides, *trace.elements) if not each.is_opaque)
    return [_size(len(trace.points), trace.paths.blocks, kept, len(each.bins)) for each in lit]


def _within_memory(trace: ElementTrace, kept: int, most_bytes: int) -> ElementTrace:
    """Trace with as many pairs as memory holds."""
    most = len(trace.pairs)
    while most and sum(_sizes(trace.with_pairs(most), kept)) > most_bytes:
        most -= 1
    return trace.with_pairs(most)


def _check_size(
    case: Case, trace: ElementTrace, kept: int, each: list[int], most_bytes: int
) -> None:
    """Refuse more elements than memory holds; `each` are their sizes [bytes]."""
    if sum(each) > most_bytes:
        fit = int(np.searchsorted(np.cumsum(each), most_bytes)) - 1
        got = f"{sum(each) / 2**30:.2g} GiB for {len(each) - 1} openings with one fill each"
        fewer = "fills, tiles, sensors or time stamps"
        fewer += ", or fewer replicates" if kept == trace.accuracy.replicates else ""
        remedy = f"{max(fit, 0)} of them fit: take fewer {fewer}"
        raise InputError(case.source, "elements", got, remedy)
