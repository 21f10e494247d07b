"""Basis of all groups in all states: what any states, hour by hour, are recombined from."""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.group_basis.basis import ElementLight, GroupBasis
from drcmitsuba.transport.group_basis.trace import GroupTrace
from drcmitsuba.transport.group_basis.year import BESIDES

MOST_BYTES = 12 << 30
"""Largest memory of a basis [bytes]."""


def compute(
    case: Case, suns: Suns, accuracy: Accuracy, effects: EnabledEffects, *,
    channel: int = -1, progress: Progress = lambda share: None,
) -> GroupBasis:  # fmt: skip
    """Compute the coefficients of every group of panes in every state.

    Parameters
    ----------
    case, suns, accuracy, effects, channel
        As for `GroupTrace.of`.
    progress : callable
        Takes the share of the work that is done.

    Returns
    -------
    GroupBasis
        Coefficients [sr].

    Raises
    ------
    InputError
        The case has no groups, or the basis is too large.
    """
    trace = GroupTrace.of(case, suns, accuracy, effects, channel=channel)
    paths, replicates = trace.paths, accuracy.replicates
    receivers = len(trace.points), paths.blocks
    _check_size(case, replicates * sum(receivers) * sum(len(e.bins) for e in trace.elements))
    lights = {
        element.number: ElementLight(
            element.bins,
            *(np.empty((replicates, len(element.bins), n), np.float32) for n in receivers),
        )
        for element in trace.elements
    }
    for r in range(replicates):
        G = paths.matrix(r)
        for i, one in enumerate(trace.light(r), 1):
            light, D = lights[one.number], one.cells.numpy()
            light.total[r] = (one.sensors + G @ D).T
            light.blocks[r] = (paths.means @ D).T
            progress((r + i / len(trace.elements)) / replicates)
    return GroupBasis(
        groups=trace.groups,
        positions=trace.positions,
        labels=trace.labels,
        sky_bins=trace.sky_bins,
        besides=lights.pop(BESIDES),
        elements=tuple(lights.values()),
        marked=paths.marked(),
    )


def _check_size(case: Case, numbers: int) -> None:
    """Refuse a basis of so many coefficients that it would not fit in memory."""
    if 4 * numbers > MOST_BYTES:
        got = f"{4 * numbers / 2**30:.0f} GiB of coefficients by group and state"
        remedy = "take fewer sensors, states, replicates or time stamps"
        raise InputError(case.source, "groups", got, remedy)
