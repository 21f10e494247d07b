"""Samples of what reaches the eyes in façades of known shares, by sums over elements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.eye.openings import note_of
from drcmitsuba.glare_year.by_element import ElementTracing, EyeIlluminance
from drcmitsuba.glare_year.eye_samples import EyeSamples
from drcmitsuba.glare_year.eyes import Eyes
from drcmitsuba.glare_year.facades import FacadeShares
from drcmitsuba.glare_year.place import SeenPlace
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.metrics.intervals.facade_draws import DrawnStates
from drcmitsuba.runtime.progress import Progress, silent
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.sky.luminances import at_rows


def samples_of(
    facades: Sequence[np.ndarray], illuminance: EyeIlluminance, places: Iterable[SeenPlace],
    looking: Eyes, rule: Rule, done: Progress = lambda share: None,
) -> list[EyeSamples]:  # fmt: skip
    """Samples of eyes in façades, by sums alone; places are looked at one after another.

    `facades` are shares (time, element) of each. Hours in which a façade is as one before it take
    the samples of that one.
    """
    alike = _Alike.of(facades)
    rows = [*zip(facades, alike.fresh, strict=True)]
    E = [illuminance.in_facade(shares, fresh) for shares, fresh in rows]
    replicates, times, views = E[0].shape
    shape = (len(E), times, views)
    seen = {name: np.zeros(shape) for name in ("sums", "sharp")}
    seen["deviations"] = np.zeros((len(E), replicates, times, views), np.float32)
    judged = 0
    with ThreadPoolExecutor(1) as beside:
        for place in places:
            at = place.views
            for k, (shares, fresh) in enumerate(rows):
                if not len(fresh):
                    continue
                here = place.in_facade(shares)
                deviations = beside.submit(here.deviations, rule)  # by NumPy, sums by Dr.Jit
                sums = here.sums(rule, fresh)
                for name, values in zip(("sums", "sharp"), sums, strict=True):
                    seen[name][k][np.ix_(fresh, at)] = values
                seen["deviations"][k][:, :, at] = deviations.result()
            judged += len(at)
            done(judged / views)
    alike.fill(E)
    for values in seen.values():
        alike.fill(values)
    rounds = np.ones((times, views), int)
    return [
        EyeSamples(e, **{name: values[k] for name, values in seen.items()}, rounds=rounds)
        for k, e in enumerate(E)
    ]


class _Alike(NamedTuple):
    """Hours in which façades are as one before them."""

    fresh: list[np.ndarray]
    """Hours of each façade in which it is as none before it, indices."""
    others: list[tuple[int, int, np.ndarray]]
    """Façade, one before it, and the hours that it has of that one."""

    @classmethod
    def of(cls, shares: Sequence[np.ndarray]) -> _Alike:
        """Compare shares (time, element) of façades hour by hour."""
        fresh, others = [], []
        for k, own in enumerate(shares):
            left = np.ones(len(own), bool)
            for j, before in enumerate(shares[:k]):
                same = left & (own == before).all(axis=1)
                if same.any():
                    others.append((k, j, np.flatnonzero(same)))
                left &= ~same
            fresh.append(np.flatnonzero(left))
        return cls(fresh, others)

    def fill(self, values: Sequence[np.ndarray] | np.ndarray) -> None:
        """Fill in values (façade, …, time, view) of the hours that are as before."""
        for k, j, hours in self.others:
            values[k][..., hours, :] = values[j][..., hours, :]


@dataclass(frozen=True, eq=False)
class ElementSampler:
    """Simulation of the eyes of a case by element, in some façades."""

    tracing: ElementTracing
    facades: FacadeShares
    looking: Eyes
    rule: Rule
    again: list[float] = field(default_factory=list)
    """Weight of what each place sees beyond two openings."""

    @property
    def case(self) -> Case:
        """Case whose eyes these are."""
        return self.tracing.case

    @property
    def run(self) -> Run:
        """Run that times the stages."""
        return self.tracing.run

    @property
    def states(self) -> tuple[State, ...]:
        """Names of the façades."""
        return tuple(self.facades.shares)

    @property
    def drawn(self) -> DrawnStates | None:
        """States that `applied` takes in draws."""
        return self.facades.drawn

    def traced(self) -> list[State]:
        """States whose effort is that of all elements, for the forecast."""
        return [OPEN] * (self.tracing.openings.starts[-1] + 1)

    def first(self) -> list[EyeSamples]:
        """Simulate the first round, of all hours and eyes."""
        return self._samples(self.tracing, self.facades.every, self.looking)

    def more(
        self, samples: list[EyeSamples], wanting: np.ndarray, number: int, with_sources: bool
    ) -> list[EyeSamples]:
        """Average a further round into the samples of all states; see `StateSampler.more`."""
        tracing = self.tracing
        seed = case_seed(self.case.accuracy.seed, Stream.ROUNDS, number)
        run = replace(tracing.run, seed=seed, shared=None, stage=silent, seconds={})
        hours, views = (np.flatnonzero(wanting.any(axis=axis)) for axis in ((0, 2), (0, 1)))
        wanted = [k for k, of_state in enumerate(wanting) if of_state.any()]
        here = replace(tracing, light=at_rows(tracing.light, hours), run=run)
        facades = [self.facades.every[k][hours] for k in wanted]
        looking = self.looking.take(views)
        if with_sources:
            names: tuple[str, ...] = ("illuminance", "sums", "sharp", "deviations")
            every = self._samples(here, facades, looking)
        else:
            names = ("illuminance",)
            every = samples_of(facades, here.at_eyes(looking), (), looking, self.rule)
        out = list(samples)
        for k, own in zip(wanted, every, strict=True):
            more = {name: getattr(own, name) for name in names}
            out[k] = samples[k].averaged(more, hours, views)
        return out

    def notes(self) -> tuple[str, ...]:
        """Notes on what is seen."""
        return note_of(max(self.again, default=0.0))

    def _samples(
        self, tracing: ElementTracing, facades: Sequence[np.ndarray], looking: Eyes
    ) -> list[EyeSamples]:
        """Samples of façades, whose places are given up one after another."""
        E = tracing.at_eyes(looking)

        def places() -> Iterator[SeenPlace]:
            for place in tracing.places(looking, self.rule.least):
                self.again.append(place.seen.again)
                yield place

        with tracing.run.timed("what is seen") as done:
            return samples_of(facades, E, places(), looking, self.rule, done)
