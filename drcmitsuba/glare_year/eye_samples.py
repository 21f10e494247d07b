"""Samples of what reaches the eyes in one state of the façade, averaged over rounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import places
from drcmitsuba.sky.daylight import Daylight


@dataclass(frozen=True, eq=False)
class EyeSamples:
    """Illuminance at the eyes, and sums over their glare sources."""

    illuminance: np.ndarray
    """E_v by each replicate [lx], shape (replicate, time, view)."""
    sums: np.ndarray
    """Σ L² ω / P² [cd²/m⁴ sr], shape (time, view)."""
    sharp: np.ndarray
    """The same with peaks of films as narrow as a sun, shape (time, view)."""
    deviations: np.ndarray
    """Deviations of `sums` by each replicate from their mean, shape (replicate, time, view)."""
    rounds: np.ndarray
    """Number of rounds that each entry is the mean of, int, shape (time, view)."""

    def averaged(
        self, more: Mapping[str, np.ndarray], hours: np.ndarray, views: np.ndarray
    ) -> EyeSamples:
        """Mean with a further round.

        Replicate r of the round is averaged into replicate r: the replicates stay independent.

        Parameters
        ----------
        more : mapping of str to np.ndarray, shape (…, hour, some view)
            Arrays of the round by the names of these fields; those that it lacks stay.
        hours, views : np.ndarray
            Indices of the time stamps (hour,) and of the views (some view,) of the round.

        Returns
        -------
        EyeSamples
        """
        at = (..., hours[:, None], views)
        n = self.rounds[at]
        changed = {name: getattr(self, name).copy() for name in (*more, "rounds")}
        for name, values in more.items():
            changed[name][at] = (n * changed[name][at] + values) / (n + 1)
        changed["rounds"][at] += 1
        return replace(self, **changed)


def by_hour(states: Sequence[EyeSamples], index: np.ndarray) -> EyeSamples:
    """Samples of the state that each time stamp has, by its index among `states`, int (time,)."""
    times = np.arange(len(index))

    def chosen(name: str) -> np.ndarray:
        every = np.stack([getattr(samples, name) for samples in states])
        here = np.moveaxis(every, -2, 1)[index, times]  # (time, [replicate,] view)
        return np.moveaxis(here, 0, -2)

    return EyeSamples(*map(chosen, EyeSamples.__dataclass_fields__))


def sources_seen(
    case: Case, state: State, light: Daylight, looking: Eyes, rule: Rule, run: Run
) -> dict[str, np.ndarray]:
    """Sums over the glare sources that the eyes see, and their deviations by each replicate.

    Returns
    -------
    dict of str to np.ndarray
        `sums`, `sharp` and `deviations` of `EyeSamples`.
    """
    times, views = light.sky.sizes["time"], len(looking)
    sums, sharp = np.zeros((2, times, views))
    deviations = np.zeros((case.accuracy.replicates, times, views), np.float32)
    with run.timed(f"what is seen, {state}") as done:
        judged = 0
        for place in places(case, state, light, looking, run, rule.least):
            here = place.sums(rule, np.arange(times))
            sums[:, place.views], sharp[:, place.views] = here
            deviations[:, :, place.views] = place.deviations(rule)
            judged += len(place.views)
            done(judged / views)
    return {"sums": sums, "sharp": sharp, "deviations": deviations}
