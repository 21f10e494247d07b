"""Light of every opening with every fill: what any façade, hour by hour, is recombined from."""

from __future__ import annotations

from typing import Any

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements.light import ElementLight, LightByElement
from drcmitsuba.transport.elements.scenes import Element
from drcmitsuba.transport.elements.trace import ElementDeposit, ElementTrace

Matrix = Any
"""Matrix of SciPy or NumPy."""
MOST_BYTES = 12 << 30
"""Largest memory of light by element [bytes]."""
BLOCKS = 300
"""Number of blocks of cells of a room, about."""
TOGETHER = 1 << 26
"""Largest number of values of D that replicates have in the same launches."""


def compute(
    case: Case, openings: PaneGroups, suns: Suns, accuracy: Accuracy, effects: EnabledEffects, *,
    channel: int = -1, progress: Progress = lambda share: None,
) -> LightByElement:  # fmt: skip
    """Compute the coefficients of every opening with every fill.

    Parameters
    ----------
    case, openings, suns, accuracy, effects, channel
        As for `ElementTrace.of`.
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
    trace = ElementTrace.of(case, openings, suns, accuracy, effects, channel=channel)
    every = (trace.besides, *trace.elements)
    _check_size(case, trace, [3 * len(element.bins) for element in every])
    lights = [_empty(trace, element) for element in every]
    rows = max(trace.paths.gathered.cells.count, len(trace.points))
    step = max(1, TOGETHER // (rows * len(trace.labels)))
    for start in range(0, accuracy.replicates, step):
        some = range(start, min(start + step, accuracy.replicates))
        G = [(trace.paths.matrix(r), trace.paths.onto_blocks(r)) for r in some]
        besides = trace.beside(some)
        if besides is not None:
            _fill(lights[0], some, besides, G)
        for i, (element, light) in enumerate(zip(every[1:], lights[1:], strict=True), 1):
            if not element.is_opaque:
                _fill(light, some, trace.deposited(element, some, besides), G)
            progress((start + len(some) * i / len(trace.elements)) / accuracy.replicates)
    return LightByElement(
        openings=trace.openings,
        positions=trace.positions,
        labels=trace.labels,
        sky_bins=trace.sky_bins,
        besides=lights[0],
        elements=tuple(lights[1:]),
        returned=tuple(map(trace.paths.returned, range(accuracy.replicates))),
    )


def memory(
    openings: GroupStates, suns: Suns, accuracy: Accuracy, sensors: int, subdivision: int
) -> int:
    """Memory that light by element of so many `sensors` takes, about [bytes]."""
    bins, receivers = len(Patches(subdivision)) + len(suns.labels), 3 * sensors + BLOCKS
    return 4 * openings.starts[-1] * accuracy.replicates * bins * receivers


def _empty(trace: ElementTrace, element: Element) -> ElementLight:
    """Light of 0."""
    shape = trace.accuracy.replicates, len(element.bins)
    sensors, blocks = len(trace.points), trace.paths.blocks
    deposit = element.deposit
    scatters = bool(deposit.films or deposit.patches or element.photons)
    straight, total = (np.zeros((*shape, sensors), np.float32) for _ in range(2))
    direct = np.zeros((*shape, sensors), np.float32) if scatters else straight
    return ElementLight(
        element.bins, straight, direct, total, np.zeros((*shape, blocks), np.float32)
    )


def _fill(
    light: ElementLight, some: range, deposited: ElementDeposit,
    gather: list[tuple[Matrix, Matrix]],
) -> None:  # fmt: skip
    """Write the light of some replicates, gathered by the matrices of each."""
    by_cell = deposited.cells.numpy()
    D = by_cell.reshape(len(some), -1, by_cell.shape[1])
    parts = zip(some, deposited.straight, deposited.direct, D, gather, strict=True)
    for r, straight, direct, cells, (onto_sensors, onto_blocks) in parts:
        if straight.any():  # memory that is never written is never taken
            light.straight[r] = straight.T
        if light.direct is not light.straight:
            light.direct[r] = direct.T
        light.total[r] = (direct + onto_sensors @ cells).T
        light.blocks[r] = (onto_blocks @ cells).T


def _check_size(case: Case, trace: ElementTrace, arrays: list[int]) -> None:
    """Refuse more elements than memory holds: numbers of bins of each, of all arrays together."""
    receivers = len(trace.points) + trace.paths.blocks
    each = [4 * trace.accuracy.replicates * receivers * n for n in arrays]
    if sum(each) > MOST_BYTES:
        fit = int(np.searchsorted(np.cumsum(each), MOST_BYTES)) - 1
        got = f"{sum(each) / 2**30:.2g} GiB for {len(each) - 1} openings with one fill each"
        remedy = f"{max(fit, 0)} of them fit: take fewer fills, sensors, replicates or time stamps"
        raise InputError(case.source, "elements", got, remedy)
