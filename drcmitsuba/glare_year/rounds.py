"""Rounds of further samples at the eyes, until the target of a case or its limit of time.

A round is a simulation of its own with another seed, of the states, hours and eyes alone that need
it. With a target of the illuminance it has E_v of the eyes whose interval is too wide. With one of
hours of glare it has E_v and the luminances of these eyes, so that the noise of both falls, in the
hours that some draw of DGP puts on the other side of a limit: all other hours add nothing to the
interval.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from drcmitsuba.annual.adaptive_sampling import of_hours
from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import AT_SENSORS, Target
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.glare_year.eye_samples import EyeSamples, sources_seen
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import at_eyes
from drcmitsuba.runtime.progress import silent
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.time_limit import TimeLimit
from drcmitsuba.schema import mean_and_error
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import at_rows


class IntervalLook(NamedTuple):
    """Look at the intervals after some rounds."""

    half_width: float
    """Half the widest interval, in the unit of the target."""
    wanting: np.ndarray
    """Entries whose further samples narrow the intervals that are too wide, bool, shape (state,
    time, view)."""


Judge = Callable[[list[EyeSamples]], IntervalLook]
"""Function that looks at the samples of all states."""


@dataclass(frozen=True, eq=False)
class Sampler:
    """Simulation of the eyes of a case in several states of its façade."""

    case: Case
    states: tuple[State, ...]
    light: Daylight
    looking: Eyes
    rule: Rule
    run: Run

    def first(self) -> list[EyeSamples]:
        """Simulate the first round, of all hours and eyes."""
        case, light, looking, run = self.case, self.light, self.looking, self.run
        E = [at_eyes(case, state, light, looking, run) for state in self.states]
        seen = [sources_seen(case, state, light, looking, self.rule, run) for state in self.states]
        rounds = np.ones(E[0].shape[1:], int)
        return [EyeSamples(e, **s, rounds=rounds) for e, s in zip(E, seen, strict=True)]

    def more(
        self, samples: list[EyeSamples], wanting: np.ndarray, number: int, with_sources: bool
    ) -> list[EyeSamples]:
        """Average a further round into the samples of all states.

        Parameters
        ----------
        samples : list of EyeSamples, one for each state
        wanting : np.ndarray of bool, shape (state, time, view)
            Entries that need it; of a state, all hours of all its eyes are simulated.
        number : int
            Number of rounds before it, which gives its seed.
        with_sources : bool
            Whether it has the luminances, too.
        """
        seed = case_seed(self.case.accuracy.seed, Stream.ROUNDS, number)
        run = replace(self.run, seed=seed, shared=None, stage=silent, seconds={})
        out = list(samples)
        for k, (state, wanted) in enumerate(zip(self.states, wanting, strict=True)):
            hours, views = (np.flatnonzero(wanted.any(axis=axis)) for axis in (1, 0))
            if not len(hours):
                continue
            light, looking = at_rows(self.light, hours), self.looking.take(views)
            round_ = {"illuminance": at_eyes(self.case, state, light, looking, run)}
            if with_sources:
                round_ |= sources_seen(self.case, state, light, looking, self.rule, run)
            out[k] = samples[k].averaged(round_, hours, views)
        return out


def of_illuminance(samples: list[EyeSamples], target: Target) -> IntervalLook:
    """Look at the illuminance of the hours at every eye, root mean square weighted by E."""
    widths = np.array([
        of_hours(*mean_and_error(each.illuminance), len(each.illuminance)) for each in samples
    ])  # fmt: skip
    hours = np.ones((1, len(samples[0].rounds), 1), bool)
    return IntervalLook(float(widths.max()), hours & (widths > target.value)[:, None])


def of_glare(year: GlareYear, target: Target, index: np.ndarray | None) -> IntervalLook:
    """Look at the shares of hours whose DGP is above a limit.

    Parameters
    ----------
    year : GlareYear
        Its last state is `applied` where there is an index.
    target : Target
    index : np.ndarray of int, shape (time,), optional
        State of each time stamp in `applied`.
    """
    widths = year.half_widths()
    wanting = year.in_doubt & (widths > target.value)[:, None]
    if index is not None:
        *states, applied = wanting
        wanting = np.stack(states)
        wanting[index, np.arange(len(index))] |= applied
    return IntervalLook(float(widths.max()), wanting)


def toward(
    target: Target, sampler: Sampler, samples: list[EyeSamples], judge: Judge
) -> tuple[list[EyeSamples], str]:
    """Add rounds until every interval is as narrow as a target, or the time limit is over.

    Parameters
    ----------
    target : Target
        `Accuracy.eye_goal` of the case.
    sampler : Sampler
    samples : list of EyeSamples, one for each state
        Samples of the first round.
    judge : callable

    Returns
    -------
    samples : list of EyeSamples
        Means of all rounds.
    note : str
        Half width that they reached.
    """
    limit, rounds = TimeLimit(sampler.case.accuracy.time_limit), 1
    of_E = target.unit == AT_SENSORS
    with sampler.run.timed(f"toward {target}") as done:
        look = judge(samples)
        while look.half_width > target.value and look.wanting.any() and not limit.is_over:
            done((target.value / look.half_width) ** 2)
            samples = sampler.more(samples, look.wanting, rounds, not of_E)
            rounds += 1
            look = judge(samples)
    what, unit = ("E of the hours at eyes", "%") if of_E else ("hours of glare", "points")
    note = f"{what}: ±{look.half_width:.3g} {unit} at the widest eye after {rounds} round"
    note += f"{'s' * (rounds > 1)}, wanted ±{target.value:g} {unit}"
    if look.half_width > target.value:
        note += f"; the limit of {limit.seconds:g} s is over"
    return samples, note
