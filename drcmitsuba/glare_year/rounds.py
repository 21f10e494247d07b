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
from typing import NamedTuple, TypeAlias

import numpy as np

from drcmitsuba.annual.adaptive_sampling import of_hours
from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import AT_SENSORS, Target
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import APPLIED, State
from drcmitsuba.glare_year.element_sampler import ElementSampler
from drcmitsuba.glare_year.eye_samples import EyeSamples, by_hour, sources_seen
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import at_eyes
from drcmitsuba.metrics.intervals.facade_draws import DrawnStates
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
class StateSampler:
    """Simulation of states one by one; `applied` has of each hour those of its state."""

    case: Case
    light: Daylight
    looking: Eyes
    rule: Rule
    run: Run
    simulated: tuple[State, ...]
    index: np.ndarray | None = None
    """State of each time stamp in `applied`, int, shape (time,); None without it."""
    drawn: DrawnStates | None = None
    """States that `applied` takes in draws."""
    remarks: tuple[str, ...] = ()
    """Notes on what is left out."""

    @property
    def states(self) -> tuple[State, ...]:
        """Names of all states, `applied` last."""
        return self.simulated if self.index is None else (*self.simulated, APPLIED)

    def traced(self) -> list[State]:
        """States that are traced, for the forecast."""
        return [*self.simulated]

    def notes(self) -> tuple[str, ...]:
        """Notes on what was simulated."""
        return self.remarks

    def first(self) -> list[EyeSamples]:
        """Simulate the first round, of all hours and eyes."""
        case, light, looking, run = self.case, self.light, self.looking, self.run
        E = [at_eyes(case, state, light, looking, run) for state in self.simulated]
        seen = [
            sources_seen(case, state, light, looking, self.rule, run) for state in self.simulated
        ]
        rounds = np.ones(E[0].shape[1:], int)
        every = zip(E, seen, strict=True)
        return self._with_applied([EyeSamples(e, **s, rounds=rounds) for e, s in every])

    def more(
        self, samples: list[EyeSamples], wanting: np.ndarray, number: int, with_sources: bool
    ) -> list[EyeSamples]:
        """Average a further round into the samples of all states.

        Parameters
        ----------
        samples : list of EyeSamples
        wanting : np.ndarray of bool, shape (state, time, view)
            Entries of all states that need it; others of their hours and eyes may get it, too.
        number : int
            Number of rounds before it, which gives its seed.
        with_sources : bool
            Whether it has the luminances, too.
        """
        if self.index is not None:
            *states, applied = wanting
            wanting = np.stack(states)
            wanting[self.index, np.arange(len(self.index))] |= applied
        seed = case_seed(self.case.accuracy.seed, Stream.ROUNDS, number)
        run = replace(self.run, seed=seed, shared=None, stage=silent, seconds={})
        out = samples[: len(self.simulated)]
        for k, (state, wanted) in enumerate(zip(self.simulated, wanting, strict=True)):
            hours, views = (np.flatnonzero(wanted.any(axis=axis)) for axis in (1, 0))
            if not len(hours):
                continue
            light, looking = at_rows(self.light, hours), self.looking.take(views)
            round_ = {"illuminance": at_eyes(self.case, state, light, looking, run)}
            if with_sources:
                round_ |= sources_seen(self.case, state, light, looking, self.rule, run)
            out[k] = samples[k].averaged(round_, hours, views)
        return self._with_applied(out)

    def _with_applied(self, samples: list[EyeSamples]) -> list[EyeSamples]:
        """Samples of the states one by one, of `applied`, and of other states in its place."""
        if self.index is None:
            return samples
        others = () if self.drawn is None else self.drawn.others
        return [*samples, *(by_hour(samples, index) for index in (self.index, *others))]


Sampler: TypeAlias = StateSampler | ElementSampler
"""Simulation of the eyes of a case in several states of its façade."""


def of_illuminance(samples: list[EyeSamples], target: Target) -> IntervalLook:
    """Look at the illuminance of the hours at every eye, root mean square weighted by E."""
    widths = np.array([
        of_hours(*mean_and_error(each.illuminance), len(each.illuminance)) for each in samples
    ])  # fmt: skip
    hours = np.ones((1, len(samples[0].rounds), 1), bool)
    return IntervalLook(float(widths.max()), hours & (widths > target.value)[:, None])


def of_glare(year: GlareYear, target: Target) -> IntervalLook:
    """Look at the shares of hours whose DGP is above a limit."""
    widths = year.half_widths()
    wanting = year.in_doubt & (widths > target.value)[:, None]
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
