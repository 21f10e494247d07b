"""What goes with an evaluation through all of its steps."""

from __future__ import annotations

from collections import Counter
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.progress import Progress, Stage, silent, timed
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects


@dataclass(frozen=True)
class Run:
    """Seed and effects of an evaluation, and its records, which all steps add to.

    Parameters
    ----------
    seed : int
        Seed of all random numbers; it takes the place of `accuracy.seed` of the case.
    enabled_effects : EnabledEffects
        What is simulated.
    stage : callable
        Shows the stages of the work.
    seconds : dict of str to float
        Seconds of the stages that are over.
    ray_counter : Counter of str
        Number of rays by kind so far.
    """

    seed: int
    enabled_effects: EnabledEffects = ALL_EFFECTS
    stage: Stage = silent
    seconds: dict[str, float] = field(default_factory=dict)
    ray_counter: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, case: Case, enabled_effects: EnabledEffects = ALL_EFFECTS) -> Run:
        """Run with a case's own seed, of which nothing is shown."""
        return cls(case.accuracy.seed, enabled_effects)

    def timed(self, name: str) -> AbstractContextManager[Progress]:
        """Show a stage and note its seconds."""
        return timed(self.stage, name, self.seconds)

    def with_seed(self, seed: int) -> Run:
        """Run with other random numbers and the same records."""
        return replace(self, seed=seed)

    def branch(self) -> Run:
        """Run with records of its own, which begin with those so far."""
        return replace(self, seconds=dict(self.seconds), ray_counter=Counter(self.ray_counter))
